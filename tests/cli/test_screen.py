"""What commands show on narrow, dumb and ASCII terminals, in closed streams, and of names that steer a screen."""

import io as text_streams
import os
import re
import shutil
import subprocess
import sys

import pytest
from interrupts import ROOT
from PIL import Image

from experiments import EXPERIMENTS, summaries
from shadowjax._printable import APPROXIMATE, approximate, one_line, printable
from shadowjax.cli import console, main

NASTY = "a\x1b[31m\n\u202e[red]<b>$x$\udcff&.obj"
COLUMNS = (
    "technique",
    "light error",
    "RMS error",
    "false light",
    "false shadow",
    "bleed",
    "what it is",
    "memory",
    "ms",
)
ROWS = [
    (f"2sm-max+pcf-{k}x{k}", "12.34 %", "0.1234", "12.34 %", "12.34 %", "1.23 %", "several words of text", "9 MiB", "∞")
    for k in (2, 3)
]


@pytest.mark.parametrize("width", [200, 80, 60, 40, 24])
@pytest.mark.parametrize("term", ["xterm", "dumb"])
def test_tables_are_whole_however_narrow_the_terminal(width, term, monkeypatch, capsys):
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(shutil, "get_terminal_size", lambda *_: os.terminal_size((width, 24)))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    console.show_table("maps of 512²", COLUMNS, ROWS, numeric=(1, 2, 3, 4, 5, 7, 8))
    lines = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()
    assert max(map(len, lines)) <= width
    shown = "".join("".join(lines).split())
    assert "…" not in shown
    if width >= 40:  # names stay in one piece
        for text in [name for row in ROWS for name in row[:6]] + list(COLUMNS[1:3]):
            assert "".join(text.split()) in shown


def test_the_list_of_experiments_fits_eighty_columns(monkeypatch, capsys):
    monkeypatch.setattr(shutil, "get_terminal_size", lambda *_, **__: os.terminal_size((80, 24)))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert main(["experiments"]) == 0
    lines = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()
    assert max(map(len, lines)) <= 80
    first = [line.split()[0] for line in lines if line[:1].isalpha()]
    assert set(EXPERIMENTS) <= set(first)
    told = summaries()
    assert all(len(text) > 20 for text in told.values())
    assert "".join(told["warping_fig_22"].split()) in "".join("".join(line[31:].split()) for line in lines)


def test_ascii_screens_get_words_for_signs(monkeypatch):
    buffer = text_streams.BytesIO()
    monkeypatch.setattr(sys, "stdout", text_streams.TextIOWrapper(buffer, encoding="ascii"))
    console.show_table("maps of 512², φ ≤ 30°", COLUMNS, ROWS, numeric=range(1, 9))
    console.say("3 × 4 → 汉")
    sys.stdout.flush()
    shown = buffer.getvalue().decode()
    assert "maps of 512^2, phi <= 30 deg" in shown
    assert "3 x 4 -> ?" in shown
    heads, first, second = shown.splitlines()[1:4]
    assert len(first) == len(second)
    assert heads.rstrip().endswith("ms")
    assert first.rstrip().endswith("inf")


def test_text_is_made_printable():
    assert printable("plain φ ² 汉\u0301") == "plain φ ² 汉\u0301"
    assert printable("\x1b[0m\x9b\u202e\udcff\U000e0041\n", keep="\n") == "\\x1b[0m\\x9b\\u202e\\udcff\\U000e0041\n"
    assert one_line(" a \n\t b\r ") == "a b"
    assert approximate("10⁻⁶·°", "latin-1") == "10??·°"
    with pytest.raises(UnicodeDecodeError):
        b"\xff".decode("ascii", APPROXIMATE)


def command(words, **settings):
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_", "SHADOWJAX_"))}
    environment = {**kept, "PYTHONPATH": str(ROOT), "JAX_COMPILATION_CACHE_DIR": str(ROOT / ".jax_cache")}
    environment |= settings.pop("environment", {})
    return subprocess.run(
        [sys.executable, "-m", "shadowjax", *words], env=environment, check=False, timeout=300, **settings
    )


def test_an_ascii_terminal_and_a_name_that_steers_it(tmp_path):
    """The picture is written, the code is 0, and no byte of the name reaches the screen as it is."""
    mesh, target = tmp_path / NASTY.replace("\udcff", ""), tmp_path / "x.png"
    mesh.write_text("v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\nv 1 1.5 1\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n")
    size = ["--width", "16", "--height", "12", "--resolution", "16", "--samples", "1", "--caster", "brute"]
    words = ["render", str(mesh), "-o", str(target), "--technique", "hard", *size]
    done = command(words, capture_output=True, environment={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    with Image.open(target) as picture:
        assert picture.size == (16, 12)
    assert b"16 x 12" in done.stdout
    for written in (done.stdout, done.stderr):
        assert written.isascii()
        assert b"\x1b" not in written


def test_names_that_steer_a_screen_are_spelled_out(tmp_path, capsys):
    missing = tmp_path / NASTY
    for words in (
        ["render", str(missing), "-o", str(tmp_path / "x.png")],
        ["scenes", "--json", str(missing / "below" / ("x" * 300))],
        ["optimize", "splits", "--config", str(missing)],
        ["render", "cubes", "-o", str(missing)],
        ["render", "cubes", "--technique", NASTY, "-o", str(tmp_path / "x.png")],
        ["render", "cubes", "--light", NASTY],
        ["render", "cubes", "--width", NASTY],
        ["report", "cubes", "--equations", NASTY, "--out", str(tmp_path)],
        ["compare", "cubes", "--techniques", "hard", NASTY],
        ["verify", "--only", NASTY],
        ["presets", NASTY],
        ["optimize", NASTY],
        [NASTY],
        ["scenes", f"--{NASTY}"],
    ):
        assert main(words) == 2, words
        out, err = capsys.readouterr()
        assert out == ""
        assert err.endswith("\n")
        assert err[:-1].isprintable(), words


@pytest.mark.skipif(os.name != "posix", reason="closes descriptors by the shell")
def test_closed_streams_and_a_reader_that_goes_away():
    line = f"{sys.executable} -m shadowjax"
    for shell, code in (
        (f"{line} scenes >&- 2>&- <&-", 0),
        (f"{line} scenes > /dev/full", 2),
        (f"{line} --version", 0),
    ):
        done = subprocess.run(shell, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == code
        assert "Traceback" not in done.stderr
        assert done.stderr.count("\n") == (code == 2)
    gone = f"({line} scenes; echo $? >&2) | true"
    done = subprocess.run(gone, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("", "0\n")


def test_the_version_is_quick(capsys):
    from shadowjax import __version__

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"shadowjax {__version__}\n"
