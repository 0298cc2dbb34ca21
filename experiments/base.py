"""What an experiment is: a config, a run, claims about its result, the numbers behind them, and a drawing."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from shadowjax.plotting.animation import Frame


@dataclass(frozen=True)
class Claim:
    """A statement about a result that is true or false.

    Attributes:
        name: The statement, in words.
        holds: Whether it is true of this result.
        value: What was measured, as text.
        expected: What the statement asks for, as text.
        timed: Whether it rests on a clock. A quick run is too short to judge such a claim: it reports it and goes on.
    """

    name: str
    holds: bool
    value: str
    expected: str
    timed: bool = False


class Unsuitable(ValueError):
    """A config that turns out while running to describe nothing to measure; the message says what to change."""


class Experiment(Protocol):
    """What every module of the registry offers; its docstring says what is shown and how to read it.

    A module may also have `animate(result) -> list of figures or RGB arrays`, of one size: NAME.gif is made of them.
    """

    @property
    def __name__(self) -> str:
        """Name of the module; its last part is the name of the experiment."""
        ...

    @property
    def Config(self) -> type[Any]:
        """Frozen dataclass of plain values, one to one with a TOML file; its defaults are that file's values."""
        ...

    @property
    def run(self) -> Any:
        """`run(config) -> result`: all the work, no drawing; deterministic but for times."""
        ...

    @property
    def claims(self) -> Any:
        """`claims(result) -> tuple[Claim, ...]`."""
        ...

    @property
    def numbers(self) -> Any:
        """`numbers(result) -> dict`: what the figure shows, as plain values."""
        ...

    @property
    def draw(self) -> Any:
        """`draw(result) -> Figure`."""
        ...


@dataclass(frozen=True)
class Outcome:
    """What became of one experiment.

    Attributes:
        name: Of the experiment.
        config: What it ran with.
        claims: What holds and what does not.
        numbers: Plain values behind the figure.
        figure: The drawing.
        quick: Whether the config was the quick one.
        frames: Of the animation; none if the experiment has none.
    """

    name: str
    config: Any
    claims: tuple[Claim, ...]
    numbers: dict[str, Any]
    figure: Figure
    quick: bool = False
    frames: tuple[Frame, ...] = ()

    @property
    def judged(self) -> tuple[Claim, ...]:
        """The claims that decide: all, but for those that rest on a clock in a quick run."""
        return tuple(claim for claim in self.claims if not (self.quick and claim.timed))

    @property
    def passed(self) -> bool:
        """Whether all judged claims hold."""
        return all(claim.holds for claim in self.judged)

    def record(self) -> dict[str, Any]:
        """Config, claims and numbers as JSON knows them."""
        return plain({"experiment": self.name, "config": self.config, "claims": self.claims, "numbers": self.numbers})


def perform(name: str, experiment: Experiment, config: Any, quick: bool = False) -> Outcome:
    """Run an experiment, judge its claims, draw it, and animate it if it knows how."""
    result = experiment.run(config)
    claims, numbers, figure = experiment.claims(result), experiment.numbers(result), experiment.draw(result)
    animate = getattr(experiment, "animate", None)
    return Outcome(name, config, claims, numbers, figure, quick, () if animate is None else tuple(animate(result)))


def plain(value: Any) -> Any:
    """Dataclasses, arrays, tuples and NumPy numbers as what JSON knows; floats keep nine digits."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.9g}")
    return value
