"""Calls of the command line in processes forked from one that has imported it: as fresh ones, three seconds sooner.

Reads a line of JSON for each call, {"words": [...], "folder": "..."}, and answers with one: code, what it wrote,
seconds of the processor and the largest memory.
"""

import json
import os
import sys
import threading
import time

import jax

import shadowjax
from shadowjax import _process, report
from shadowjax.cli import commands, main

LOADED = (jax, report, commands, *(getattr(shadowjax, name) for name in shadowjax.__all__))
PATIENCE = 600.0


def serve() -> None:
    """Answer until the input ends."""
    assert threading.active_count() == 1
    for line in sys.stdin:
        asked = json.loads(line)
        print(json.dumps(call(asked["words"], asked["folder"])), flush=True)


def call(words: list[str], folder: str) -> dict[str, object]:
    """Fork, run the words in a folder, and wait."""
    paths = [os.path.join(os.path.dirname(folder), name) for name in ("stdout", "stderr")]
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        for descriptor, path in enumerate(["/dev/null", *paths]):
            os.dup2(os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC), descriptor)
        sys.argv[1:] = words
        _process.run("shadowjax", main)
    end = time.monotonic() + PATIENCE
    while (done := os.wait4(child, os.WNOHANG))[0] == 0:
        if time.monotonic() > end:
            os.kill(child, 9)
        time.sleep(0.01)
    texts = []
    for path in paths:
        with open(path, encoding="utf-8", errors="surrogateescape", newline="") as stream:
            texts.append(stream.read())
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "code": os.waitstatus_to_exitcode(done[1]),
        "out": texts[0],
        "err": texts[1],
        "seconds": done[2].ru_utime + done[2].ru_stime,
        "bytes": done[2].ru_maxrss * unit,
    }


if __name__ == "__main__":
    serve()
