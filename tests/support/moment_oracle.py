"""The sharp bound from four moments: by Hankel matrices in 80 bits, and by linear programmes whose grid closes in."""

import numpy as np
from scipy.optimize import linprog

LONG = np.longdouble


def cofactors(moments):
    """Cofactors of the Hankel matrix of 1, E[z] … E[z⁴], and its determinant."""
    m = [np.ones_like(moments[0]), *moments]
    h = [[m[i + j] for j in range(3)] for i in range(3)]
    cofactor = np.empty((*moments[0].shape, 3, 3), LONG)
    for i in range(3):
        for j in range(3):
            r, c = [k for k in range(3) if k != i], [k for k in range(3) if k != j]
            cofactor[..., i, j] = (-1) ** (i + j) * (h[r[0]][c[0]] * h[r[1]][c[1]] - h[r[0]][c[1]] * h[r[1]][c[0]])
    return cofactor, sum(h[0][j] * cofactor[..., 0, j] for j in range(3))


def hamburger(moments, depth):
    """1 − weight before t of the distribution on t and the roots of v(x)ᵀH⁻¹v(t); and the two roots."""
    moments, t = [np.asarray(m, LONG) for m in moments], np.asarray(depth, LONG)
    cofactor, determinant = cofactors(moments)
    c0, c1, c2 = np.moveaxis(np.einsum("...ij,j...->...i", cofactor, np.stack([t**0, t, t * t])), -1, 0)
    root = np.sqrt(np.maximum(c1 * c1 - 4 * c0 * c2, 0))
    half = -(c1 + np.where(c1 >= 0, root, -root)) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        partners = half / c2, c0 / half
        before = 0
        for x in partners:
            v = np.stack([x**0, x, x * x])
            weight = determinant / np.einsum("i...,...ij,j...->...", v, cofactor, v)
            before = before + np.where(np.isfinite(x) & (x < t), weight, 0)
    return 1 - before, partners


def hausdorff(moments, depth):
    """As `hamburger` within [−1, 1]: where a root lies outside, weights of −1, x, t, 1 by Cramer's rule."""
    bound, partners = hamburger(moments, depth)
    inside = np.all([np.isfinite(x) & (np.abs(x) <= 1) for x in partners], axis=0)
    b1, b2, b3, b4 = (np.asarray(m, LONG) for m in moments)
    t = np.asarray(depth, LONG)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (b4 - t * b3 - b2 + t * b1) / (b3 - t * b2 - b1 + t)
        # E[(1 − z)(t − z)(z − x)] and E[(1 − z²)(t − z)] give the weights of −1 and x
        first = (t - b1) * -x + (t * b1 - b2) - (-x * (t * b1 - b2) + (t * b2 - b3))
        second = (t - b1) - (t * b2 - b3)
        before = first / (2 * (t + 1) * (-1 - x)) + np.where(x < t, second / ((1 - x * x) * (t - x)), 0)
    return np.where(inside, bound, 1 - before)


def programme(moments, depth, rounds=5):
    """Largest share at or beyond t over distributions on [−1, 1] with these moments, on grids that close in.

    Each round puts a finer grid round every point that the last solution used.
    """
    target = np.asarray([1, *moments], float)
    grid, width = np.linspace(-1, 1, 201), 0.01
    for _ in range(rounds):
        grid = np.unique(np.append(np.clip(grid, -1, 1), (-1.0, 1.0, depth)))
        basis = np.polynomial.chebyshev.chebvander(grid, 4).T
        fit = linprog(
            -(grid >= depth).astype(float), A_eq=basis, b_eq=_chebyshev(target), method="highs",
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )  # fmt: skip
        assert fit.status == 0
        used = grid[fit.x > 0]
        width /= 16
        grid = np.concatenate([used + width * k for k in range(-20, 21)])
    return -fit.fun


def _chebyshev(moments):
    """E of the first five Chebyshev polynomials."""
    one, b1, b2, b3, b4 = moments
    return np.asarray([one, b1, 2 * b2 - one, 4 * b3 - 3 * b1, 8 * b4 - 8 * b2 + one])
