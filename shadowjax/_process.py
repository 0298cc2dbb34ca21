"""A command-line program as a process: signals end it with nothing half written, errors are one line and a code.

Exit codes: 0 done, 1 a claim or an equation failed, 2 bad input or a file that cannot be read or written, and 128 and
the signal's number (130 for an interrupt from the keyboard) where a signal ended it.
"""

# Light imports only: signals are handled before anything heavy is imported.

import atexit
import contextlib
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

from shadowjax._printable import APPROXIMATE, one_line

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

_ENDINGS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "terminated, as its terminal is gone"}
_SHOW_CURSOR = b"\r\x1b[K\x1b[?25h"


@dataclass
class _State:
    """What this process is doing. Whoever holds the lock may write files; a thread that ends the process keeps it."""

    program: str = ""
    exit_code: int = FAILED
    unfinished: set[str] = field(default_factory=set)
    writing: threading.RLock = field(default_factory=threading.RLock)
    depth: int = 0  # of calls that hold the lock
    ending: bool = False


_state = _State()


def run(program: str, main: Callable[[], int]) -> NoReturn:
    """Run a program as the whole of this process: the last thing that its `__main__` does.

    Args:
        program: Its name, before every message.
        main: What it does; returns the exit code. Its imports belong into it, so that signals find a handler.
    """
    _state.program = program
    _prepare_streams()
    _handle_signals()
    atexit.register(_leave)  # registered first, so called last
    _state.exit_code = main()
    sys.exit(_state.exit_code)


def exit_code(program: str, work: Callable[[], int], less_memory: str) -> int:
    """Do some work and turn what goes wrong into one line on standard error and an exit code.

    Args:
        program: Its name, before every message.
        work: Returns the exit code. Faults of the program itself are raised as they are.
        less_memory: What to do where memory does not suffice.
    """
    show, warnings.showwarning = warnings.showwarning, _Warnings(program)
    try:
        code = work()
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        return DONE  # the reader of our output has gone: nothing more to say
    except OSError as error:
        return complain(program, os_error_text(error))
    except ValueError as error:
        return complain(program, str(error))
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
            return complain(program, f"not enough memory; {less_memory}")
        raise
    except KeyboardInterrupt:
        return INTERRUPTED
    except SystemExit as stop:  # readers of options end a program when they have shown its help
        return DONE if stop.code is None else stop.code if isinstance(stop.code, int) else FAILED
    finally:
        warnings.showwarning = show


def complain(program: str, message: str) -> int:
    """One line on standard error; the code for bad input."""
    with contextlib.suppress(OSError, AttributeError):
        print(f"{program}: {one_line(message)}", file=sys.stderr, flush=True)
    return BAD_INPUT


def os_error_text(error: OSError) -> str:
    """The system's own short words, and the file that they are about."""
    reason = (error.strerror or str(error)).lower()
    name = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else error.filename
    return f"input or output failed: {reason}" if name is None else f"cannot read or write {name}: {reason}"


class _Warnings:
    """Warnings as one line each, each said once."""

    def __init__(self, program: str):
        self._program, self._said = program, set[str]()

    def __call__(self, message: Any, *_: Any, **__: Any) -> None:
        line = one_line(str(message))
        # A cache that cannot be read or written costs time, entry by entry, and nothing else.
        if "persistent compilation cache" in line:
            if "Error reading" in line:
                return
            line = f"compiled programs are not kept: {line.rsplit(': ', 1)[-1]}"
        if line not in self._said:
            self._said.add(line)
            complain(self._program, f"warning: {line}")


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """A short time that no signal falls into, such as the renaming of several files: it takes effect afterwards."""
    with _state.writing:
        _state.depth += 1
        try:
            yield
        finally:
            _state.depth -= 1


@contextlib.contextmanager
def unfinished(path: str) -> Iterator[None]:
    """A file that must not stay unless it takes another name: removed at the end, and where a signal ends the process.

    Args:
        path: Absolute.
    """
    with uninterrupted():
        _state.unfinished.add(path)
    try:
        yield
    finally:
        with uninterrupted():
            with contextlib.suppress(OSError):
                os.unlink(path)
            _state.unfinished.discard(path)


def _handle_signals() -> None:
    """End the process at a signal, also while the main thread is in compiled code."""
    watched = set[int]()
    for name in _ENDINGS:
        number = getattr(signal, name, None)
        # What starts a program may ask it to ignore a signal, as `nohup` does.
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _on_signal)
            watched.add(number)
    if os.name != "posix":
        return
    # Python calls a handler between two of its instructions; a thread answers while the main one compiles, and where
    # the signal fell into a time that must not be interrupted.
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader, watched), name="signals", daemon=True).start()


def _on_signal(number: int, _: object) -> None:
    if not _state.depth:
        _end(number)


def _watch(reader: int, watched: set[int]) -> None:
    while True:
        for number in os.read(reader, 64):
            if number in watched:
                _end(number)


def _end(number: int) -> None:
    """Remove unfinished files, say one line, and end the process at once."""
    with _state.writing:
        if _state.ending:
            return
        _state.ending = True
        for path in tuple(_state.unfinished):
            with contextlib.suppress(OSError):
                os.unlink(path)
        with contextlib.suppress(OSError):
            ending = _ENDINGS[signal.Signals(number).name]
            os.write(2, (_SHOW_CURSOR if os.isatty(2) else b"") + f"{_state.program}: {ending}\n".encode())
        os._exit(128 + number)


def _prepare_streams() -> None:
    """Open what was closed, so that no file takes its place, and print what an encoding lacks by something like it."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
            setattr(sys, name, os.fdopen(descriptor, "r" if descriptor == 0 else "w", closefd=False))
        stream = getattr(sys, name)
        if descriptor and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=APPROXIMATE)


def _leave() -> None:
    """End the process before Python's own shutdown: a signal then finds handlers to the last."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(_state.exit_code)
