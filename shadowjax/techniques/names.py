"""Names of techniques: tokens of partition, warp, depths, filter and option joined by `+`, in any order.

`z4+minimax+evsm4` is four slices, each under a minimax warp, read by four exponential moments. What is left out is one
map of uniform texels, the first depth of every ray, and one depth test; slices left without a warp take the minimax
one, and coverage without a partition and a warp takes a cube of maps where the light is a point.
"""

import difflib
from collections.abc import Iterable
from typing import Any, NamedTuple

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax._registry import Registry
from shadowjax.filters.base import Filter
from shadowjax.filters.registry import DEPTH_POLICIES, FILTERS, over_depths
from shadowjax.partitions.base import Partition
from shadowjax.partitions.registry import PARTITIONS
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.techniques.base import Technique
from shadowjax.techniques.registry import ALONE, LAYER_DEPTHS, OPTIONS, TILES, TOKEN_KINDS
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.warps.registry import WARP_FITS


class TokenRow(NamedTuple):
    """A token and what it costs; None for what the token does not decide.

    Attributes:
        kind: Key of `TOKEN_KINDS`, or "technique" for a name that stands alone.
        token: As in a name.
        planes: Numbers stored for each texel.
        fetches: Depths or numbers read for each receiver.
        maps: Maps cast for one light, at most.
        summary: A few words.
    """

    kind: str
    token: str
    planes: int | None
    fetches: int | None
    maps: int | None
    summary: str


@checked
def compose(name: str, resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    """The technique that tokens name.

    Args:
        name: Tokens joined by `+`, or "exact" or "shadow-volumes" alone.
        resolution: Texels along each side of a map.
        caster: Traces all rays; the fastest if None.
        options: Further fields of the technique, which win over the name's.

    Raises:
        ValueError: If a token is unknown, two are of one kind, or a combination makes no sense.
    """
    tokens = [token.strip() for token in name.split("+")]
    for token in tokens:
        if token in ALONE:
            require(len(tokens) == 1, f"{token} has no map, so it stands alone; got {name!r}")
            return ALONE[token](resolution=resolution, caster=caster, **options)
    found = _sorted(tokens, name)
    try:
        if found.get("partition") in TILES:
            return _tiles(found, resolution, caster, options)
        fields = {**_fields(found), **options}
        return ShadowMapping(resolution=resolution, caster=default_caster() if caster is None else caster, **fields)
    except ValueError as error:
        raise ValueError(f"{name!r} cannot be built: {error}") from error


def _sorted(tokens: list[str], name: str) -> dict[str, str]:
    """Tokens by kind."""
    found: dict[str, str] = {}
    for token in tokens:
        kind = _kind_of(token)
        if kind is None:
            what = f"technique {token!r}" if token == name else f"token {token!r} in {name!r}"
            raise ValueError(f"unknown {what}; {_hint(token)}")
        require(
            kind not in found,
            f"{name!r} has two tokens of one kind, {kind}: {found.get(kind)} and {token}; leave one of them out",
        )
        found[kind] = token
    return found


def _kind_of(token: str) -> str | None:
    return next((kind for kind, registries in TOKEN_KINDS.items() if any(token in one for one in registries)), None)


def _hint(token: str) -> str:
    """The nearest tokens, or where to find them."""
    if not token:
        return "tokens are joined by single plus signs"
    near = difflib.get_close_matches(token.lower(), token_names(), n=3, cutoff=0.5)
    listed = "`shadowjax techniques` lists the tokens"
    return f"did you mean {', '.join(near)}? {listed}" if near else listed


@checked
def token_names() -> list[str]:
    """Every token that can be typed, of families those of usual numbers."""
    return [name for _, registry in _registries() for name in registry]


def _registries() -> Iterable[tuple[str, Registry[Any]]]:
    """Every registry with its kind."""
    yield "technique", ALONE
    for kind, registries in TOKEN_KINDS.items():
        for one in registries:
            yield kind, one


def _fields(found: dict[str, str]) -> dict[str, Any]:
    """Fields of `ShadowMapping` for tokens by kind."""
    warp = WARP_FITS[found["warp"]]() if "warp" in found else None
    filter_: Filter = FILTERS[found.get("filter", "hard")]()
    depths, fields = found.get("depths"), dict[str, Any]()
    covered = "option" in found
    if covered:
        fields |= OPTIONS[found["option"]]()
        filter_ = filter_.for_coverage()
    if depths is not None and depths in DEPTH_POLICIES:
        filter_ = over_depths(DEPTH_POLICIES[depths](), filter_)
    elif depths is not None:
        fields["layer"] = LAYER_DEPTHS[depths]()
    # One map around a point light bends outlines, six do not; under parallel light the six are one.
    usual = "cube" if covered and warp is None else "single"
    partition: Partition = PARTITIONS[found.get("partition", usual)](warp=warp)
    return {"filter": filter_, "partition": partition, **fields}


def _tiles(found: dict[str, str], resolution: int, caster: Caster | None, options: dict[str, Any]) -> Technique:
    """The technique of tokens whose partition chooses its own tiles."""
    name = found["partition"]
    others = [token for kind, token in found.items() if kind != "partition" and token != "hard"]
    require(
        not others,
        f"the tiles of {name} are uniform and hold the first depth for one test; {', '.join(others)} cannot read them: "
        f"take {name} alone",
    )
    return TILES[name](resolution=resolution, caster=caster, **options)


@checked
def token_table() -> list[TokenRow]:
    """Every token with what it costs; of families, those of usual numbers."""
    return [
        TokenRow(kind, name, *_costs(registry, name), registry.summary_of(name))
        for kind, registry in _registries()
        for name in registry
    ]


@checked
def families() -> dict[str, tuple[int, int]]:
    """Tokens that hold a number, such as pcf-KxK, and the least and largest number of each."""
    return {
        key: (entry.least, entry.most)
        for _, registry in _registries()
        for key, entry in registry.entries.items()
        if key != key.lower()
    }


def _costs(registry: Registry[Any], name: str) -> tuple[int | None, int | None, int | None]:
    """Planes, fetches and maps that a token decides."""
    if registry is PARTITIONS:
        return None, None, PARTITIONS[name]().num_maps
    if registry is FILTERS or registry is DEPTH_POLICIES:
        technique = compose(name)
        return technique.num_planes, technique.num_fetches, None
    return None, None, None


__all__ = ["TokenRow", "compose", "families", "token_names", "token_table"]
