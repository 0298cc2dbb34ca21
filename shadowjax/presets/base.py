"""What a preset is: an engine's published parameters, where they came from, and the technique they make here."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from shadowjax._checked import checked
from shadowjax._checks import require_choice
from shadowjax.rays.caster import Caster
from shadowjax.techniques.base import Technique

UNITS = (
    "", "texels", "world units", "texels along the normal", "texels of slope", "NDC", "of the range",
    "per unit of depth",
)  # fmt: skip
Value = float | int | str | tuple[float, ...]


@checked
@dataclass(frozen=True)
class Parameter:
    """One number (or word) of an engine.

    Attributes:
        name: The field's common name for it.
        value: As the engine has it.
        unit: One of `UNITS`; "" for a pure number or a word.
        verified: Whether it was read in the engine's code or documents. False: recalled, check before quoting.
        here: What it became in this package, or why it has no counterpart.
    """

    name: str
    value: Value
    unit: str = ""
    verified: bool = True
    here: str = ""

    def __post_init__(self) -> None:
        require_choice(self.unit, "unit of a parameter", UNITS)


@checked
@dataclass(frozen=True)
class Preset:
    """An engine's way to shadow a scene.

    Attributes:
        name: Kebab-case name.
        engine: Whose it is.
        description: One line for people.
        parameters: What it is made of.
        missing: What the engine also does and this package has no counterpart for.
        make: From a resolution and a caster to the technique.
        resolution: The engine's own, texels along a side of each map.
    """

    name: str
    engine: str
    description: str
    parameters: tuple[Parameter, ...]
    missing: tuple[str, ...]
    make: Callable[[int, Caster], Technique]
    resolution: int

    def __getitem__(self, name: str) -> Value:
        """The value of a parameter by name."""
        return next(one.value for one in self.parameters if one.name == name)

    def to_json(self) -> dict[str, Any]:
        """Everything but the maker, as plain values."""
        return {
            "name": self.name,
            "engine": self.engine,
            "description": self.description,
            "resolution": self.resolution,
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "no_counterpart": list(self.missing),
        }
