"""What the commands show on a screen: progress on standard error, tables on standard output."""

import time
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text


class Steps:
    """Progress of long work on standard error: a moving line on a terminal, a line for each step elsewhere.

    Args:
        title: What is being done.
    """

    def __init__(self, title: str):
        self._console = Console(stderr=True, highlight=False)
        self._title, self._start = title, time.monotonic()
        self._status = self._console.status(title) if self._console.is_terminal else None

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
            self._status.update(Text(f"{self._title}: {step} · {self._elapsed():.0f} s"))
        else:
            self._write(step)

    def _elapsed(self) -> float:
        return time.monotonic() - self._start

    def _write(self, step: str) -> None:
        self._console.print(Text(f"{self._elapsed():6.1f} s  {step}"), soft_wrap=True)


def show_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], numeric: Iterable[int] = ()) -> None:
    """A table on standard output; columns of `numeric` are aligned right and never broken."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 200
    right = set(numeric)
    table = Table(title=title, title_justify="left", header_style="bold", box=None, pad_edge=False)
    for index, name in enumerate(columns):
        table.add_column(name, justify="right" if index in right else "left", no_wrap=index in right)
    for row in rows:
        table.add_row(*(Text(str(value)) for value in row))
    console.print(table)


def say(message: str) -> None:
    """A line on standard output."""
    Console(highlight=False).print(Text(message), soft_wrap=True)
