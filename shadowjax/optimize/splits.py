"""Best planes between depth slices: shares of ln(f/n) through a softmax, many starts, against equal ratios."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice, require_int
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.warps import lispsm
from shadowjax.warps.light_frustum import SECTIONS, LightFrustum, Section
from shadowjax.warps.minimax import least_storage, minimax
from shadowjax.warps.prediction import storage_factor

WARPS = {
    "uniform": lambda part, section: lispsm.uniform(part),
    "lispsm": lambda part, section: lispsm.generalised(part),
    "minimax": minimax,
    "least_storage": least_storage,
}
SHARPNESS = 400.0  # exponent of the power mean that stands for the maximum while it is minimised


class SplitCertificate(Checked):
    """Why the planes are optimal.

    Attributes:
        equal: Objective of equal ratios (warping, eq. 50).
        gain: That over the objective found, ≥ 1; 1 where equal ratios are best.
        slope_spread: For "sum": relative spread of the slices' dS/d ln(f_i/n_i); 0 at a smooth optimum,
            not where slices sit on a kink of S (with "lispsm", at the ratio whose γ_lim is γ).
        storage_spread: For "max": relative spread of the slices' storages; 0 where all are alike.
        starts: How many starting points the search had.
    """

    equal: Float[Array, ""]
    gain: Float[Array, ""]
    slope_spread: Float[Array, ""]
    storage_spread: Float[Array, ""]
    starts: int = eqx.field(static=True)


class Splits(Checked):
    """The best planes of a view and a light.

    Attributes:
        splits: k + 1 planes, world units, n and f included.
        storage: Sum or maximum of the slices' storage factors.
        certificate: Evidence that it is optimal.
    """

    splits: Float[Array, "planes"]
    storage: Float[Array, ""]
    certificate: SplitCertificate

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, as `optimize splits` writes them."""
        return {
            "splits": self.splits.tolist(),
            "storage": self.storage.tolist(),
            "certificate": {
                name: value.tolist() if isinstance(value, jax.Array) else value
                for name, value in vars(self.certificate).items()
            },
        }


def _storages(frustum: LightFrustum, log_ratios: Array, warp: str, section: Section) -> Array:
    """Storage of slices of given ln(f_i/n_i); slices of one view are similar, so n_i does not matter."""
    one = jnp.ones_like(log_ratios)
    part = LightFrustum(one, jnp.exp(log_ratios), one * frustum.phi_y, one * frustum.phi_x, one * frustum.gamma)
    return storage_factor(part, WARPS[warp](part, section), section)


def _starts(k: int, dtype: Any) -> Array:
    """Equal shares, and for every m < k shares of which m are a fifth or thrice the others."""
    rows = [jnp.zeros(k, dtype)]
    for m in range(1, k):
        few = (jnp.arange(k) < m).astype(dtype)
        rows += [few * math.log(0.2), few * math.log(3.0)]
    return jnp.stack(rows)


@eqx.filter_jit
def _search(frustum: LightFrustum, k: int, objective: str, warp: str, section: Section) -> Splits:
    span = jnp.log(frustum.far / frustum.near)

    def exact(shares: Array) -> Array:
        each = _storages(frustum, shares * span, warp, section)
        return jnp.max(each) if objective == "max" else jnp.sum(each)

    def smooth(logits: Array, _: Any) -> Array:
        each = jnp.log(_storages(frustum, jax.nn.softmax(logits) * span, warp, section))
        sharpness = SHARPNESS if objective == "max" else 1.0
        return jax.nn.logsumexp(sharpness * each) / sharpness

    solver = optx.BFGS(rtol=1e-9, atol=1e-12)

    def descend(start: Array) -> Array:
        found = optx.minimise(smooth, solver, start, max_steps=200, throw=False)
        return jax.nn.softmax(found.value)

    starts = _starts(k, span.dtype)
    # equal shares stand first, so that they win ties
    shares = jnp.concatenate([jnp.full((1, k), 1 / k, span.dtype), jnp.sort(jax.vmap(descend)(starts), axis=-1)])
    values = jax.vmap(exact)(shares)
    equal = values[0]
    better = jnp.where(values < equal * (1 - 1e-9), values, equal)
    best = shares[jnp.argmin(better)]
    storage = exact(best)
    each, slopes = jax.jvp(
        lambda x: _storages(frustum, x, warp, section), (best * span,), (jnp.ones_like(best),)
    )  # fmt: skip
    inner = frustum.near * jnp.exp(jnp.cumsum(best) * span)
    planes = jnp.concatenate([frustum.near[None], inner]).at[-1].set(frustum.far)

    def spread(x: Array) -> Array:
        return (jnp.max(x) - jnp.min(x)) / jnp.mean(x)

    certificate = SplitCertificate(equal, equal / storage, spread(slopes), spread(each), starts.shape[0] + 1)
    return Splits(planes, storage, certificate)


@checked
def splits(
    near: ArrayLike,
    far: ArrayLike,
    phi: ArrayLike,
    gamma: ArrayLike,
    num_partitions: int,
    objective: str = "max",
    warp: str = "uniform",
    section: str = "axis",
) -> Splits:
    """The planes of least storage for k depth slices.

    Equal ratios are best for the maximum, and for the sum wherever storage is convex in ln(f/n): for uniform and
    minimax warps no exception is known. With the source's eq. 42 and 44 there are: narrow slices fall below their own
    γ_lim, so slices just wide enough to stay above it, beside one narrow one, can need less.

    Args:
        near: Depth n, world units, > 0.
        far: Depth f, world units, > near.
        phi: Half the vertical angle of view, radians, in (0, π/2).
        gamma: Angle between light and view, radians, in [0, π/2].
        num_partitions: k ≥ 1.
        objective: "max", the largest slice's texels, or "sum", all texels.
        warp: "uniform", "lispsm" (eq. 42 with 44), "minimax" or "least_storage".
        section: "axis" or "whole" vertical section, over which errors are taken.

    Raises:
        ValueError: If a number is out of range or a name is unknown.

    Source: warping, eq. 50–51, for any γ.
    """
    require_choice(objective, "objective", ("max", "sum"))
    require_choice(warp, "warp", WARPS)
    checked: Section = require_choice(section, "section", SECTIONS)
    frustum = LightFrustum.create(near, far, phi, gamma)
    return _search(frustum, require_int(num_partitions, "the number of partitions k", 1), objective, warp, checked)


__all__ = ["WARPS", "SplitCertificate", "Splits", "splits"]
