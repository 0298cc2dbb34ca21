"""First principles once more, in NumPy: warps of many views from the corners of their frusta, optima by search.

No function of the package is called. A view is a frustum with its light, as arrays that broadcast: a view's corners are
taken to light space one by one, P is built around them, and errors are looked for along depth and across the section.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

GOLDEN = (5**0.5 - 1) / 2


class View(NamedTuple):
    """Near and far depth, tangents of half the angles of view, γ in radians; all broadcast."""

    near: np.ndarray
    far: np.ndarray
    tan_y: np.ndarray
    tan_x: np.ndarray
    gamma: np.ndarray

    def height(self, z, y):
        """z' of points of the section, from the camera."""
        return y * np.cos(self.gamma) + z * np.sin(self.gamma)

    def corners(self):
        """z' of the section's four corners, along a new first axis: near bottom and top, far bottom and top."""
        ends = (self.near, self.near, self.far, self.far)
        signs = (-1, 1, -1, 1)
        return np.stack(
            np.broadcast_arrays(*(self.height(z, s * z * self.tan_y) for z, s in zip(ends, signs, strict=True)))
        )

    def lights(self, gamma):
        """The same view under other lights."""
        return self._replace(gamma=np.asarray(gamma, float))


def _points(view: View, section: str, depths: int):
    """Depths and z' over the lowest corner of points on the axis, or at three heights, at `depths` depths."""
    for share in np.linspace(0, 1, depths):
        z = view.near * (view.far / view.near) ** share
        for slope in (0.0,) if section == "axis" else (-1.0, 0.0, 1.0):
            yield z, view.height(z, slope * z * view.tan_y) - view.corners().min(axis=0)


def max_error_z(view: View, distance, section: str = "axis", depths: int = 3):
    """M_z of a perspective warp: thickness of a texel across the light, over that of a pixel, at its largest."""
    corners = view.corners()
    extent = corners.max(axis=0) - corners.min(axis=0)
    # t = (f'/(f' − n'))·(1 − n'/z'), so dz'/dt = z'²·(f' − n')/(f'·n')
    errors = [
        (distance + rise) ** 2 * extent / (distance * (distance + extent)) / (2 * z * view.tan_y)
        for z, rise in _points(view, section, depths)
    ]
    return np.max(np.broadcast_arrays(*errors), axis=0)


def max_error_x(view: View, distance, section: str = "axis", depths: int = 3):
    """M_x of the same warp, whose P is as narrow as the corners allow."""
    corners = view.corners()
    reach = [z * view.tan_x for z in (view.near, view.near, view.far, view.far)]
    # P opens linearly from its centre n' below the lowest corner: its tangent is the largest x/z' of the corners.
    rises = corners - corners.min(axis=0)
    opening = np.max([x / (distance + rise) for x, rise in zip(reach, rises, strict=True)], axis=0)
    errors = [opening * (distance + rise) / (z * view.tan_x) for z, rise in _points(view, section, depths)]
    return np.max(np.broadcast_arrays(*errors), axis=0)


def storage(view: View, distance, section: str = "axis"):
    """M_x·M_z."""
    return max_error_x(view, distance, section) * max_error_z(view, distance, section)


def max_error_log(view: View, distance, section: str = "axis"):
    """M_z of the logarithmic warp t = ln(1 + u/c)/ln(1 + W/c)."""
    corners = view.corners()
    extent = corners.max(axis=0) - corners.min(axis=0)
    errors = [
        (rise + distance) * np.log(1 + extent / distance) / (2 * z * view.tan_y)
        for z, rise in _points(view, section, 3)
    ]
    return np.max(np.broadcast_arrays(*errors), axis=0)


def least(function: Callable, low: float, high: float, shape: tuple[int, ...] = (), steps: int = 90):
    """Least value of functions of one positive number with one minimum each, by golden section of its logarithm."""
    a, b = np.full(shape, np.log(low)), np.full(shape, np.log(high))
    for _ in range(steps):
        left, right = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        # The minimum lies in the part that holds the lower of two inner points; both are evaluated anew, which
        # vectorises.
        lower = function(np.exp(left)) <= function(np.exp(right))
        a, b = np.where(lower, a, left), np.where(lower, right, b)
    return function(np.exp((a + b) / 2))


def bisected(function: Callable, low, high, steps: int = 64):
    """Where increasing functions change their signs."""
    low, high = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    for _ in range(steps):
        middle = (low + high) / 2
        negative = function(middle) < 0
        low, high = np.where(negative, middle, low), np.where(negative, high, middle)
    return (low + high) / 2


def touching(view: View):
    """γ at which the line from the near plane's top to the far plane's bottom runs across the light."""
    return np.arctan2((view.near + view.far) * view.tan_y, view.far - view.near)


def equalising(view: View, section: str = "axis"):
    """n' with (n' + E)²/n = (n' + F)²/f, E and F the heights of the worst line's ends over the lowest corner."""
    lowest, top = view.corners().min(axis=0), 1.0 if section == "whole" else 0.0
    at_near, at_far = (view.height(z, top * z * view.tan_y) - lowest for z in (view.near, view.far))
    # The roots of both sides are linear in n'.
    return (at_far * np.sqrt(view.near) - at_near * np.sqrt(view.far)) / (np.sqrt(view.far) - np.sqrt(view.near))


def minimax(view: View, section: str = "axis"):
    """n' of least M_z: the equalising one, or where the near plane's own error stops to fall."""
    corners = view.corners()
    lowest, top = corners.min(axis=0), 1.0 if section == "whole" else 0.0
    rise = view.height(view.near, top * view.near * view.tan_y) - lowest
    extent = corners.max(axis=0) - lowest

    def slope(log_q):
        q = np.exp(log_q)
        # d/dn' of ln((n' + E)²/(n'(n' + W))), the near end's error: it falls, then rises.
        return 2 / (q + rise) - 1 / q - 1 / (q + extent)

    turn = np.exp(bisected(slope, np.log(1e-9 * view.near), np.log(1e12 * view.far)))
    return np.maximum(equalising(view, section), turn)


def published(view: View, rule: str):
    """n'(γ) of eq. 42 with the fade of 43 or 44 as printed, or Wimmer's n'/sin γ."""
    if rule == "Wimmer":
        return equalising(view.lights(np.full(np.shape(view.gamma), np.pi / 2))) / np.sin(view.gamma)
    limit = touching(view)
    # π/2·γ/γ_lim, and the printed fades of it.
    share = np.minimum(view.gamma / limit, 1) * np.pi / 2
    fade = np.sin(share) if rule.endswith("43") else (1 + np.sin(share - np.pi / 2)) ** 2
    return np.where(view.gamma >= limit, equalising(view), equalising(view.lights(limit)) / fade)
