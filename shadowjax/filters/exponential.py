"""Exponential shadow maps: the step as e^(−c(d−z)), blurred in log space, and a fallback where its premise fails."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import POSITIVE, concrete, require, require_choice, require_finite, require_int, require_number
from shadowjax._types import Array, DType, Float, ScalarLike
from shadowjax.filters.base import Filter, Lookup
from shadowjax.filters.pcf import percentage_closer_of
from shadowjax.filters.prefilter import DepthRange, Prefilter
from shadowjax.filters.prefiltered import Values
from shadowjax.maps.blur import Weights, extend, kernel_radius, known_weights
from shadowjax.maps.sampling import is_outside, read_nearest
from shadowjax.maps.shadow_map import ShadowMap

Numbers = Float[Array, "*points"]

SPACES = ("log", "linear")
FALLBACKS = ("none", "threshold", "z-max")

# A test this far above 1 is a violation whatever its value; e¹⁰ keeps sums and gradients finite in every dtype.
VIOLATION_LIMIT = 10.0


@checked
def check_exponent(exponent: ScalarLike, dtype: DType, power: int = 1, growth: float = 1.0) -> None:
    """Complain about an exponent c for which growth·(e^(cz))^power is infinite for some z in [0, 1].

    With one power c may reach ln(largest number): 88.72 in float32 and 11.09 in float16, where the c = 30 of the source
    overflows for z > 0.37.

    Source: filtering, section 2.5.1.
    """
    # growth·e^(power·c) ≤ max at z = 1, solved for c.
    largest = float(np.log(float(jnp.finfo(dtype).max)) - np.log(growth)) / power
    require(
        bool(exponent <= largest),
        f"an exponent of {exponent:g} overflows {jnp.dtype(dtype).name}; use at most {largest:.4g} there, or a wider "
        "dtype",
    )


@checked
def exponential_test(
    stored_depth: Float[Array, "*#points"], receiver_depth: Float[Array, "*#points"], exponent: ScalarLike
) -> Float[Array, "*points"]:
    """e^(−c(d−z)): near 0 where the receiver lies well behind the stored depth, 1 where it lies on it, above 1 before.

    Source: filtering, eqs 2.19 and 2.20; a visibility only where z ≤ d.
    """
    return jnp.exp(exponent * (stored_depth - receiver_depth))


@checked
def blur_exponents(exponents: Float[Array, "more_rows more_cols"], weights: Weights) -> Float[Array, "rows cols"]:
    """ln of the weighted mean of e^x, along both axes: the blur of e^(cz) for any c, since only differences are raised.

    Args:
        exponents: cz of every texel, extended by half the kernel.
        weights: Positive weights of an odd number of taps along one axis.

    Returns:
        A map smaller by `len(weights) − 1` texels.
    """
    kernel_radius(len(weights))
    weights = known_weights(weights)
    # Separable: ln Σ w·eˣ along columns, then of these along rows. With the largest exponent taken out no term
    # overflows and at least one is 1, so the logarithm is finite.
    for axis in (1, 0):
        length = exponents.shape[axis] - len(weights) + 1
        parts = [jax.lax.slice_in_dim(exponents, i, i + length, axis=axis) for i in range(len(weights))]
        top = parts[0]
        for part in parts[1:]:
            top = jnp.maximum(top, part)
        top = jax.lax.stop_gradient(top)  # it cancels
        total = jnp.zeros_like(top)
        for part, weight in zip(parts, weights, strict=True):
            total = total + jnp.exp(part - top) * jnp.asarray(weight, top.dtype)
        exponents = jax.lax.optimization_barrier(top + jnp.log(total))
    return exponents


@checked
def encode_exponential(
    depth: Float[Array, "rows cols"], exponent: ScalarLike = 80.0, space: str = "linear"
) -> Float[Array, "1 rows cols"]:
    """What an exponential shadow map stores: e^(cz), to be averaged; or its logarithm, for `blur_exponents`.

    Args:
        depth: Parts of the map's range, [0, 1] (`unit_depth`).
        exponent: c > 0.
        space: "linear", where e^c must fit the dtype, or "log".

    Raises:
        ValueError: If the exponent is known and overflows the dtype, or the space is unknown.
    """
    exponents = (exponent * depth)[None]
    if require_choice(space, "space", SPACES) == "log":
        return exponents
    if concrete(exponent) is not None:
        check_exponent(exponent, depth.dtype)
    return jnp.exp(exponents)


@checked
def decode_exponential(values: Values, depth: Numbers, exponent: ScalarLike = 80.0, space: str = "linear") -> Numbers:
    """Visibility from averaged exponentials: the mean test e^(−cd)·E[e^(cz)], at most 1.

    Args:
        values: What the map stores, at each receiver. Logarithms may be read from one texel, not averaged.
        depth: Receivers' depth in the same range, less the bias.
        exponent: c, as stored.
        space: As stored.
    """
    # Receivers before every stored depth are lit as well as those on the nearest.
    depth = jnp.maximum(depth, 0.0)
    is_log = require_choice(space, "space", SPACES) == "log"
    return jnp.minimum(_limited_test(values[0] if is_log else jnp.log(values[0]), depth, exponent), 1.0)


def _limited_test(log_mean: Array, depth: Array, exponent: ScalarLike) -> Array:
    """E[e^(c(z−d))], exact up to e^`VIOLATION_LIMIT`: the product may overflow where a factor does not."""
    # The product e^(−cd)·E[e^(cz)] as one exponential of a difference.
    return jnp.exp(jnp.minimum(log_mean - exponent * depth, VIOLATION_LIMIT))


class ExponentialMap(Checked):
    """What an exponential shadow map stores.

    Attributes:
        exponential: e^(cz), or its logarithm, blurred.
        depth: The depths themselves, for the fallback; else None.
        farthest: Largest depth that a lookup at the texel depends on, in [0, 1]; None without z-max classification.
        range: Depths that were mapped to [0, 1].
    """

    exponential: Float[Array, "1 rows cols"]
    depth: Float[Array, "1 rows cols"] | None
    farthest: Float[Array, "1 rows cols"] | None
    range: DepthRange


class Exponential(Filter):
    """Exponential shadow maps. Depths are parts of the map's range, [0, 1].

    Attributes:
        exponent: c > 0; larger is steeper. Shadows fade over 1/c of the depth range behind their caster.
        prefilter: How exponentials are averaged.
        space: "log" stores ln of the mean of e^(cz) and works for every c; "linear" stores the mean itself, which
            hardware can filter, and needs e^c to be finite.
        fallback: What happens where a texel of the kernel lies behind the receiver, so that its exponential exceeds 1.
            "none" clamps the mean to 1; "threshold" takes bilinear PCF where the mean exceeds 1 + `threshold`; "z-max"
            takes it wherever the farthest depth of the kernel lies behind the receiver, which finds every violation.
        threshold: ε ≥ 0.
        fallback_size: K bilinear taps of the fallback along an axis, ≥ 1.
    """

    exponent: float = eqx.field(static=True, default=80.0)
    prefilter: Prefilter = Prefilter()
    space: str = eqx.field(static=True, default="log")
    fallback: str = eqx.field(static=True, default="none")
    threshold: float = eqx.field(static=True, default=0.02)
    fallback_size: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        require_number(self.exponent, "exponent", POSITIVE)
        require_choice(self.space, "space", SPACES)
        require_choice(self.fallback, "fallback", FALLBACKS)
        require(self.threshold >= 0, f"threshold must not be negative; got {self.threshold}")
        require_int(self.fallback_size, "fallback_size", 1)
        require(
            self.space == "linear" or self.prefilter.sampling in ("nearest", "bilinear"),
            f"logarithms are averaged by nearest or bilinear sampling only; got {self.prefilter.sampling!r}: use "
            "space='linear'",
        )

    def prepare(
        self, depth: Float[Array, "rows cols"], far: Float[Array, ""] | None = None, border: str = "lit"
    ) -> ExponentialMap:
        """The blurred exponentials of a map.

        Args:
            depth: Distances along the light's rays, world units, finite.
            far: Depth that a miss reports; the largest of the map if None.
            border: What lies outside the map, for the blur.

        Raises:
            ValueError: If a depth is NaN or infinite, or the exponent overflows the dtype in linear space.
        """
        return self._prepared(require_finite(depth, "depth map"), far, border)

    def prepare_map(self, shadow_map: ShadowMap) -> ExponentialMap:
        """The blurred exponentials of a cast map, whose depths are finite by construction."""
        return self._prepared(shadow_map.depth, shadow_map.grid.far, shadow_map.border, shadow_map.grid.seen)

    def _prepared(
        self, depth: Float[Array, "rows cols"], far: Array | None, border: str, seen: Array | None = None
    ) -> ExponentialMap:
        depth_range = DepthRange.of(depth, far, seen)
        unit = extend(depth_range.to_unit(depth), self.prefilter.radius, border, jnp.ones((), depth.dtype))
        encoded = encode_exponential(unit, self.exponent, self.space)
        if self.space == "log":
            stored = blur_exponents(encoded[0], self.prefilter.weights)[None]
        else:
            stored = self.prefilter.prepare(encoded)
        farthest = None
        if self.fallback == "z-max":
            # Bilinear taps lie up to a texel from the receiver's own.
            width = self.prefilter.size + 2
            wide = extend(depth_range.to_unit(depth), width // 2, border, jnp.ones((), depth.dtype))
            farthest = jax.lax.stop_gradient(wide)
            farthest = jax.lax.reduce_window(farthest, -jnp.inf, jax.lax.max, (width, 1), (1, 1), "VALID")
            farthest = jax.lax.reduce_window(farthest, -jnp.inf, jax.lax.max, (1, width), (1, 1), "VALID")[None]
        return ExponentialMap(stored, None if self.fallback == "none" else depth[None], farthest, depth_range)

    def visibility(self, planes: ExponentialMap, lookup: Lookup) -> Float[Array, "*points"]:
        """The mean exponential test, at most 1, or PCF where it fails; 1 outside a map with a lit border."""
        # Receivers before every stored depth are lit as well as those on the nearest.
        depth = jnp.maximum(planes.range.to_unit(lookup.depth - lookup.bias), 0.0)
        mean = self._mean_test(planes, lookup, depth)
        value = jnp.minimum(mean, 1.0)
        if planes.depth is not None:
            if planes.farthest is None:
                # A mean above 1 shows a violation, unless darker texels of the kernel hide it: z-max finds those too.
                fails = mean > 1 + self.threshold
            else:
                fails = read_nearest(planes.farthest, lookup.position, _inner(lookup.border))[0] > depth
            value = jnp.where(fails, percentage_closer_of(planes.depth, lookup, self.fallback_size, "bilinear"), value)
        if lookup.border != "lit":
            return value
        outside = is_outside(lookup.position, *planes.exponential.shape[-2:])
        return jnp.where(outside, jnp.ones_like(value), value)

    def _mean_test(self, planes: ExponentialMap, lookup: Lookup, depth: Array) -> Array:
        """w ∗ e^(c(z−d)) at each receiver, exact up to e^`VIOLATION_LIMIT`."""
        if self.space == "linear":
            stored = self.prefilter.read(planes.exponential, lookup)[0]
            return _limited_test(jnp.log(stored), depth, self.exponent)

        def test(stored: Array) -> Array:
            return _limited_test(stored, depth, self.exponent)

        return self.prefilter.read(planes.exponential, lookup, test)[0]

    @property
    def num_planes(self) -> int:
        """One, and those of the fallback."""
        return 1 + FALLBACKS.index(self.fallback)

    @property
    def num_tones(self) -> None:
        """A continuum."""
        return None

    @property
    def num_fetches(self) -> int:
        """Exponentials, and what the fallback reads."""
        # The z-max fallback reads one more number; bilinear PCF of K taps reads (K + 1)² depths.
        extra = {"none": 0, "threshold": 0, "z-max": 1}[self.fallback]
        taps = 0 if self.fallback == "none" else (self.fallback_size + 1) ** 2
        return self.prefilter.num_fetches + extra + taps

    @property
    def reach(self) -> float:
        """That of the prefilter, or of the fallback."""
        return max(self.prefilter.reach, self.bias_reach)

    @property
    def bias_reach(self) -> float:
        """A mean of exponentials is at least the exponential of the mean, so planes stay lit; PCF needs its own."""
        return 0.5 if self.fallback == "none" else (self.fallback_size + 1) / 2

    @property
    def compares(self) -> bool:
        """Reconstructed from exponentials."""
        return False


def _inner(border: str) -> str:
    """How planes are read inside a map whose outside is handled separately."""
    return "clamp" if border == "lit" else border
