"""A signal ends a command at once, whatever it is doing: code 128 + signal, one line at most, nothing half written."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest
from interrupts import ROOT, start, stop

pytestmark = pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="reads what a process handles in /proc")

SAID = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
COMMANDS = {
    "render": ["render", "cubes", "-o", "x.png", "--width", "64", "--height", "48", "--resolution", "64"],
    "compare": [
        "compare", "sphere-over-plane", "--techniques", "hard", "vsm", "--json", "x.json", "--width", "48",
        "--height", "32", "--resolution", "32", "--caster", "brute",
    ],
    "splits": ["optimize", "splits", "--json", "-"],
    "verify": ["verify", "--only", "asm", "--json", "x.json"],
    "scenes": ["scenes"],
    "help": ["render", "--help"],
}  # fmt: skip


def assert_ends(words, number, after, folder, program="shadowjax"):
    process = start(["-m", program, *words], folder, JAX_COMPILATION_CACHE_DIR=str(ROOT / ".jax_cache"))
    code, _, err = stop(process, number, after)
    assert "Traceback" not in err, err
    assert not [name for name in os.listdir(folder) if name.startswith(".")]
    if code != 0:  # it may have been done before
        assert code == 128 + number, err
        assert err.splitlines()[-1] == f"{program}: {SAID[number]}"
        assert os.listdir(folder) == []
    return code


@pytest.mark.parametrize(
    ("command", "number", "after"),
    [("help", signal.SIGINT, 0.0), ("render", signal.SIGINT, 0.4), ("compare", signal.SIGTERM, 2.5)],
)
def test_a_signal_ends_a_command(command, number, after, tmp_path):
    code = assert_ends(COMMANDS[command], number, after, tmp_path)
    assert code != 0 or command == "help"


@pytest.mark.parametrize("after", [0.0, 1.0])
def test_a_signal_ends_an_experiment(after, tmp_path):
    assert assert_ends(["all", "--out", "."], signal.SIGINT, after, tmp_path, "experiments") == 130


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_signals_at_many_moments(seed, tmp_path):
    chosen = random.Random(seed)
    number = chosen.choice(list(SAID))
    assert_ends(COMMANDS[chosen.choice(list(COMMANDS))], number, 8 * chosen.random() * chosen.random(), tmp_path)


def test_a_signal_ends_a_command_that_waits_for_the_reader_of_a_pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    process = start(["-m", "shadowjax", "scenes", "--json", "pipe"], tmp_path)
    code, out, err = stop(process, signal.SIGINT, 3.0)
    assert (code, out, err) == (130, "", "shadowjax: interrupted\n")
    assert os.listdir(tmp_path) == ["pipe"]


def program(body, folder):
    """A program of a few lines, run as the command line is."""
    text = f"import time\nfrom shadowjax import _process, io\ndef main():\n    {body}\n_process.run('it', main)"
    return start(["-c", text], folder)


@pytest.mark.parametrize(
    "body",
    [
        "import hashlib; hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)",  # one call of compiled code
        "\n    while True:\n        try:\n            time.sleep(9)\n        except BaseException:\n            pass",
    ],
    ids=["compiled code", "a callback that catches everything"],
)
def test_a_signal_ends_what_does_not_let_it_through(body, tmp_path):
    code, _, err = stop(program(body, tmp_path), signal.SIGINT, 0.2, patience=10)
    assert (code, err) == (130, "it: interrupted\n")


WRITE = """
    io.write_files({'a': b'0' * 300_000, 'b': b'0' * 300_000})
    print('ready', flush=True)
    k = 0
    while True:
        k += 1
        content = str(k % 10).encode() * (200_000 + 1000 * (k % 10))
        io.write_files({'a': content, 'b': content})"""


def assert_whole(seed, folder):
    process = program(WRITE, folder)
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.02 * random.Random(seed).random())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (130, "", "it: interrupted\n")
    assert sorted(os.listdir(folder)) == ["a", "b"]
    a, b = ((folder / name).read_bytes() for name in "ab")
    assert a == b
    assert len(set(a)) == 1


def test_files_are_whole_and_belong_together_after_a_signal(tmp_path):
    for seed in range(12):
        assert_whole(seed, tmp_path)


@pytest.mark.long
def test_files_are_whole_after_many_signals(tmp_path):
    for seed in range(300):
        assert_whole(seed, tmp_path)


def test_a_signal_that_the_caller_ignores_stays_ignored(tmp_path):
    """As for programs that a shell starts in the background."""
    text = (
        "import os, signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "from shadowjax import _process\n"
        "def main():\n    os.kill(os.getpid(), signal.SIGINT)\n    return 0\n_process.run('it', main)"
    )
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
