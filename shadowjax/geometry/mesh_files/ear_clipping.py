"""Polygons cut into triangles by ear clipping, so that concave ones keep their area whatever corner comes first."""

import numpy as np

from shadowjax._checks import require

# Steps of the search for ears, over all polygons of a file: a few seconds. Real polygons need some hundreds each.
MAX_STEPS = 10_000_000


class EarClipper:
    """Cuts the polygons of one file, and counts those that cross themselves.

    Attributes:
        crossing: How many polygons so far cross themselves; they have no right triangulation and are cut as fans.
    """

    def __init__(self) -> None:
        self.crossing = 0
        self._steps = 0

    def cut(self, points: np.ndarray) -> np.ndarray:
        """Triangles of polygons with the same number of corners.

        Convex polygons are fans. Others lose one ear after the other: a corner whose triangle with its neighbours
        holds no other corner. Corners are projected along the largest component of the polygon's normal, so a polygon
        that is not quite plane is cut as it is seen from there.

        Args:
            points: (polygons, corners, 3), corners ≥ 3.

        Returns:
            (polygons, corners − 2, 3) numbers of corners, each triangle turning as its polygon does.

        Raises:
            ValueError: If the search takes more than `MAX_STEPS`.
        """
        num_polygons, num_corners = points.shape[:2]
        # Fans for all at once; only polygons that are not convex are looked at one by one.
        second = np.arange(1, num_corners - 1)
        fan = np.stack([np.zeros_like(second), second, second + 1], axis=-1)
        triangles = np.broadcast_to(fan, (num_polygons, *fan.shape)).copy()
        if num_corners > 3:
            flat = _projected(points)
            for index in np.flatnonzero(~_convex(flat)):
                triangles[index] = self._clip(flat[index], fan)
        return triangles

    def notes(self) -> list[str]:
        """What a person should know about the polygons that were cut."""
        if not self.crossing:
            return []
        return [f"{self.crossing} faces cross themselves: they have no right triangles, and are cut as fans"]

    def _clip(self, flat: np.ndarray, fan: np.ndarray) -> np.ndarray:
        """Triangles of one polygon (corners, 2) that turns counter-clockwise."""
        points = flat.tolist()
        left, triangles, start = list(range(len(points))), [], 0
        while len(left) > 3:
            ear = self._ear(points, left, start)
            if ear is None:
                self.crossing += 1
                return fan
            triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
            del left[ear]
            start = ear
        triangles = np.array([*triangles, left])
        sizes = np.abs(_turn(*np.moveaxis(flat[triangles], 1, 0)))
        whole = np.sum(_turn(flat[:1], flat[1:-1], flat[2:]))
        if abs(np.sum(sizes) - whole) > 1e-9 * whole:  # ears overlap only where edges cross
            self.crossing += 1
        return triangles

    def _ear(self, points: list, left: list[int], start: int) -> int | None:
        """Place in `left` of a corner that can be cut off; None if there is none.

        Written out in Python numbers: a call for every corner would cost more than the corner.
        """
        count = len(left)
        around = [points[index] for index in left]
        turns = []
        for i in range(count):
            (ax, ay), (bx, by), (cx, cy) = around[i - 1], around[i], around[i + 1 - count]
            turns.append((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
        # Only reflex corners can lie in an ear, so only they are tested.
        hollow = [point for point, turn in zip(around, turns, strict=True) if turn <= 0]
        self._spend(count)
        for step in range(count):
            i = (start + step) % count
            if turns[i] <= 0:
                continue
            a, b, c = around[i - 1], around[i], around[i + 1 - count]
            (ax, ay), (bx, by), (cx, cy) = a, b, c
            self._spend(len(hollow))
            for point in hollow:
                x, y = point
                if (
                    (bx - ax) * (y - ay) >= (by - ay) * (x - ax)
                    and (cx - bx) * (y - by) >= (cy - by) * (x - bx)
                    and (ax - cx) * (y - cy) >= (ay - cy) * (x - cx)
                    and point not in (a, b, c)  # the two ends of a bridge to a hole lie on each other
                ):
                    break
            else:
                return i
        # A corner on the line between its neighbours, or on top of one, is cut off as a triangle without area.
        return next((i for i in range(count) if turns[i] == 0), None)

    def _spend(self, steps: int) -> None:
        self._steps += steps
        require(
            self._steps <= MAX_STEPS, "its concave faces have too many corners; triangulate them where the mesh is made"
        )


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles (..., 2) in the plane."""
    first, second = b - a, c - a
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _projected(points: np.ndarray) -> np.ndarray:
    """Corners (polygons, corners, 2) in the coordinate plane that the polygon leans least from, counter-clockwise."""
    centred = points - points[:, :1]
    normals = np.sum(np.cross(centred[:, 1:-1], centred[:, 2:]), axis=1)
    axis = np.argmax(np.abs(normals), axis=1)
    rows = np.arange(len(points))
    # The two other coordinates in cyclic order keep the sense; a negative component swaps them.
    kept = np.array([[1, 2], [2, 0], [0, 1]])[axis]
    kept = np.where(normals[rows, axis][:, None] < 0, kept[:, ::-1], kept)
    return np.take_along_axis(centred, kept[:, None, :], axis=2)


def _convex(flat: np.ndarray) -> np.ndarray:
    """Whether counter-clockwise polygons never turn right and go round once."""
    edges = np.roll(flat, -1, axis=1) - flat
    following = np.roll(edges, -1, axis=1)
    cross = edges[..., 0] * following[..., 1] - edges[..., 1] * following[..., 0]
    along = np.sum(edges * following, axis=-1)
    # Exterior angles sum to 2π for one turn, to 4π or more where the ring winds round twice.
    turned = np.sum(np.arctan2(cross, along), axis=1)
    return np.all(cross >= 0, axis=1) & (turned < 3 * np.pi)
