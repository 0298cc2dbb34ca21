"""The registry of techniques by name."""

import difflib
from collections.abc import Callable
from typing import Any

from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.filters.base import Filter
from shadowjax.filters.brabec_seidel import PropagatedNeighbours, Supersampled
from shadowjax.filters.convolution import Convolution, MeanDepthConvolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.hard import Hard
from shadowjax.filters.hierarchical_minimum import HierarchicalMinimum
from shadowjax.filters.moment import Moments
from shadowjax.filters.multi_depth import MultiDepth, Neighbourhood, Ring
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.filters.pcss import ContactHardening
from shadowjax.filters.variance import Variance
from shadowjax.partitions.base import Partition
from shadowjax.partitions.cube import CubeMap
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.caster import Caster
from shadowjax.techniques.adaptive import AdaptiveShadowMapping
from shadowjax.techniques.base import Technique
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.techniques.shadow_volumes import ShadowVolumes


def _mapping(
    filter_: Callable[[], Filter],
    layer: str = "first",
    partition: Callable[[], Partition] = SingleMap,
    coverage: bool = False,
) -> Callable[..., Technique]:
    def make(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
        caster = BruteForceCaster() if caster is None else caster
        fields = {"layer": layer, "partition": partition(), "coverage": coverage, **options}
        return ShadowMapping(filter_(), resolution, caster=caster, **fields)

    return make


def _exact(resolution: int = 512, caster: Caster | None = None) -> Technique:
    del resolution  # the exact test has no map
    return Exact(BruteForceCaster() if caster is None else caster)


def _volumes(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    del resolution, caster  # volumes have no map and cast no ray
    return ShadowVolumes(**options)


def _adaptive(resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    # As many bytes as a plain map of that resolution has, but never less than a few of the smallest tiles.
    size = min(16, max(4, 1 << max(0, resolution.bit_length() - 4)))
    caster = BruteForceCaster() if caster is None else caster
    chosen = {"budget_bytes": max(4 * resolution**2, 1024), "tile_size": size, **options}
    return AdaptiveShadowMapping(caster=caster, **chosen)


TECHNIQUES: dict[str, Callable[..., Technique]] = {
    "exact": _exact,
    "hard": _mapping(Hard),
    "asm": _adaptive,
    "pcf-2x2": _mapping(lambda: PercentageCloser(2)),
    "pcf-3x3": _mapping(lambda: PercentageCloser(3)),
    "pcf-4x4": _mapping(lambda: PercentageCloser(4)),
    "pcf-bilinear": _mapping(lambda: BilinearPercentageCloser(1)),
    "pcf-bilinear-3x3": _mapping(lambda: BilinearPercentageCloser(3)),
    "pcss": _mapping(ContactHardening),
    "second-depth": _mapping(Hard, "second"),
    "midpoint-depth": _mapping(Hard, "midpoint"),
    "brabec-seidel": _mapping(Supersampled),
    "brabec-seidel-propagated": _mapping(lambda: MultiDepth(PropagatedNeighbours())),
    "hyper-z": _mapping(lambda: MultiDepth(HierarchicalMinimum())),
    "vsm": _mapping(lambda: Variance(bleed_low=0.2)),
    # Six maps where a light is a point, since one around it would bend outlines; one for a directional light.
    "vsm+coverage": _mapping(lambda: Variance(bleed_low=0.2, footprint=0.0), partition=CubeMap, coverage=True),
    "esm": _mapping(Exponential),
    "esm-threshold": _mapping(lambda: Exponential(fallback="threshold")),
    "esm-z-max": _mapping(lambda: Exponential(fallback="z-max")),
    "evsm2": _mapping(lambda: ExponentialVariance(negative=None)),
    "evsm4": _mapping(ExponentialVariance),
    "msm-hamburger": _mapping(Moments),
    "msm-hausdorff": _mapping(lambda: Moments(problem="hausdorff")),
    "csm": _mapping(Convolution),
    "xcsm": _mapping(MeanDepthConvolution),
    "2sm-max": _mapping(lambda: MultiDepth(Neighbourhood("max"))),
    "2sm-min": _mapping(lambda: MultiDepth(Neighbourhood("min"))),
    "3sm": _mapping(lambda: MultiDepth(Neighbourhood("min-max"))),
    "4sm": _mapping(lambda: MultiDepth(Ring(4))),
    "5sm": _mapping(lambda: MultiDepth(Ring(5))),
    "2sm-max+pcf-2x2": _mapping(lambda: MultiDepth(Neighbourhood("max"), 2)),
    "2sm-max+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("max"), 3)),
    "2sm-min+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("min"), 3)),
    "3sm+pcf-2x2": _mapping(lambda: MultiDepth(Neighbourhood("min-max"), 2)),
    "3sm+pcf-3x3": _mapping(lambda: MultiDepth(Neighbourhood("min-max"), 3)),
    "4sm+pcf-3x3": _mapping(lambda: MultiDepth(Ring(4), 3)),
    "shadow-volumes": _volumes,
    "cube": _mapping(Hard, partition=CubeMap),
    "cube+pcf-3x3": _mapping(lambda: PercentageCloser(3), partition=CubeMap),
}


@checked
def make_technique(name: str, resolution: int = 512, caster: Caster | None = None, **options: Any) -> Technique:
    """A technique by its registered name.

    Args:
        name: A key of `TECHNIQUES`.
        resolution: Texels along each side of a map.
        caster: Traces all rays; brute force if None.
        options: Further fields of `ShadowMapping` (partition, bias) or of `ShadowVolumes` (method, casters, stencil).

    Raises:
        ValueError: If the name is unknown; the nearest names are suggested.
    """
    if name not in TECHNIQUES:
        near = difflib.get_close_matches(name, TECHNIQUES, n=3, cutoff=0.4) or sorted(TECHNIQUES)
        require(False, f"unknown technique {name!r}; did you mean {', '.join(near)}? `TECHNIQUES` lists all")
    return TECHNIQUES[name](resolution=resolution, caster=caster, **options)
