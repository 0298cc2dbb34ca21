"""Optimal near distances in 80-bit arithmetic from the corners of the frustum, and differences of whole new solutions.

Nothing of the package is used: offsets are projections of the frustum's corners, errors are largest over both sections'
candidate points, and the sign of the slope of whatever point leads is bisected. Its active set is told too.
"""

import numpy as np

LONG = np.longdouble
FLAT = 8 * float(np.finfo(LONG).eps)
STEP = LONG(2e-5)  # of differences of fourth order: truncation and rounding both stay below 1e-11


def _points(near, far, phi, gamma):
    """Offsets along z' of corners and axis ends above the lowest corner: height (-, 0, +) × (near, far); depths; W."""
    depth = np.stack([near, far])
    height = np.stack([-depth, 0 * depth, depth]) * np.tan(phi)
    along = height * np.cos(gamma) + depth * np.sin(gamma)
    offset = along - along.min(axis=(0, 1))
    return depth, offset, along.max(axis=(0, 1)) - along.min(axis=(0, 1))


def pieces(view, x, section):
    """ln of all candidates of m_x and of m_z at ln n' = x, up to constants alike for all, and their slopes by x."""
    phi = view[2]
    depth, offset, extent = _points(*view)
    strength = np.exp(-x)
    # at one depth the farthest point along z' is the worst
    worst = offset[1] if section == "axis" else offset.max(axis=0)
    stretch, highest = (np.log1p(o * strength) for o in (offset, worst))
    pull, steepest = (-o * strength / (1 + o * strength) for o in (offset, worst))
    points = [(highest[k] - np.log(depth[k]), steepest[k], highest[k], steepest[k]) for k in (0, 1)]
    texel = np.log(extent / (2 * np.tan(phi))) - np.log1p(extent * strength)
    texel_pull = extent * strength / (1 + extent * strength)
    z = [(texel + first + again, texel_pull + 2 * slope) for first, slope, again, _ in points]
    x_pieces = [
        (np.log(depth[k]) - stretch[i, k] + first, slope - pull[i, k])
        for i in (0, 2) for k in (0, 1) for first, slope, *_ in points
    ]  # fmt: skip
    return tuple((np.stack([a for a, _ in part]), np.stack([b for _, b in part])) for part in (x_pieces, z))


def leader(view, x, objective, section):
    """ln of the objective, its slope by ln n', and which candidate leads."""
    across, along = pieces(view, x, section)
    picked = []
    for values, slopes in (across, along):
        index = values.argmax(axis=0)[None]
        picked.append([np.take_along_axis(part, index, 0)[0] for part in (values, slopes)] + [index[0]])
    (x_value, x_slope, x_index), (z_value, z_slope, z_index) = picked
    if objective == "z":
        return z_value, z_slope, z_index
    if objective == "storage":
        return x_value + z_value, x_slope + z_slope, 100 * (1 + x_index) + z_index
    larger = x_value > z_value
    index = np.where(larger, 100 * (1 + x_index), z_index)
    return np.where(larger, x_value, z_value), np.where(larger, x_slope, z_slope), index


def solve(view, objective, section):
    """ln n', ln of the objective, and the active set: who leads below and above, -1 for the uniform map."""
    view = tuple(np.asarray(part, LONG) for part in view)
    _, _, extent = _points(*view)
    top = np.log(extent * LONG(4 / np.finfo(float).eps))
    low, high = np.log(view[0]) - np.log(LONG(1e6)), top
    for _ in range(90):
        middle = (low + high) / 2
        up = leader(view, middle, objective, section)[1] > FLAT * np.minimum(extent * np.exp(-middle), 1)
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    uniform = high >= top
    x = np.where(uniform, top, (low + high) / 2)
    before, after = leader(view, low, objective, section)[2], leader(view, high, objective, section)[2]
    active = np.where(uniform, -1, 100_000 * before + after)
    return x, leader(view, x, objective, section)[0], active


def differences(answer, view, index, scale):
    """Central and one-sided differences of `answer(view)`, several arrays of numbers, along one number of the views."""

    def moved(steps):
        changed = [np.asarray(part, LONG) for part in view]
        changed[index] = changed[index] + steps * STEP * scale
        return np.stack(answer(tuple(changed)))

    at = {k: moved(k) for k in range(-4, 5)}
    central = (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * STEP * scale)
    right, left = (
        side * sum(w * at[side * k] for k, w in enumerate((-25, 48, -36, 16, -3))) / (12 * STEP * scale)
        for side in (1, -1)
    )
    return central, left, right
