"""The one resolver: names, presets and objects become techniques, one or many."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.presets.registry import PRESETS, make_preset
from shadowjax.rays.caster import Caster
from shadowjax.techniques.base import Technique
from shadowjax.techniques.names import compose

PREFIX = "preset:"

# What is accepted wherever techniques are: a name or an object, several of them, or either by a name of one's own.
Techniques = str | Technique | Sequence[str | Technique] | Mapping[str, str | Technique]


@checked
def make_technique(name: str, resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    """A technique by name.

    Args:
        name: Tokens of partition, warp, depths, filter and option joined by `+`, in any order, such as
            "z4+minimax+evsm4" or "2sm-max+pcf-3x3"; or one of "exact", "shadow-volumes" and "preset:NAME".
            `shadowjax techniques` lists the tokens and `shadowjax presets` the presets.
        resolution: Texels along each side of a map, ≥ 1.
        caster: Traces all rays; the fastest if None.
        options: Further fields of `ShadowMapping` (bias, …), `ShadowVolumes` (method, casters, stencil) or
            `AdaptiveShadowMapping`, which win over the name's; none for presets.

    Raises:
        ValueError: If a token is unknown (the nearest are suggested), two are of one kind, or a combination makes no
            sense (the message says why).
    """
    if name.startswith(PREFIX):
        rest, plus, tokens = name.removeprefix(PREFIX).partition("+")
        require(not plus, f"a preset is whole and stands alone; got {name!r}: leave {tokens!r} out")
        require(not options, f"a preset has all its numbers; got {', '.join(options)}: change fields of its technique")
        return make_preset(rest, resolution, caster)
    require(name not in PRESETS, f"{name!r} is a preset: its name here is {PREFIX + name!r}")
    return compose(name, resolution, caster, **options)


@checked
def as_technique(technique: str | Technique, resolution: int = 512, caster: Caster | None = None) -> Technique:
    """A technique that is given by name or as an object; an object keeps its own resolution and caster.

    Raises:
        ValueError: As `make_technique`.
    """
    return make_technique(technique, resolution, caster) if isinstance(technique, str) else technique


@checked
def as_techniques(techniques: Techniques, resolution: int = 512, caster: Caster | None = None) -> dict[str, Technique]:
    """Techniques by name, in the order given.

    Args:
        techniques: A name or an object; several of them; or a mapping from names of one's own to either. Objects
            without a name are called after their parts.
        resolution: Texels along each side of a map, of those that are given by name.
        caster: Traces their rays; the fastest if None.

    Raises:
        ValueError: If there is none, one is given twice, or a name is wrong.
    """
    one = isinstance(techniques, str | Technique)
    pairs: list[tuple[str, str | Technique]]
    if isinstance(techniques, Mapping):
        pairs = list(techniques.items())
    else:
        given = [techniques] if one else list(techniques)
        names = [name if isinstance(name, str) else name.parts for name in given]
        pairs = list(zip(_numbered(names, given), given, strict=True))
    require(len(pairs) > 0, "give at least one technique; got none")
    listed = [name for name, _ in pairs]
    twice = sorted({name for name in listed if listed.count(name) > 1})
    require(not twice, f"give each technique once; got {', '.join(twice)} more than once")
    return {name: as_technique(technique, resolution, caster) for name, technique in pairs}


class Costs(NamedTuple):
    """What a technique costs, as its parts say; 0 where it has no map, None where that depends on the view.

    Attributes:
        planes: Numbers stored for each texel.
        fetches: Depths or numbers read for each receiver.
        maps: Maps cast for one light, at most.
        tones: Most distinct visibilities; None for a continuum.
        parts: What it is made of.
    """

    planes: int | None
    fetches: int | None
    maps: int | None
    tones: int | None
    parts: str


@checked
def costs(technique: str | Technique) -> Costs:
    """What a technique costs.

    Args:
        technique: An object, or any name that `make_technique` takes.

    Raises:
        ValueError: As `make_technique`.
    """
    made = as_technique(technique)
    return Costs(made.num_planes, made.num_fetches, made.num_maps, made.num_tones, made.parts)


def _numbered(names: list[str], given: list[str | Technique]) -> list[str]:
    """Names with a number behind those of objects that have none of their own and are alike."""
    made, seen = [], dict[str, int]()
    for name, one in zip(names, given, strict=True):
        seen[name] = seen.get(name, 0) + 1
        made.append(name if isinstance(one, str) or names.count(name) == 1 else f"{name} {seen[name]}")
    return made


__all__ = [
    "PREFIX", "Costs", "Techniques", "as_technique", "as_techniques", "costs", "make_technique",
]  # fmt: skip
