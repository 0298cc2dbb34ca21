"""Random calls of the command line: no traceback, codes 0, 1 and 2, refusals of one line, bounded time and memory."""

import json
import os
import subprocess
import sys

import pytest
from calls import make_files, random_call
from interrupts import ROOT

from shadowjax.cli import main

BATCH = 50
REFUSED_SECONDS, REFUSED_BYTES = 15, 2**30
DONE_SECONDS, DONE_BYTES = 120, 2**31


def assert_clean(words, code, out, err):
    """What every call keeps to."""
    assert code in (0, 1, 2), (words, code, err)
    assert "Traceback" not in err, (words, err)
    assert all(sign.isprintable() or sign == "\n" for sign in err), (words, err)
    if code == 2 and words:
        last = err.splitlines()[-1]
        assert last.startswith("shadowjax: "), (words, err)
        assert not last.startswith("shadowjax: warning"), (words, err)


@pytest.mark.filterwarnings("default")
def test_calls_that_cost_little(tmp_path, monkeypatch, capsys):
    make_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    codes = []
    for seed in range(90):
        words = random_call(seed, cheap=True)
        code = main(words)
        out, err = capsys.readouterr()
        assert_clean(words, code, out, err)
        codes.append(code)
        if code == 2:
            assert err.count("\n") == 1 + err.count("shadowjax: warning") + err.count(" s  "), (words, err)
    assert codes.count(2) > 40
    assert codes.count(0) > 3
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".shadowjax")]


@pytest.fixture(scope="module")
def server():
    """The command line, imported once without the settings of the tests."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "SHADOWJAX_"))}
    environment = {**kept, "PYTHONPATH": str(ROOT), "JAX_COMPILATION_CACHE_DIR": str(ROOT / ".jax_cache")}
    with subprocess.Popen(
        [sys.executable, ROOT / "tests" / "support" / "call_server.py"],
        env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        yield process
        process.stdin.close()


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="measures with wait4")
@pytest.mark.parametrize("batch", range(14))
def test_calls_in_processes_of_their_own(batch, server, tmp_path):
    for seed in range(1000 + BATCH * batch, 1000 + BATCH * (batch + 1)):
        folder = tmp_path / str(seed)
        folder.mkdir()
        make_files(folder)
        words = random_call(seed)
        print(json.dumps({"words": words, "folder": str(folder)}), file=server.stdin, flush=True)
        seen = json.loads(server.stdout.readline())
        assert_clean(words, seen["code"], seen["out"], seen["err"])
        most = (REFUSED_SECONDS, REFUSED_BYTES) if seen["code"] == 2 else (DONE_SECONDS, DONE_BYTES)
        assert seen["seconds"] <= most[0], (words, seen)
        assert seen["bytes"] <= most[1], (words, seen)
        assert not [name for name in os.listdir(folder) if name.startswith(".")]
        assert (folder / "link.png").is_symlink()
