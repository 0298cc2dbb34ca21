"""Command line: `python -m experiments NAME | all [--quick] [--config FILE] [--out DIR]`."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from experiments import EXPERIMENTS, Outcome, Unsuitable, default_path, find, perform, read_config
from shadowjax._checks import require
from shadowjax.io import output_folder, write_bytes, write_json
from shadowjax.plotting import figure_png, gif_bytes

DONE, CLAIM_FAILED, BAD_INPUT = 0, 1, 2


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line as every other bad input is: one line."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; `python -m experiments --help` shows the usage")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m experiments",
        description="Run figures and tables of the sources; write NAME.png and NAME.json, NAME.gif where something "
        "moves, and judge their claims.",
        epilog="Exit codes: 0 all claims hold, 1 a claim failed, 2 bad input. Experiments: " + ", ".join(EXPERIMENTS),
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


def _save(outcome: Outcome, folder: Path) -> Path:
    picture = write_bytes(folder / f"{outcome.name}.png", figure_png(outcome.figure))
    write_json(folder / f"{outcome.name}.json", outcome.record())
    if outcome.frames:
        write_bytes(folder / f"{outcome.name}.gif", gif_bytes(outcome.frames))
    return picture


def _tell(outcome: Outcome, seconds: float, picture: Path) -> None:
    print(f"{outcome.name}: {seconds:.1f} s → {picture}")
    for claim in outcome.claims:
        verdict = ("holds" if claim.holds else "FAILS") if claim in outcome.judged else "timed"
        print(f"  {verdict}  {claim.name}: {claim.value} (expected {claim.expected})")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit code."""
    try:
        asked = _parser().parse_args(arguments)
        require(asked.config is None or asked.name != "all", "--config belongs to one experiment; give its NAME")
        names = list(EXPERIMENTS) if asked.name == "all" else [asked.name]
        chosen = {name: find(name) for name in names}
        configs = {
            name: read_config(experiment.Config, asked.config or default_path(name), asked.quick)
            for name, experiment in chosen.items()
        }
        folder = output_folder(asked.out)
    except ValueError as error:
        return _complain(error)
    passed = True
    for name, experiment in chosen.items():
        start = time.perf_counter()
        try:
            outcome = perform(name, experiment, configs[name], asked.quick)
        except Unsuitable as error:
            return _complain(error)
        _tell(outcome, time.perf_counter() - start, _save(outcome, folder))
        passed &= outcome.passed
    return DONE if passed else CLAIM_FAILED


def _complain(error: ValueError) -> int:
    print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
    return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
