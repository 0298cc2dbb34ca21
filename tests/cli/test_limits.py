"""Every numeric option of every command has limits, and what is outside them is refused before anything is loaded."""

import dataclasses
import math
import sys
import typing

import pytest

from shadowjax.cli import commands
from shadowjax.cli.main import COMMANDS, main
from shadowjax.cli.options import Limits, limits_of


def atoms(hint):
    """The plain types that a type is made of, with repetitions."""
    parts = typing.get_args(hint)
    return [one for part in parts for one in atoms(part)] if parts else [hint]


def numeric_options(command):
    """Flag, limits, how many numbers it takes, and whether they are whole."""
    found = []
    hints, limits = typing.get_type_hints(command), limits_of(command)
    for item in dataclasses.fields(command):
        numbers = [one for one in atoms(hints[item.name]) if one in (int, float)]
        if dataclasses.is_dataclass(hints[item.name]):
            found += numeric_options(hints[item.name])
        elif numbers:
            found.append(("--" + item.name.replace("_", "-"), limits.get(item.name), len(numbers), int in numbers))
    return found


@pytest.fixture(autouse=True)
def nothing_runs(monkeypatch):
    def run(_):
        raise AssertionError("a command was started")

    monkeypatch.setattr(commands, "run", run)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_numbers_outside_their_limits_are_refused_with_the_limits(name, capsys):
    for flag, limits, count, whole in numeric_options(COMMANDS[name]):
        assert isinstance(limits, Limits), f"{flag} of {name} has no limits"
        for value in ["99999999999999999999", "-1e20" if whole is False else "-99999999999999999999"]:
            words = [*name.split(), flag, *["1"] * (count - 1), value]
            assert main(words) == 2, words
            out, err = capsys.readouterr()
            assert out == ""
            assert err.startswith(f"shadowjax: {flag} must lie in {limits}; got "), words


def test_what_is_no_number_is_refused(capsys):
    for name, flag, value in [
        *(("render", "--width", value) for value in ("1e3", "1.5", "0x10", "wide", "9" * 5000, "1 2", "--", "[/red]")),
        *(("optimize splits", "--near", value) for value in ("wide", "1 2", "--", "nan", "inf", "-inf", "1e400")),
    ]:
        assert main([*name.split(), flag, value]) == 2, (flag, value)
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert flag in err


def test_ends_of_limits_are_exact():
    closed, between = Limits(-90, 90), Limits(0, 90, strictly=True)
    assert all(value in closed for value in (-90, 0, 90))
    assert all(value not in closed for value in (math.nextafter(90, math.inf), -91, math.nan, math.inf, 10**400))
    assert all(value not in between for value in (0, 90, math.nan, -math.inf))
    assert math.nextafter(90, 0) in between


def test_every_number_is_seen():
    """The search for numeric options finds those that are known to be there."""
    flags = {flag for command in COMMANDS.values() for flag, *_ in numeric_options(command)}
    assert {"--width", "--samples", "--light-position", "--phi-deg", "--seam-limit", "--steps", "--near"} <= flags
    assert str(Limits(1, 16384)) == "[1, 16384]"
    assert str(Limits(0, 90, strictly=True)) == "(0, 90)"


def test_the_limits_hold_in_configuration_files_too(tmp_path, capsys):
    (tmp_path / "c.toml").write_text("width = 99999999999999999999\n")
    assert main(["render", "--config", str(tmp_path / "c.toml")]) == 2
    assert "--width must lie in [1, 16384]" in capsys.readouterr().err
    (tmp_path / "c.toml").write_text("technique = '--help'\n")
    assert main(["render", "--config", str(tmp_path / "c.toml")]) == 2
    assert "reads as a flag" in capsys.readouterr().err
    assert sys.modules["shadowjax.cli.commands"] is commands
