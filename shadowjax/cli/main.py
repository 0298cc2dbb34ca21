"""Entry point: reads flags and TOML into options, runs the command, and turns errors into one line and an exit code."""

import contextlib
import dataclasses
import difflib
import io
import re
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import tyro

from shadowjax import __version__
from shadowjax._process import BAD_INPUT, DONE, exit_code
from shadowjax.cli import options

COMMANDS: Mapping[str, type] = {
    "report": options.Report,
    "render": options.Render,
    "compare": options.Compare,
    "verify": options.Verify,
    "optimize near-distance": options.NearDistance,
    "optimize splits": options.Splits,
    "optimize bias": options.BiasSearch,
    "optimize exponent": options.ExponentSearch,
    "optimize taps": options.TapsSearch,
    "scenes": options.Scenes,
    "techniques": options.Techniques,
    "presets": options.Presets,
    "experiments": options.Experiments,
}

PROGRAM = "shadowjax"

_Options = TypeVar("_Options")


class BadInput(ValueError):
    """Something the user gave cannot be used; the message says what to do."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: Words after the program's name; those of the process if None.

    Returns:
        0 done, 1 a claim or an equation failed, 2 bad input or a file that cannot be read or written, 130 interrupted.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    return exit_code(PROGRAM, lambda: _run(words), "lower --resolution, --width, --height or --samples")


def _run(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help"):
        print(_help())
        return DONE if words else BAD_INPUT
    if words[0] == "--version":
        print(f"{PROGRAM} {__version__}")
        return DONE
    name, rest = _command(words)
    parsed = parse(COMMANDS[name], name, rest)
    if parsed is None:
        return DONE
    options.check_limits(parsed)
    from shadowjax.cli import commands

    return commands.run(parsed)


def _help() -> str:
    """The commands and what they do, as wide as the terminal."""
    width = max(map(len, COMMANDS))
    room = max(shutil.get_terminal_size((120, 24)).columns, width + 20)
    lines = [(f"  {name:<{width}}  ", (command.__doc__ or "").split("\n")[0]) for name, command in COMMANDS.items()]
    notes = [
        "SCENE is a built-in scene or a mesh file (OBJ, PLY, STL, GLB, ...).",
        "Exit codes: 0 done, 1 a claim or an equation failed, 2 bad input, 130 interrupted.",
        "`shadowjax COMMAND --help` lists the options of a command; `shadowjax --version` prints the version.",
    ]
    return "\n".join(
        [
            "usage: shadowjax COMMAND [SCENE] [options]",
            "",
            *(textwrap.fill(start + does, room, subsequent_indent=" " * len(start)) for start, does in lines),
            "",
            *(textwrap.fill(note, room) for note in notes),
        ]
    )


def _command(words: list[str]) -> tuple[str, list[str]]:
    """Name of the command, one word or two, and the words after it."""
    for length in (2, 1):
        name = " ".join(words[:length])
        if name in COMMANDS:
            return name, words[length:]
    group = [name for name in COMMANDS if name.split()[0] == words[0]]
    if group:
        raise BadInput(f"{words[0]} needs one of {', '.join(name.split()[1] for name in group)}")
    near = difflib.get_close_matches(words[0], COMMANDS, n=2)
    hint = f"did you mean {' or '.join(near)}?" if near else f"the commands are {', '.join(COMMANDS)}"
    raise BadInput(f"unknown command {words[0]!r}; {hint}")


def parse(kind: type[_Options], name: str, words: Sequence[str]) -> _Options | None:
    """Options of a command from flags, over those of the TOML file that `--config` names.

    Args:
        kind: Dataclass of the command.
        name: Of the command.
        words: Flags.

    Returns:
        The options; None where help was asked for and shown.

    Raises:
        BadInput: If a flag or a key is unknown or has a value that does not fit.
    """
    given = _tyro(kind, name, words, None)
    path = getattr(getattr(given, "search", given), "config", None)
    if given is None or path is None or kind is options.Experiments:  # whose settings are not options
        return given
    try:
        base = _tyro(kind, name, _flags_of(path, kind), None)
    except BadInput as error:
        raise BadInput(f"{path}: {str(error).split('; see ')[0]}") from error
    return _tyro(kind, name, words, base)


def _tyro(kind: type[_Options], name: str, words: Sequence[str], default: _Options | None) -> _Options | None:
    """Parse with tyro; its boxes on standard error become one line."""
    prog, stream = f"shadowjax {name}", io.StringIO()
    extra: dict[str, Any] = {} if default is None else {"default": default}
    try:
        with contextlib.redirect_stderr(stream):
            return tyro.cli(kind, prog=prog, args=list(words), **extra)
    except SystemExit as stop:
        if stop.code in (None, 0):
            return None
        raise BadInput(f"{_plain(stream.getvalue())}; see `{prog} --help`") from None


def _plain(box: str) -> str:
    """The message of an error box: its first paragraph below the title, without frame, on one line."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip().strip("│").strip() for line in plain.splitlines() if not line.lstrip().startswith(("╭", "╰"))]
    paragraphs = [""]
    for line in lines:
        if line and line.strip("─-"):
            paragraphs[-1] = f"{paragraphs[-1]} {line}".strip()
        elif paragraphs[-1]:
            paragraphs.append("")
    # Where the terminal has no lines to draw with, the title is a paragraph instead of a part of the frame.
    chosen = paragraphs if "╭" in plain else paragraphs[1:]
    return next(iter(chosen), "").rstrip(".") or "the command line cannot be read"


def _flags_of(path: str, kind: type) -> list[str]:
    """The keys of a TOML file as flags of a command; its quick table for tests is left aside."""
    from shadowjax.io import read_toml

    known = _names(kind)
    words, positional = [], []
    for key, value in read_toml(path).items():
        if key == "quick" and isinstance(value, dict):
            continue
        if key not in known or key == "config":
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"the options are {', '.join(sorted(known))}"
            raise BadInput(f"unknown option {key!r}; {hint}")
        flag = "--" + key.replace("_", "-")
        if isinstance(value, dict) and key == "techniques":
            # A table of names of one's own: as `--techniques LABEL=NAME`.
            wrong = [label for label, name in value.items() if not isinstance(name, str)]
            if wrong or not value:
                raise BadInput("the table [techniques] needs lines such as ours = 'z4+minimax+evsm4'")
            value = [f"{label}={name}" for label, name in value.items()]
        if isinstance(value, dict):
            raise BadInput(f"option {key!r} must be a value, not a table")
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, str) and one.startswith("-") and one != "-":
                raise BadInput(f"option {key!r} has the value {one!r}, which reads as a flag")
        if key == "scene":
            positional.append(str(value))
        elif isinstance(value, bool):
            words.append(flag if value else flag.replace("--", "--no-", 1))
        elif isinstance(value, list):
            words += [flag, *map(str, value)]
        else:
            words += [flag, str(value)]
    return [*positional, *words]


def _names(kind: type) -> set[str]:
    """Names of all options of a command, those of nested groups included."""
    names: set[str] = set()
    for item in dataclasses.fields(kind):
        made = item.default_factory() if item.default_factory is not dataclasses.MISSING else None
        names |= _names(type(made)) if dataclasses.is_dataclass(made) else {item.name}
    return names
