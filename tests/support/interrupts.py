"""Programs of this repository in processes of their own, stopped by a signal at a chosen moment."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]


@contextlib.contextmanager
def _heeded() -> Iterator[None]:
    """No signal ignored by this process, since its children would ignore it too: a test may run in the background."""
    numbers = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) is signal.SIG_IGN]
    for number in numbers:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)


def start(words: Sequence[str], folder: Path, **environment: str) -> subprocess.Popen[str]:
    """Start Python in a folder, with words after `python`."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "SHADOWJAX_"))}
    with _heeded():
        return subprocess.Popen(
            [sys.executable, *words],
            cwd=folder,
            env={**kept, "PYTHONPATH": str(ROOT), **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


def wait_for_handlers(process: subprocess.Popen[str]) -> bool:
    """Wait until a program handles SIGTERM; False if it ended before. Before that, the signal finds Python alone."""
    status = Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        try:
            caught = next(line for line in status.read_text().splitlines() if line.startswith("SigCgt"))
        except (OSError, StopIteration):
            return False
        if int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1:
            return True
        time.sleep(0.001)
    return False


def stop(process: subprocess.Popen[str], number: int, after: float, patience: float = 60.0) -> tuple[int, str, str]:
    """Send a signal some seconds after a program handles it; its exit code and what it wrote."""
    if wait_for_handlers(process):
        time.sleep(after)
        process.send_signal(number)
    out, err = process.communicate(timeout=patience)
    return process.returncode, out, err
