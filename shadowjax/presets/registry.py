"""The registry of presets by name."""

import difflib

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.presets import engines
from shadowjax.presets.base import Parameter, Preset
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.techniques.base import Technique

PRESETS: dict[str, Preset] = {preset.name: preset for preset in engines.ALL}


@checked
def preset(name: str) -> Preset:
    """The preset of that name.

    Raises:
        ValueError: If there is none; the nearest names are suggested.
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(str(name).lower(), PRESETS, n=3, cutoff=0.4)
        near = near or [known for known in PRESETS if known.split("-")[0] in str(name).lower()]
        hint = f"did you mean {', '.join(near)}?" if near else f"the presets are {', '.join(PRESETS)}"
        require(False, f"no preset is called {name!r}; {hint}")
    return PRESETS[name]


@checked
def make_preset(name: str, resolution: int | None = None, caster: Caster | None = None) -> Technique:
    """The technique of a preset.

    Args:
        name: A key of `PRESETS`.
        resolution: Texels along each side of a map; the engine's own if None.
        caster: Traces all rays; the fastest if None.

    Raises:
        ValueError: If the name is unknown; the nearest names are suggested.
    """
    chosen = preset(name)
    size = chosen.resolution if resolution is None else resolution
    return chosen.make(size, default_caster() if caster is None else caster)


__all__ = ["PRESETS", "Parameter", "Preset", "make_preset", "preset"]
