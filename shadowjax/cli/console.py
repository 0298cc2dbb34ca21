"""What the commands show on a screen: progress on standard error, tables on standard output."""

import contextlib
import shutil
import sys
import time
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from shadowjax import io
from shadowjax._checks import require
from shadowjax._printable import approximate, one_line

_WIDTH_OF_FILES = 200
_LEAST_TEXT = 16  # characters of a column of text that may be broken
_BETWEEN = 2  # characters between two columns


class Steps:
    """Progress of long work on standard error: a moving line on a terminal, a line for each step elsewhere.

    Args:
        title: What is being done.
    """

    def __init__(self, title: str):
        console = Console(stderr=True, highlight=False)
        self._title, self._start = title, time.monotonic()
        moves = console.is_terminal and not console.is_dumb_terminal
        spinner = "dots" if console.encoding.startswith("utf") else "line"
        self._status = console.status(title, spinner=spinner) if moves else None

    def __enter__(self) -> "Steps":
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, step: str) -> None:
        """Say which step starts now."""
        if self._status is not None:
            self._status.update(Text(_shown(f"{self._title}: {step} · {self._elapsed():.0f} s", sys.stderr)))
            return
        with contextlib.suppress(OSError, AttributeError):  # the work goes on when nobody can read how far it is
            print(_shown(f"{self._elapsed():6.1f} s  {step}", sys.stderr), file=sys.stderr, flush=True)

    def _elapsed(self) -> float:
        return time.monotonic() - self._start


def show_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], numeric: Iterable[int] = ()) -> None:
    """A table on standard output; columns of `numeric` are aligned right and never broken.

    Where the terminal is too narrow for all columns, further tables below hold the rest, each with the first column.
    Nothing is cut off: text goes on in the next line.
    """
    # Rich takes a terminal that it calls dumb to be 80 wide.
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else _WIDTH_OF_FILES
    console = Console(highlight=False, width=width, height=24)
    right = set(numeric)
    heads, cells = [_shown(name) for name in columns], [[_shown(str(value)) for value in row] for row in rows]
    # A column of numbers, and the first one, are as wide as their widest cell; other text may be broken.
    widths = [
        widest if index in right or index == 0 else min(widest, _LEAST_TEXT)
        for index, widest in enumerate(max(map(len, column)) for column in zip(heads, *cells, strict=True))
    ]
    # Rich ends the program by itself where the reader of standard output has gone, so it only lays out.
    with console.capture() as laid_out:
        for number, part in enumerate(_parts(widths, console.width)):
            table = Table(title=None if number else _shown(title), title_justify="left", header_style="bold", box=None)
            table.pad_edge = False
            for index in part:
                table.add_column(heads[index], justify="right" if index in right else "left", overflow="fold")
                if widths[index] <= console.width // 2 and (index in right or index == 0):
                    table.columns[-1].min_width = widths[index]
            for row in cells:
                table.add_row(*(Text(row[index]) for index in part))
            console.print(table)
    sys.stdout.write(laid_out.get())


def _parts(widths: Sequence[int], room: int) -> list[list[int]]:
    """Columns of each table, so that each fits into the room: all of them in one if they fit."""
    parts, left = [[0]], room - widths[0]
    for index in range(1, len(widths)):
        need = widths[index] + _BETWEEN
        if need > left and len(parts[-1]) > 1:
            parts.append([0])
            left = room - widths[0]
        parts[-1].append(index)
        left -= need
    return parts


def say(message: str) -> None:
    """A line on standard output."""
    print(_shown(message))


def _shown(text: str, stream: Any = None) -> str:
    """One line in characters that a stream can show; replaced before tables are laid out, so that columns align."""
    encoding = getattr(sys.stdout if stream is None else stream, "encoding", None) or "utf-8"
    return approximate(one_line(text), encoding)


def write_json(path: str | None, content: Any) -> bool:
    """Write where `--json` says; whether standard output now belongs to the JSON."""
    if path is None:
        return False
    if io.is_standard_output(path):
        sys.stdout.write(io.json_text(content, ascii_only="utf" not in (sys.stdout.encoding or "").lower()))
        return True
    io.write_json(path, content)
    return False


def labelled(names: Sequence[str]) -> dict[str, str]:
    """Techniques by the names they are shown under: LABEL=NAME, or the name itself.

    Raises:
        ValueError: If a name is given twice, or a label is empty.
    """
    made: dict[str, str] = {}
    for word in names:
        label, equals, name = word.partition("=")
        require(bool(label), f"a technique is NAME or LABEL=NAME; got {word!r}")
        require(label not in made, f"give each technique once; got {label} more than once")
        made[label] = name if equals else label
    return made


def short(value: Any) -> str:
    """A value as a cell of a table."""
    if isinstance(value, list | tuple):
        return ", ".join(short(one) for one in value)
    return f"{value:.8g}" if isinstance(value, float) else str(value)
