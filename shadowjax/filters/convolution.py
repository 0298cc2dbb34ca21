"""Convolution shadow maps: the step as a Fourier series with blurred bases; XCSM: the series of a blurred depth."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int
from shadowjax._types import Array, Float, ScalarLike
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.prefiltered import Prefiltered, Values

Numbers = Float[Array, "*points"]


@checked
def frequencies(num_terms: int) -> np.ndarray:
    """c_k = (2k − 1)π for k = 1 … M.

    Raises:
        ValueError: If M < 1.

    Source: filtering, eq. 2.16.
    """
    return (2 * np.arange(1, require_int(num_terms, "number of terms M", 1) + 1) - 1) * math.pi


@checked
def damping_weights(num_terms: int, damping: float) -> np.ndarray:
    """exp(−α(k/M)²) of each term. It tames ringing and makes the step *less* steep: slope 2 Σ exp(−α(k/M)²) < 2M.

    Source: filtering, section 2.4.3 (whose text says the opposite about steepness).
    """
    return np.exp(-damping * (np.arange(1, num_terms + 1) / num_terms) ** 2)


@checked
def basis_bytes(num_terms: int, num_rows: int, num_cols: int, bytes_per_value: int = 4) -> int:
    """Memory of the 2M basis images of a map, without mip levels. Source: filtering, section 2.4.1."""
    return 2 * require_int(num_terms, "number of terms M", 1) * num_rows * num_cols * bytes_per_value


@checked
def odd_waves(depth: Float[Array, "*shape"], num_terms: int) -> list[tuple[Array, Array]]:
    """(cos c_k z, sin c_k z) for k = 1 … M: two evaluations, then one rotation by 2πz for each term."""
    # c_{k+1} = c_k + 2π, so each term is the last one turned by 2πz, whose cosine and sine follow from those of πz.
    cosine, sine = jnp.cos(math.pi * depth), jnp.sin(math.pi * depth)
    turn_cosine, turn_sine = 1 - 2 * sine * sine, 2 * sine * cosine
    waves = [(cosine, sine)]
    for _ in range(require_int(num_terms, "number of terms M", 1) - 1):
        cosine, sine = cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine
        waves.append((cosine, sine))
    return waves


@checked
def fourier_bases(depth: Float[Array, "rows cols"], num_terms: int) -> Float[Array, "n rows cols"]:
    """The 2M basis images sin c_k z, cos c_k z, in that order for each k, all in [−1, 1].

    Source: filtering, eq. 2.18.
    """
    return jnp.stack([wave for cosine, sine in odd_waves(depth, num_terms) for wave in (sine, cosine)])


@checked
def fourier_visibility(bases: Values, depth: Numbers, damping: float = 0.0) -> Numbers:
    """½ + Σ a_k(d) B_k(z): the truncated series of the step in z − d, from bases that may have been averaged.

    Args:
        bases: 2M arrays in the order of `fourier_bases`.
        depth: Receiver's depth d; |z − d| < 1 must hold for every depth that was averaged.
        damping: α ≥ 0.

    Returns:
        About 1 where lit, ½ on the surface, 0 in shadow; it overshoots by 9 % without damping.

    Source: filtering, eqs 2.15 and 2.17, with the sign of the latter.
    """
    num_terms = len(bases) // 2
    # 2/c_k are the sine coefficients of the step (eq. 2.16), damped term by term.
    gains = 2 * damping_weights(num_terms, damping) / frequencies(num_terms)
    total = jnp.full_like(depth, 0.5)
    for k, (cosine, sine) in enumerate(odd_waves(depth, num_terms)):
        # sin c(z − d) = sin cz·cos cd − cos cz·sin cd: the bases hold z, which may be averaged, the waves the
        # receiver's d.
        total = total + float(gains[k]) * (cosine * bases[2 * k] - sine * bases[2 * k + 1])
    return total


@checked
def fourier_test(difference: Numbers, num_terms: int, damping: float = 0.0) -> Numbers:
    """½ + 2 Σ exp(−α(k/M)²) sin(c_k t)/c_k: the truncated series of a step, of one known difference t = z − d.

    Source: filtering, eq. 2.16 with the sign of eq. 2.17.
    """
    gains = 2 * damping_weights(num_terms, damping) / frequencies(num_terms)
    total = jnp.full_like(difference, 0.5)
    for gain, (_, sine) in zip(gains, odd_waves(difference, num_terms), strict=True):
        total = total + float(gain) * sine
    return total


@checked
def depth_squeeze(terms: int, offset: ScalarLike = 0.0) -> ScalarLike:
    """Factor on depths that keeps |z − d| below 1 − 1/(2M), where the periodic series starts to fall back.

    Args:
        terms: M ≥ 1.
        offset: By how much receivers are moved towards the light, parts of the range, in [0, 1).
    """
    return (1 - 1 / (2 * terms)) / (1 + offset)


def _series_depth(depth: Numbers, terms: int, offset: ScalarLike) -> Numbers:
    """Depth at which the series is evaluated: in the range, since the series repeats beyond it."""
    return depth_squeeze(terms, offset) * (jnp.clip(depth, 0.0, 1.0) - offset)


def _finished(series: Numbers, scale: ScalarLike) -> Numbers:
    """The series scaled and clamped."""
    return jnp.clip(scale * series, 0.0, 1.0)


@checked
def encode_convolution(
    depth: Float[Array, "rows cols"], terms: int = 16, offset: ScalarLike = 0.0
) -> Float[Array, "n rows cols"]:
    """What a convolution shadow map stores: 2M basis images, to be averaged.

    Args:
        depth: Parts of the map's range, [0, 1] (`unit_depth`).
        terms: M ≥ 1.
        offset: By how much receivers are moved towards the light, parts of the range, in [0, 1).
    """
    return fourier_bases(depth_squeeze(terms, offset) * depth, terms)


@checked
def decode_convolution(
    values: Values, depth: Numbers, damping: float = 1.0, offset: ScalarLike = 0.0, scale: ScalarLike = 2.0
) -> Numbers:
    """Visibility from averaged basis images: their series, scaled and clamped.

    Args:
        values: The 2M bases at each receiver.
        depth: Receivers' depth in the same range, less the bias.
        damping: α ≥ 0, which trades ringing for a wider step; a number of Python.
        offset: As stored.
        scale: Factor on the series before it is clamped to [0, 1]; 2 makes surfaces, where the series is ½, fully lit.

    Source: filtering, eqs 2.15 to 2.18.
    """
    # Receivers are squeezed as stored depths were, so that |z − d| stays below the series' half period.
    where = _series_depth(depth, len(values) // 2, offset)
    return _finished(fourier_visibility(values, where, damping), scale)


@checked
def encode_mean_depth(
    depth: Float[Array, "rows cols"], terms: int = 16, offset: ScalarLike = 0.0
) -> Float[Array, "1 rows cols"]:
    """What XCSM stores: the depth itself, to be averaged. Arguments as of `encode_convolution`."""
    return depth_squeeze(terms, offset) * depth[None]


@checked
def decode_mean_depth(
    values: Values,
    depth: Numbers,
    terms: int = 16,
    damping: float = 1.0,
    offset: ScalarLike = 0.0,
    scale: ScalarLike = 2.0,
) -> Numbers:
    """The series at the mean depth, scaled and clamped. Arguments as of `decode_convolution`; M is given.

    Source: filtering, sections 2.4.3 and 3.2.
    """
    return _finished(fourier_test(values[0] - _series_depth(depth, terms, offset), terms, damping), scale)


class FourierStep(Checked):
    """The reconstructed step and how its faults are hidden.

    Attributes:
        terms: M ≥ 1; the step rises over about 1/M of the range, and 2M numbers make the bases.
        damping: α ≥ 0, which trades ringing for a wider step.
        offset: Moves the step towards the light, parts of the range: lit surfaces get more than ½, contact leaks.
        scale: Factor on the series before it is clamped to [0, 1]: 2 makes surfaces, where the series is ½, fully lit.
    """

    terms: int = eqx.field(static=True, default=16)
    damping: float = eqx.field(static=True, default=1.0)
    offset: float = eqx.field(static=True, default=0.0)
    scale: float = eqx.field(static=True, default=2.0)

    def __check_init__(self) -> None:
        require_int(self.terms, "number of terms M", 1)
        require(self.damping >= 0, f"damping must not be negative; got {self.damping}")
        require(0 <= self.offset < 1, f"offset is a part of the depth range, in [0, 1); got {self.offset}")
        require(self.scale > 0, f"scale must be positive; got {self.scale}")

    @property
    def squeeze(self) -> ScalarLike:
        """Factor on depths (`depth_squeeze`)."""
        return depth_squeeze(self.terms, self.offset)


class Convolution(Prefiltered):
    """Convolution shadow maps. Depths are parts of the map's range, [0, 1].

    Attributes:
        step: The series.
        prefilter: How basis images are averaged.
    """

    step: FourierStep = FourierStep()
    prefilter: Prefilter = Prefilter()

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The 2M basis images."""
        return encode_convolution(depth, self.step.terms, self.step.offset)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """The series of the averaged bases."""
        return decode_convolution(values, depth, self.step.damping, self.step.offset, self.step.scale)

    @property
    def num_planes(self) -> int:
        """2M."""
        return 2 * self.step.terms

    @property
    def bias_reach(self) -> float:
        """The series is odd about the receiver's own plane, whose mean is ½; half a texel for how a map bends it."""
        return 0.5


class MeanDepthConvolution(Prefiltered):
    """XCSM: the series of the averaged depth, its bases made during the lookup. One number a texel.

    The mean of the bases is not the base of the mean, so this tests the receiver against the mean depth: blurred shadow
    edges move and stay hard. The source calls the results very similar; they are not.

    Attributes:
        step: The series.
        prefilter: How depths are averaged.

    Source: filtering, sections 2.4.3 and 3.2.
    """

    step: FourierStep = FourierStep()
    prefilter: Prefilter = Prefilter()

    def encode(self, depth: Float[Array, "rows cols"]) -> Float[Array, "n rows cols"]:
        """The depth."""
        return encode_mean_depth(depth, self.step.terms, self.step.offset)

    def decode(self, values: Values, depth: Numbers) -> Numbers:
        """The series at the mean depth."""
        step = self.step
        return decode_mean_depth(values, depth, step.terms, step.damping, step.offset, step.scale)

    @property
    def num_planes(self) -> int:
        """One depth."""
        return 1

    @property
    def bias_reach(self) -> float:
        """The mean of a plane is its depth at the receiver; half a texel covers how a map bends it."""
        return 0.5
