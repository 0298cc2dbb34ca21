"""What the commands show on a screen: progress on standard error, tables on standard output."""

import contextlib
import sys
import time
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from shadowjax._printable import approximate, one_line


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
    """A table on standard output; columns of `numeric` are aligned right and never broken."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 200
    right = set(numeric)
    table = Table(title=_shown(title), title_justify="left", header_style="bold", box=None, pad_edge=False)
    for index, name in enumerate(columns):
        table.add_column(_shown(name), justify="right" if index in right else "left", no_wrap=index in right)
    for row in rows:
        table.add_row(*(Text(_shown(str(value))) for value in row))
    # Rich ends the program by itself where the reader of standard output has gone, so it only lays out.
    with console.capture() as laid_out:
        console.print(table)
    sys.stdout.write(laid_out.get())


def say(message: str) -> None:
    """A line on standard output."""
    print(_shown(message))


def _shown(text: str, stream: Any = None) -> str:
    """One line in characters that a stream can show; replaced before tables are laid out, so that columns align."""
    encoding = getattr(sys.stdout if stream is None else stream, "encoding", None) or "utf-8"
    return approximate(one_line(text), encoding)
