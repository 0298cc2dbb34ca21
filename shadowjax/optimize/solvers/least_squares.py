"""Levenberg–Marquardt least squares from several starts: parameters recovered from pictures, with a certificate."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int, require_untraced
from shadowjax._types import Array, ArrayLike, Float
from shadowjax.optimize.solution import Solution, SolutionKind

# Damping, as a part of each parameter's own curvature: at first, and how it changes.
DAMPING, LOWER, RAISE, STUCK = 1e-2, 0.2, 6.0, 1e10

Residual = Callable[[Float[Array, "parameters"]], Float[Array, "residuals"]]


class RecoveryCertificate(Checked):
    """What a search found on its way, and why it ended.

    Attributes:
        history: Parameters after every accepted step from the best start, the start first.
        losses: Their losses.
        solved: Whether the loss is at most the one asked for.
        reason: Why the search from the best start ended.
        tried: Number of starts that were used.
    """

    history: np.ndarray
    losses: np.ndarray
    solved: bool = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    tried: int = eqx.field(static=True)


_KIND = SolutionKind(
    (
        ("parameters", "value"), ("loss", "objective_value"), ("baselines", "baselines"), ("gain", "gain"),
        ("certificate", "certificate"), ("result", "text"),
    ),
    rival="start",
)  # fmt: skip


@checked
@eqx.filter_jit
def linearized(residual: Residual, parameters: Float[Array, "parameters"]) -> tuple[Array, Array]:
    """Residuals and their derivative in every parameter, forward mode: one program for each `residual`.

    Give an `eqx.Module` with a `__call__`, or a function made once: another closure compiles again.
    """
    # One derivative at a time: memory is that of one.
    found, forward = jax.linearize(residual, parameters)
    return found, jax.lax.map(forward, jnp.eye(parameters.shape[0], dtype=parameters.dtype)).T


@checked
def recover(
    residual: Residual,
    starts: Iterable[ArrayLike],
    target: float = 0.0,
    max_steps: int = 60,
    tolerance: float = 1e-10,
) -> Solution[np.ndarray, RecoveryCertificate]:
    """Least squares by Levenberg and Marquardt from one start after another, until one reaches `target`.

    A picture of a shadow has many minima: where shadows do not overlap, nothing says which way to go. Blur the
    difference of pictures, and give several starts.

    Args:
        residual: Parameters → residuals, differentiable: differences of pictures, for example.
        starts: Parameters to begin with, in the order in which they are tried.
        target: Loss that ends the search, ≥ 0.
        max_steps: Largest number of accepted and refused steps from each start, ≥ 1.
        tolerance: Relative size of a step or of the loss's fall that counts as none, > 0.

    Returns:
        Of the best start, `value` the parameters; `objective_value` the loss, half the sum of squared residuals;
        `baselines` "start". Not converged means that steps ran out, or that no parameter has any influence;
        `certificate.reason` says which.

    Raises:
        ValueError: If there is no start, or a start is not a vector of finite numbers.
    """
    require(target >= 0, f"target must not be negative; got {target}")
    require(tolerance > 0, f"tolerance must be positive; got {tolerance}")
    require_int(max_steps, "max_steps", 1)
    best, tried = None, 0
    for start in starts:
        require_untraced("recover", start)
        first = jnp.asarray(start)
        require(first.ndim == 1, f"a start must be a vector; got shape {first.shape}")
        require(bool(jnp.all(jnp.isfinite(first))), f"a start must hold finite numbers; got {first}")
        tried += 1
        found = _descend(residual, first, target, max_steps, tolerance)
        if best is None or found.losses[-1] < best.losses[-1]:
            best = found
        if best.losses[-1] <= target:
            break
    require(best is not None, "starts must hold at least one vector")
    assert best is not None
    losses = np.array(best.losses)
    certificate = RecoveryCertificate(np.stack(best.history), losses, bool(losses[-1] <= target), best.reason, tried)
    before = {"start": jnp.asarray(losses[0])}
    return Solution(best.history[-1], jnp.asarray(losses[-1]), before, certificate, best.result, None, _KIND)


class _Way(NamedTuple):
    """Parameters and losses from one start on, and why no more followed."""

    history: list[np.ndarray]
    losses: list[float]
    reason: str
    result: Any


def _descend(residual: Residual, start: Array, target: float, max_steps: int, tolerance: float) -> _Way:
    """Levenberg–Marquardt from one start."""
    at, damping = start, DAMPING
    rest, slopes, loss = _evaluate(residual, at)
    require(bool(np.isfinite(loss)), f"residuals at the start {start} are not finite")
    history, losses = [np.asarray(at)], [loss]
    reason, result = f"no end after {max_steps} steps; raise max_steps", optx.RESULTS.nonlinear_max_steps_reached
    good = optx.RESULTS.successful
    for _ in range(max_steps):
        # Gauss–Newton: with residuals r and Jacobian J, Jᵀr is the gradient of ½|r|² and JᵀJ stands for its Hessian.
        gradient, curvature = slopes.T @ rest, slopes.T @ slopes
        scale = np.diag(curvature)
        if loss <= target:
            reason, result = "the loss is as small as asked for", good
            break
        if not scale.any():
            reason = "no parameter changes the residuals here; start elsewhere, or blur"
            result = optx.RESULTS.stagnation
            break
        # Marquardt's damping, relative to each parameter's own curvature; one without influence stays where it is.
        damped = curvature + damping * np.diag(np.maximum(scale, 1e-9 * scale.max()))
        step = -np.linalg.solve(damped, gradient)
        there = at + jnp.asarray(step, at.dtype)
        new_rest, new_slopes, new_loss = _evaluate(residual, there)
        if new_loss < loss:
            # An accepted step lowers the damping towards Gauss–Newton, a refused one raises it towards gradient
            # descent.
            fall = 1 - new_loss / loss
            at, rest, slopes, loss = there, new_rest, new_slopes, new_loss
            history.append(np.asarray(at))
            losses.append(loss)
            damping *= LOWER
            if fall < tolerance or np.linalg.norm(step) < tolerance * (1 + np.linalg.norm(np.asarray(at))):
                reason, result = "steps no longer lower the loss: a minimum, perhaps a local one", good
                break
        else:
            damping *= RAISE
            if damping > STUCK:
                reason, result = "no step lowers the loss: a minimum, perhaps a local one", good
                break
    if loss <= target:
        reason, result = "the loss is as small as asked for", good
    return _Way(history, losses, reason, result)


def _evaluate(residual: Residual, parameters: Array) -> tuple[np.ndarray, np.ndarray, float]:
    """Residuals, their derivative and the loss, in double precision; an infinite loss where one is not finite."""
    rest, slopes = (np.asarray(part, np.float64) for part in linearized(residual, parameters))
    finite = np.isfinite(rest).all() and np.isfinite(slopes).all()
    return rest, slopes, 0.5 * float(rest @ rest) if finite else float("inf")


__all__ = ["RecoveryCertificate", "Residual", "linearized", "recover"]
