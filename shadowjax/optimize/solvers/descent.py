"""Gradient descent on mesh vertices with Laplacian-preconditioned steps."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, require_untraced
from shadowjax._types import Float, Int
from shadowjax.optimize.solution import Solution, SolutionKind

# Memory of slopes and of their squares; and the part of the first loss that a settled search may still lose.
MEAN, SQUARE, SETTLED = 0.8, 0.95, 0.05

LossAndSlope = Callable[[np.ndarray], tuple[float, Any, np.ndarray]]


class DescentCertificate(Checked):
    """A descent, step by step.

    Attributes:
        losses: Of every step, and after the last.
        vertices: Of every step, and after the last; (steps + 1) × vertices × 3.
        others: What the function gave next to loss and slope, of every step and after the last.
        finite: Whether all losses and slopes were finite; the descent stops at the first that is not.
        reason: Why it ended.
    """

    losses: np.ndarray
    vertices: np.ndarray
    others: tuple[Any, ...]
    finite: bool = eqx.field(static=True)
    reason: str = eqx.field(static=True)


_KIND = SolutionKind(
    (
        ("vertices", "value"), ("loss", "objective_value"), ("baselines", "baselines"), ("gain", "gain"),
        ("losses", "certificate.losses"), ("reason", "certificate.reason"), ("result", "text"),
    ),
    rival="start",
)  # fmt: skip


@checked
def diffuser(faces: Int[np.ndarray, "faces 3"], num_vertices: int, amount: float) -> Float[np.ndarray, "n n"]:
    """(1 + λL)⁻¹ of the mesh's graph: spreads a change over neighbours, keeps the change of all by the same.

    Args:
        faces: Of the mesh; triangles whose corners coincide join nothing.
        num_vertices: Of the mesh.
        amount: λ, ≥ 0; L is the graph's Laplacian.

    Raises:
        ValueError: If the amount is negative.
    """
    require(amount >= 0, f"the amount of diffusion must not be negative; got {amount}")
    graph = np.zeros((num_vertices, num_vertices))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        graph[faces[:, a], faces[:, b]] = graph[faces[:, b], faces[:, a]] = 1
    np.fill_diagonal(graph, 0)
    # L = D − A, whose null space are constant fields: a translation of all vertices passes undamped.
    laplacian = np.diag(graph.sum(1)) - graph
    return np.linalg.inv(np.eye(num_vertices) + amount * laplacian)


@checked
def descend(
    value_and_slope: LossAndSlope,
    start: Float[np.ndarray, "n 3"],
    spread: Float[np.ndarray, "n n"],
    num_steps: int,
    rate: float,
    target: float = 0.0,
) -> Solution[np.ndarray, DescentCertificate]:
    """Adam with one scale for all numbers, on displacements that are spread over the mesh.

    One scale keeps small slopes small: vertices that no shadow's edge depends on move with their neighbours only.
    The rate falls to a tenth along half a cosine.

    Args:
        value_and_slope: Vertices → loss, anything to record with it, and slope.
        start: Vertices.
        spread: From `diffuser`.
        num_steps: Most steps, ≥ 1.
        rate: Length of a first step before it is spread, world units, > 0.
        target: Loss that ends the descent, ≥ 0.

    Returns:
        `value` the vertices after the last step; `objective_value` the loss there; `baselines` "start". Converged means
        that the loss is as small as asked for, or that the last tenth of the steps hardly changed it, were they as long
        as the first; a loss or slope that is not finite ends the descent (`RESULTS.nonfinite`).

    Raises:
        ValueError: If a number is out of range, or the start is not finite.
    """
    require_untraced("descend", start, spread, rate)
    require_int(num_steps, "num_steps", 1)
    require(rate > 0, f"rate must be positive; got {rate}")
    require(target >= 0, f"target must not be negative; got {target}")
    require(bool(np.isfinite(start).all()), "the start must be finite; some vertices are NaN or infinite")
    moved, mean, square = (np.zeros_like(start) for _ in range(3))
    losses, places, others, reason, result = [], [], [], "", optx.RESULTS.successful
    for step in range(num_steps + 1):
        # Displacements are diffused over the mesh before they are added: neighbours move along.
        vertices = start + spread @ moved
        loss, other, slope = value_and_slope(vertices)
        losses.append(float(loss))
        places.append(vertices)
        others.append(other)
        if not (np.isfinite(loss) and np.isfinite(slope).all()):
            reason, result = f"loss or slope is not finite at step {step}", optx.RESULTS.nonfinite
            break
        if loss <= target:
            reason = "the loss is as small as asked for"
            break
        # Vertices are start + spread·moved, so the slope by `moved` is spreadᵀ·slope (chain rule).
        downhill = spread.T @ slope
        if not downhill.any():
            reason = "the loss has no slope: no vertex makes an edge of a shadow that matters; start elsewhere"
            result = optx.RESULTS.stagnation
            break
        mean = MEAN * mean + (1 - MEAN) * downhill
        square = SQUARE * square + (1 - SQUARE) * downhill**2
        # Adam's bias-corrected root mean square, of the largest component instead of each its own.
        scale = math.sqrt(square.max() / (1 - SQUARE ** (step + 1))) + 1e-12
        moved = moved - rate * _share(step, num_steps) * mean / (1 - MEAN ** (step + 1)) / scale
    if not reason:
        # Short steps lose little wherever they are, so their loss is scaled to steps as long as the first.
        last = max(1, num_steps // 10)
        shares = sum(_share(step, num_steps) for step in range(num_steps - last, num_steps)) / last
        left = (losses[-1 - last] - losses[-1]) / losses[0] / shares
        reason = (
            f"{num_steps} steps are done; the last {last} lowered the loss by {left:.1%} of the first, for full rate"
        )
        if abs(left) >= SETTLED:
            reason, result = f"{reason}: raise num_steps", optx.RESULTS.nonlinear_max_steps_reached
    finite = bool(result != optx.RESULTS.nonfinite)
    certificate = DescentCertificate(np.array(losses), np.stack(places), tuple(others), finite, reason)
    start_loss, loss = (jnp.asarray(losses[i], float) for i in (0, -1))
    return Solution(places[-1], loss, {"start": start_loss}, certificate, result, None, _KIND)


def _share(step: int, num_steps: int) -> float:
    """Part of the first rate that a step has."""
    return 0.55 + 0.45 * math.cos(math.pi * step / num_steps)


__all__ = ["DescentCertificate", "LossAndSlope", "descend", "diffuser"]
