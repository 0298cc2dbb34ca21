"""The registries that names of techniques are made of, and the techniques that are compared by default."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from shadowjax._registry import Entry, Registry
from shadowjax.filters.registry import DEPTH_POLICIES, FILTERS
from shadowjax.partitions.registry import PARTITIONS
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.techniques.adaptive import AdaptiveShadowMapping
from shadowjax.techniques.base import Technique
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_volumes import ShadowVolumes
from shadowjax.warps.registry import WARP_FITS


def _exact(resolution: int = 512, caster: Caster | None = None) -> Technique:
    del resolution  # the exact test has no map
    return Exact(default_caster() if caster is None else caster)


def _volumes(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    del resolution, caster  # volumes have no map and cast no ray
    return ShadowVolumes(**options)


def _adaptive(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    # As many bytes as a plain map of that resolution has, but never less than a few of the smallest tiles.
    size = min(16, max(4, 1 << max(0, resolution.bit_length() - 4)))
    chosen = {"budget_bytes": max(4 * resolution**2, 1024), "tile_size": size, **options}
    return AdaptiveShadowMapping(caster=default_caster() if caster is None else caster, **chosen)


# Techniques without shadow maps: names that stand alone.
ALONE: Registry[Technique] = Registry("technique", {
    "exact": Entry(_exact, "a shadow ray for every point: the reference"),
    "shadow-volumes": Entry(_volumes, "stencil counts of the walls of shadow volumes"),
})  # fmt: skip
# A partition that is a technique of its own: it tests depths in tiles that it chooses by itself.
TILES: Registry[Technique] = Registry("partition", {
    "asm": Entry(_adaptive, "adaptive tiles, finest at the shadow edges seen"),
})  # fmt: skip
LAYER_DEPTHS: Registry[str] = Registry("depths", {
    "second-depth": Entry(lambda: "second", "the second surface of every ray"),
    "back-depth": Entry(lambda: "back", "the first surface met from behind"),
    "midpoint-depth": Entry(lambda: "midpoint", "between the first surface and the second"),
})  # fmt: skip
OPTIONS: Registry[Mapping[str, Any]] = Registry("option", {
    "coverage": Entry(lambda: {"coverage": True}, "a gradient where outlines move"),
})  # fmt: skip

# Kinds of tokens in the order of a name, each with its registries; no token is in two.
TOKEN_KINDS: Mapping[str, tuple[Registry[Any], ...]] = MappingProxyType({
    "partition": (PARTITIONS, TILES),
    "warp": (WARP_FITS,),
    "depths": (DEPTH_POLICIES, LAYER_DEPTHS),
    "filter": (FILTERS,),
    "option": (OPTIONS,),
})  # fmt: skip

# What is compared by default: each filter and each choice of depths by itself, and combinations that are published.
COMBINED = (
    "2sm-max+pcf-2x2", "2sm-max+pcf-3x3", "2sm-min+pcf-3x3", "3sm+pcf-2x2", "3sm+pcf-3x3", "4sm+pcf-3x3",
    "vsm+coverage", "asm", "cube", "cube+pcf-3x3",
)  # fmt: skip
TECHNIQUES: tuple[str, ...] = ("exact", *FILTERS, *LAYER_DEPTHS, *DEPTH_POLICIES, *COMBINED, "shadow-volumes")


__all__ = [
    "ALONE",
    "COMBINED",
    "LAYER_DEPTHS",
    "OPTIONS",
    "TECHNIQUES",
    "TILES",
    "TOKEN_KINDS",
]  # fmt: skip
