"""The presets: Filament, Godot 4, three.js, bgfx, DiligentFX, MJP's sample and bevy, as their code states them."""

from collections.abc import Callable
from typing import Any

from shadowjax.bias.kinds import BiasSum, BufferBias, NormalOffset, ReceiverPlane
from shadowjax.bias.rule import Bias, BiasRule
from shadowjax.filters.base import Filter
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.moment import Moments
from shadowjax.filters.pcf import BilinearPercentageCloser, PercentageCloser
from shadowjax.filters.variance import Variance
from shadowjax.partitions.base import Partition
from shadowjax.partitions.by_light import ByLight
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.presets.base import Parameter, Preset
from shadowjax.rays.caster import Caster
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.warps.fit import PerspectiveFit
from shadowjax.warps.stable import StableFit
from shadowjax.warps.uniform import UniformFit

SNAPPING = "maps that snap to texels as the camera moves"
HALF_PRECISION = "16-bit storage: maps here have the scene's own dtype"
SNAPPED = "StableFit: a square around each slice's sphere that moves by whole texels"
DISTANCE = "distance of Cascades, in the scene's own units: scale it with the scene"


def _maker(
    filter_: Filter, bias: Callable[[], BiasRule], partition: Partition | None = None
) -> Callable[[int, Caster], Technique]:
    """What makes a technique; its numbers become arrays then, not on import, when no device may be touched yet."""

    def make(resolution: int, caster: Caster) -> Technique:
        return ShadowMapping(filter_, resolution, SingleMap() if partition is None else partition, caster, bias())

    return make


def _stable(count: int, rule: str, choose: str = "depth", **options: Any) -> ByLight:
    """Slices of the whole view under maps that snap; a lamp gets one map."""
    return ByLight(Cascades(count, rule, warp=StableFit(), tight=False, choose=choose, **options))


def _mjp_slices() -> ByLight:
    """MJP's sample does not stabilise its cascades by default: each is as small as what it must hold."""
    slices = Cascades(4, "shares", warp=UniformFit(), tight=False, blend=0.1, shares_of_range=(0.05, 0.15, 0.5))
    return ByLight(slices)


_CONSTANT, _NORMAL = "constant bias", "normal bias"

FILAMENT_PARAMETERS = (
    Parameter("map size", 1024, "texels"),
    Parameter(_CONSTANT, 0.001, "world units", here="Bias in world units"),
    Parameter(_NORMAL, 1.0, "texels along the normal", here="NormalOffset, multiplied by the sine of incidence"),
    Parameter("polygon offset slope", 2.0, "", here="hardware's offset of the stored depth; not applied"),
    Parameter("cascades", 1, "", here="one map"),
    Parameter("warp", "LiSPSM", "", here="PerspectiveFit with the rule lispsm"),
    Parameter("near hint", 1.0, "world units", here="not used: depths are cut to what is seen"),
    Parameter("far hint", 100.0, "world units", here="not used: depths are cut to what is seen"),
)


def _filament_bias() -> BiasRule:
    return BiasSum((Bias.create(0.001, "world"), NormalOffset.create(1.0)))


ALL: tuple[Preset, ...] = (
    Preset(
        "filament", "Filament", "one LiSPSM map, 3 × 3 texels with smooth weights, normal bias",
        (*FILAMENT_PARAMETERS, Parameter("filter", "3 × 3 texels", "", here="two bilinear taps along an axis")),
        ("hardware polygon offset of the stored depth", "a choice of warp by light and view angle", SNAPPING),
        _maker(BilinearPercentageCloser(2), _filament_bias, SingleMap(PerspectiveFit("lispsm"))), 1024,
    ),
    Preset(
        "filament-evsm2", "Filament", "exponential variance map with one exponent that half precision can hold",
        (
            *FILAMENT_PARAMETERS[:3],
            Parameter("exponent", 5.54, "of the range", here="positive exponent on depths in [−1, 1]"),
            Parameter("minimum variance scale", 0.5, "", here="no counterpart: least variance is 10⁻⁶ of the range²"),
            Parameter("light bleed reduction", 0.15, "", here="low end of the clamp"),
        ),
        (HALF_PRECISION, "a least variance that grows with depth", SNAPPING),
        _maker(ExponentialVariance(positive=5.54, negative=None, bleed_low=0.15), _filament_bias), 1024,
    ),
    Preset(
        "godot-4", "Godot 4", "four cascades, PCF, constant and normal bias",
        (
            Parameter("map size", 4096, "texels", verified=False, here="divided among the cascades there"),
            Parameter(_CONSTANT, 0.1, "", verified=False, here="left out: its unit is not certain"),
            Parameter(_NORMAL, 2.0, "texels along the normal", here="NormalOffset"),
            Parameter("cascades", 4, "", here="four slices"),
            Parameter("splits", (0.1, 0.2, 0.5), "of the range", here="the rule shares, from the near plane on"),
            Parameter("shadow distance", 100.0, "world units", here=DISTANCE),
            Parameter("fade start", 0.8, "of the range", here="shadows fade out linearly from there"),
            Parameter("pancake size", 20.0, "world units", here="not needed: no caster is clipped"),
            Parameter("texel snapping", "on", "", here=SNAPPED),
        ),
        ("rotated sampling discs", "blending between cascades, which is off by default"),
        _maker(
            PercentageCloser(3),
            lambda: NormalOffset.create(2.0),
            _stable(4, "shares", shares_of_range=(0.1, 0.2, 0.5), distance=100.0, fade=0.2),
        ), 2048,
    ),
    Preset(
        "three-js", "three.js", "one map of 512², soft PCF, no bias by default",
        (
            Parameter("map size", 512, "texels"),
            Parameter(_CONSTANT, 0.0, "NDC", here="Bias of 0: expect acne"),
            Parameter(_NORMAL, 0.0, "world units", here="none"),
        ),
        (),
        _maker(BilinearPercentageCloser(3), lambda: Bias.create(0.0, "world")), 512,
    ),
    Preset(
        "three-js-vsm", "three.js", "variance map that stores mean and standard deviation",
        (
            Parameter("map size", 512, "texels"),
            Parameter("light bleed clamp low", 0.3, "", here="low end of the clamp"),
            Parameter("light bleed clamp high", 0.95, "", here="high end of the clamp"),
            Parameter("least variance", 0.0, "", here="10⁻⁶ of the range², what rounding needs"),
        ),
        ("filtering of the standard deviation instead of the second moment, which is not linear",),
        _maker(Variance(bleed_low=0.3, bleed_high=0.95), lambda: Bias.create(0.5, "slope")), 512,
    ),
    Preset(
        "three-js-csm", "three.js", "the cascades addon: three slices, practical splits",
        (
            Parameter("cascades", 3, "", here="three slices"),
            Parameter("split weight", 0.5, "", here="λ; the addon misplaces its first split, this does not"),
            Parameter(_CONSTANT, 1e-6, "NDC", here="BufferBias over a linear buffer up to the farthest depth"),
            Parameter("light margin", 200.0, "world units", here="not needed: no caster is clipped"),
            Parameter("texel snapping", "on", "", here=SNAPPED),
        ),
        ("fading between slices, which is off by default",),
        _maker(PercentageCloser(3), lambda: BufferBias.create(1e-6), _stable(3, "practical", weight=0.5)), 1024,
    ),
    Preset(
        "bgfx-pcf", "bgfx example 16", "four cascades with practical splits, PCF",
        (
            Parameter("map size", 2048, "texels"),
            Parameter("cascades", 4, "", here="four slices"),
            Parameter("split weight", 0.6, "", here="λ"),
            Parameter(_CONSTANT, (0.001, 0.055), "NDC", here="the least of its table, 0.001"),
            Parameter(_NORMAL, 0.001, "world units", here="NormalOffset"),
            Parameter("texel snapping", "on", "", here=SNAPPED),
        ),
        ("a table of biases tuned by hand for lights, encodings and filters, from 0.001 to 0.055",),
        _maker(
            PercentageCloser(4),
            lambda: BiasSum((BufferBias.create(0.001), NormalOffset.create(0.001, "world", by_sine=False))),
            _stable(4, "practical", choose="map", weight=0.6),
        ), 2048,
    ),
    Preset(
        "bgfx-vsm", "bgfx example 16", "variance map with a large least variance",
        (
            Parameter("map size", 2048, "texels"),
            Parameter("least variance", 0.02, "", here="0.02 / 300² of the range²: theirs counts multiplied depths"),
            Parameter("depth multiplier", 300.0, "", here="not applied: there it makes the variance negative"),
        ),
        (),
        _maker(Variance(min_variance=0.02 / 300**2), lambda: Bias.create(0.5, "slope")), 2048,
    ),
    Preset(
        "bgfx-esm", "bgfx example 16", "exponential map with a very steep exponent",
        (
            Parameter("map size", 2048, "texels"),
            Parameter("exponent", (2500.0, 9500.0), "per unit of depth", here="80 of the range: theirs overflows"),
        ),
        ("exponents that are applied to differences only",),
        _maker(Exponential(80.0), lambda: Bias.create(0.5, "slope")), 2048,
    ),
    Preset(
        "diligent-fx-pcf", "DiligentFX", "logarithmic cascades, PCF, receiver-plane bias",
        (
            Parameter("cascades", 4, "", verified=False, here="the user chooses, up to 8"),
            Parameter("split weight", 0.95, "", here="λ"),
            Parameter(_CONSTANT, 1e-5, "NDC", here="BufferBias"),
            Parameter("receiver-plane clamp", 10.0, "", here="ReceiverPlane, whose own limit is 16 texels of depth"),
            Parameter("search for the best cascade", "on", "", here="the first map that holds a point"),
            Parameter("texel snapping", "on", "", here=SNAPPED),
            Parameter("blend", 0.1, "of the range", here="left out: slices that are searched for have no common seam"),
        ),
        ("blending between cascades that are searched for",),
        _maker(
            PercentageCloser(3),
            lambda: BiasSum((BufferBias.create(1e-5), ReceiverPlane.create())),
            _stable(4, "practical", choose="map", weight=0.95),
        ),
        1024,
    ),
    Preset(
        "diligent-fx-evsm4", "DiligentFX", "four exponential moments under logarithmic cascades",
        (
            Parameter("positive exponent", 40.0, "of the range"),
            Parameter("negative exponent", 5.0, "of the range"),
            Parameter("variance bias", 1e-4, "", here="no counterpart: least variance is 10⁻⁶ of the range²"),
            Parameter("light bleed reduction", 0.0, ""),
            Parameter("split weight", 0.95, "", here="λ"),
            Parameter("texel snapping", "on", "", here=SNAPPED),
        ),
        ("blending between cascades that are searched for", "a least variance that grows with the warp's slope"),
        _maker(
            ExponentialVariance(positive=40.0, negative=5.0),
            lambda: Bias.create(1.0, "slope"),
            _stable(4, "practical", choose="map", weight=0.95),
        ), 1024,
    ),
    Preset(
        "mjp-pcf", "MJP's shadow sample", "four cascades, PCF 7 × 7 that follows the receiver's plane",
        (
            Parameter("map size", 2048, "texels"),
            Parameter("cascades", 4, ""),
            Parameter("splits", (0.05, 0.15, 0.5, 1.0), "of the range", here="the rule shares, from the near plane on"),
            Parameter("stabilised cascades", "off", "", here="UniformFit: each map as small as what it must hold"),
            Parameter(_CONSTANT, 0.005, "NDC", here="BufferBias"),
            Parameter(_NORMAL, 0.0, "texels along the normal"),
            Parameter("receiver-plane bias", "on", "", here="ReceiverPlane"),
            Parameter("kernel", 7, "texels", verified=False, here="sizes from 2 to 9 can be chosen there"),
            Parameter("blend", 0.1, "of the range", here="over 0.1 of a slice's range of ln z"),
        ),
        (),
        _maker(
            PercentageCloser(7),
            lambda: BiasSum((BufferBias.create(0.005), ReceiverPlane.create())),
            _mjp_slices(),
        ), 2048,
    ),
    Preset(
        "mjp-evsm4", "MJP's shadow sample", "four exponential moments",
        (
            Parameter("positive exponent", 40.0, "of the range"),
            Parameter("negative exponent", 5.0, "of the range"),
            Parameter("variance bias", 1e-4, "", here="no counterpart: least variance is 10⁻⁶ of the range²"),
            Parameter("light bleed reduction", 0.0, ""),
        ),
        (),
        _maker(ExponentialVariance(positive=40.0, negative=5.0), lambda: Bias.create(1.0, "slope"), _mjp_slices()),
        2048,
    ),
    Preset(
        "mjp-msm-hamburger", "MJP's shadow sample", "four moments of depth, Hamburger's bound",
        (
            Parameter("moment bias", 3e-6, "", here="share of the points ±1 mixed in"),
            Parameter("depth bias", 0.0, "", here="slope bias of one texel: zero shows acne here"),
        ),
        ("16-bit storage with a matrix that spreads the moments",),
        _maker(Moments(problem="hamburger", moment_bias=3e-6), lambda: Bias.create(1.0, "slope"), _mjp_slices()), 2048,
    ),
    Preset(
        "mjp-msm-hausdorff", "MJP's shadow sample", "four moments of depth, Hausdorff's bound",
        (
            Parameter("moment bias", 3e-6, "", here="share of the points ±1 mixed in"),
            Parameter("depth bias", 0.0, "", here="slope bias of one texel: zero shows acne here"),
        ),
        ("16-bit storage with a matrix that spreads the moments",),
        _maker(Moments(problem="hausdorff", moment_bias=3e-6), lambda: Bias.create(1.0, "slope"), _mjp_slices()), 2048,
    ),
    Preset(
        "bevy", "bevy", "four cascades, constant bias in metres, normal bias of 1.8 texels",
        (
            Parameter("map size", 2048, "texels", verified=False),
            Parameter(_CONSTANT, 0.02, "world units", here="Bias"),
            Parameter(_NORMAL, 1.8, "texels along the normal", here="NormalOffset"),
            Parameter("cascades", 4, ""),
            Parameter("first cascade far", 10.0, "world units", here="the rule first, equal ratios beyond it"),
            Parameter("shadow distance", 150.0, "world units", here=DISTANCE),
            Parameter("overlap", 0.2, "of the range", here="blend of 0.25: 0.2 of far planes from slice 1 on"),
            Parameter("texel snapping", "on", "", verified=False, here=SNAPPED),
        ),
        (),
        _maker(
            PercentageCloser(3),
            lambda: BiasSum((Bias.create(0.02, "world"), NormalOffset.create(1.8))),
            _stable(4, "first", first=10.0, distance=150.0, blend=0.25),
        ),
        2048,
    ),
)  # fmt: skip

__all__ = ["ALL"]
