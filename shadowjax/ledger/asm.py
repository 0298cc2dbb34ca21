"""Ledger of the adaptive shadow map slides: cost and benefit, mip levels as a measure of area, the stencil's rule."""

import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
from scipy import optimize

from shadowjax.filters.hard import is_lit
from shadowjax.ledger import volume_counts
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.partitions.adaptive.refinement import wishes
from shadowjax.partitions.adaptive.tile_tree import MAX_LEVEL

ROUNDING = 8 * 2.0**-23  # of depths up to 8 in float32, two roundings


def _level_value(inputs: Inputs) -> float:
    """1 + log₂ρ for ρ ≥ 1: labels 1, 2, 3, ... interpolated between levels."""
    return 1 + math.log2(max(inputs.number("rho"), 1.0))


def _doubling_value(inputs: Inputs) -> float:
    """2^l·(1 + t) with log₂ρ = l + t: labels 1, 2, 4, ... interpolated between levels."""
    level = math.log2(max(inputs.number("rho"), 1.0))
    whole = math.floor(level)
    return 2**whole * (1 + level - whole)


def _trilinear(inputs: Inputs, labels: np.ndarray) -> float:
    """The label that trilinear filtering reads at the level of ρ, from a pyramid of constant levels."""
    level = np.log2(max(inputs.number("rho"), 1.0))
    return float(np.interp(level, np.arange(labels.size), labels))


def _overestimate(inputs: Inputs) -> float:
    """(1 + t)/2^t at a fraction t between levels; its largest value 2/(e·ln 2) lies at t = 1/ln 2 − 1."""
    t = inputs.number("fraction", default=1 / math.log(2) - 1)
    return (1 + t) / 2**t


def _overestimate_searched(inputs: Inputs) -> float:
    found = optimize.minimize_scalar(
        lambda t: -(1 + t) / 2**t, bounds=(0, 1), method="bounded", options={"xatol": 1e-10}
    )
    return -float(found.fun)  # pyright: ignore[reportAttributeAccessIssue]


def _area_ratio(inputs: Inputs) -> float:
    """1/cos(tilt): an isotropic level takes the longer axis of the pixel's footprint for both."""
    return 1 / math.cos(inputs.angle("tilt_deg"))


def _area_ratio_footprint(inputs: Inputs) -> float:
    """Square of the longer axis over the area of a small pixel's footprint on a tilted plane, from its four rays."""
    tilt, z = inputs.angle("tilt_deg"), inputs.number("z", default=10.0)
    # The pixel shrinks until perspective within it is below rounding of the ratio; the source's ratio is that limit.
    half = min(inputs.number("pixel", default=0.01), 1e-6) / 2
    corners = []
    for x, y in ((-half, -half), (half, -half), (half, half), (-half, half)):
        reach = z / (1 - y * math.tan(tilt))  # ray (x, y, 1) meets the plane depth = z + height·tan(tilt)
        corners.append(reach * np.array([x, y, 1.0]))
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    area = float(np.linalg.norm(np.cross(across, up)))
    return max(float(across @ across), float(up @ up)) / area


def _rule_share(inputs: Inputs) -> Fraction:
    """0 for light where the stencil is positive, 1 for light where it is zero."""
    if "stencil>0" in inputs.label.replace(" ", "") and "==0" not in inputs.label.replace(" ", ""):
        return Fraction(0)
    if "==0" in inputs.label.replace(" ", ""):
        return Fraction(1)
    raise Unavailable(f"no lighting rule in the label {inputs.label!r}")


def _rule_share_simulated(inputs: Inputs) -> Fraction:
    trials, lit_where_zero = inputs.integer("trials"), _rule_share(inputs) == 1
    return volume_counts.right_by_drawing(trials, volume_counts.Rule(lit_where_zero=lit_where_zero))


def _cost_of_wishes(inputs: Inputs) -> float:
    """Benefit over ratio of a cell whose four tiles are each asked for by one pixel, from the package's wishes."""
    # Places on the curve of the four quarters of the square: the two leading bits.
    quadrant = np.arange(4) << (2 * (MAX_LEVEL - 1))
    cell, level = np.zeros(4, int), np.zeros(4, int)
    texels = inputs.integer("N_required") // 4
    found = wishes(quadrant, cell, level, level + 1, 1, texels, inputs.number("a"), inputs.number("b"))
    return float(found.benefit.sum() / found.ratio[0])


def _all_lit(inputs: Inputs) -> float:
    if inputs.number("tolerance") < ROUNDING:
        raise Unavailable("below the rounding of the depths the share depends on the points")
    return 1.0


def _share_found_lit(inputs: Inputs) -> float:
    """Points whose stored depth is their own by another route of rounding, through the package's test."""
    depth = np.random.default_rng(2).uniform(1, 8, 1000).astype(np.float32)
    # Dividing and multiplying again rounds twice: the same depth by another route.
    stored = (depth / np.float32(3)) * np.float32(3)
    bias = jnp.asarray(inputs.number("tolerance"), dtype=jnp.float32)
    return float(np.mean(np.asarray(is_lit(jnp.asarray(stored), jnp.asarray(depth), bias))))


_TILTS = tuple({"tilt_deg": tilt, "z": 10, "pixel": 0.01} for tilt in (0, 45, 60, 80))
_TRIALS = {"trials": 4000}

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="asm.stencil",
        source="asm, shadow volumes",
        statement="Share of configurations that a rule lights rightly, given the correct stencil values.",
        verdict="erratum",
        closed_form=_rule_share,
        measured=_rule_share_simulated,
        correction=Correction(
            printed="light is added where the stencil is greater than 0",
            corrected="light is added where the stencil is 0",
            printed_form=lambda i: _rule_share_simulated(Inputs(i, "stencil>0")),
            counterexample=_TRIALS,
            label="corrected: add light where stencil==0",
        ),
        samples=((_TRIALS, "printed: add light where stencil>0"), (_TRIALS, "corrected: add light where stencil==0")),
    ),
    Equation(
        id="asm.equality",
        source="asm, shadow maps",
        statement="Share of lit points that the test finds lit when both depths come from float32 arithmetic.",
        verdict="conditional",
        condition="The test allows a tolerance; printed as equality of the two depths, which rounding breaks.",
        closed_form=_all_lit,
        measured=_share_found_lit,
        samples=({"tolerance": 1e-5}, {"tolerance": 1e-3}),
    ),
    Equation(
        id="asm.cost",
        source="asm, cost and benefit",
        statement="Cost of refining a cell: a·N_required + b.",
        verdict="holds",
        closed_form=lambda i: i.fraction("a") * i.integer("N_required") + i.fraction("b"),
        measured=_cost_of_wishes,
        samples=({"a": 1, "b": 100, "N_required": 1024}, {"a": 0.5, "b": 3, "N_required": 256}),
    ),
    Equation(
        id="asm.mip.value_labels_1_2_3",
        source="asm, mip-map levels",
        statement="Levels labelled 1, 2, 3, ... read 1 + log₂ρ under trilinear filtering.",
        verdict="conditional",
        condition="The value is a level, not an area: the area in finest texels is 4^(v−1).",
        closed_form=_level_value,
        independent=lambda i: _trilinear(i, np.arange(1.0, 33.0)),
        samples=tuple({"rho": rho} for rho in (1, 2, 3, 5.5)),
    ),
    Equation(
        id="asm.mip.area",
        source="asm, mip-map levels",
        statement="Area in finest texels that a value of labels 1, 2, 3, ... stands for: 4^(v−1).",
        verdict="erratum",
        closed_form=lambda i: 4 ** (_level_value(i) - 1),
        independent=lambda i: max(i.number("rho"), 1.0) ** 2,
        correction=Correction(
            printed="the value read is the area",
            corrected="the area is 4^(v−1)",
            printed_form=_level_value,
            counterexample={"rho": 3},
        ),
        samples=tuple({"rho": rho} for rho in (1, 2, 3, 5.5)),
    ),
    Equation(
        id="asm.mip.value_labels_1_2_4",
        source="asm, mip-map levels",
        statement="Levels labelled 1, 2, 4, ... read about ρ, too much between levels.",
        verdict="conditional",
        condition="Exact where ρ is a power of two.",
        closed_form=_doubling_value,
        independent=lambda i: _trilinear(i, 2.0 ** np.arange(32)),
        samples=tuple({"rho": rho} for rho in (1, 2, 3, 5.5)),
    ),
    Equation(
        id="asm.mip.max_overestimate_labels_1_2_4",
        source="asm, mip-map levels",
        statement="Largest factor by which labels 1, 2, 4, ... exceed ρ: 2/(e·ln 2).",
        verdict="holds",
        closed_form=_overestimate,
        independent=_overestimate_searched,
        samples=({},),
    ),
    Equation(
        id="asm.mip.area_over_true",
        source="asm, mip-map levels",
        statement="An isotropic level exceeds the true area of a tilted pixel's footprint by 1/cos(tilt).",
        verdict="conditional",
        condition="Small pixels on the axis of view.",
        closed_form=_area_ratio,
        independent=_area_ratio_footprint,
        tolerance=1e-4,  # perspective within the pixel, of the order of its angle times tan(tilt)
        samples=_TILTS,
    ),
)
