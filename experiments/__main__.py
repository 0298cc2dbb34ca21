"""Command line: `python -m experiments NAME | all [--quick] [--config FILE] [--out DIR]`."""

# Light imports only: what an experiment needs is loaded when it is known which one is asked for.

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from experiments import EXPERIMENTS, find
from shadowjax import _process
from shadowjax._printable import printable

if TYPE_CHECKING:
    from experiments import Outcome

PROGRAM = "experiments"


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line as every other bad input is: one line."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; `python -m experiments --help` shows the usage")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m experiments",
        description="Run figures and tables of the sources; write NAME.png and NAME.json, NAME.gif where something "
        "moves, and judge their claims.",
        epilog="Exit codes: 0 all claims hold, 1 a claim failed, 2 bad input, 130 interrupted. Experiments: "
        + ", ".join(EXPERIMENTS),
    )
    parser.add_argument("name", metavar="NAME", help="an experiment, or `all`")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="use the [quick] table of the config: seconds each; claims that rest on times are told, not judged",
    )
    parser.add_argument("--config", type=Path, help="a TOML file in place of configs/NAME.toml")
    parser.add_argument("--out", type=Path, default=Path("out/experiments"), help="folder to write into")
    return parser


def _save(outcome: "Outcome", folder: Path) -> Path:
    from shadowjax.io import json_text, write_files
    from shadowjax.plotting import figure_png, gif_bytes

    picture = folder / f"{outcome.name}.png"
    files: dict[str | Path, bytes] = {picture: figure_png(outcome.figure)}
    files[folder / f"{outcome.name}.json"] = json_text(outcome.record()).encode()
    if outcome.frames:
        files[folder / f"{outcome.name}.gif"] = gif_bytes(outcome.frames)
    write_files(files)
    return picture


def _tell(outcome: "Outcome", seconds: float, picture: Path) -> None:
    print(f"{outcome.name}: {seconds:.1f} s → {printable(str(picture))}")
    for claim in outcome.claims:
        verdict = ("holds" if claim.holds else "FAILS") if claim in outcome.judged else "timed"
        print(f"  {verdict}  {claim.name}: {claim.value} (expected {claim.expected})")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit code."""
    return _process.exit_code(PROGRAM, lambda: run(arguments), "ask for smaller pictures and maps in a --config file")


def run(arguments: Sequence[str] | None = None) -> int:
    """As `main`, but what goes wrong is raised.

    Raises:
        ValueError: If there is no such experiment, or its settings cannot be used.
    """
    asked = _parser().parse_args(arguments)
    if asked.config is not None and asked.name == "all":
        raise ValueError("--config belongs to one experiment; give its NAME")
    chosen = {name: find(name) for name in (EXPERIMENTS if asked.name == "all" else [asked.name])}
    from experiments import default_path, perform, read_config
    from shadowjax.io import check_output, output_folder

    configs = {
        name: read_config(experiment.Config, asked.config or default_path(name), asked.quick)
        for name, experiment in chosen.items()
    }
    folder = output_folder(asked.out)
    for name in chosen:
        for kind in ("png", "json", "gif"):
            check_output(folder / f"{name}.{kind}")
    passed = True
    for name, experiment in chosen.items():
        start = time.perf_counter()
        outcome = perform(name, experiment, configs[name], asked.quick)
        _tell(outcome, time.perf_counter() - start, _save(outcome, folder))
        passed &= outcome.passed
    return _process.DONE if passed else _process.FAILED


if __name__ == "__main__":
    _process.run(PROGRAM, main)
