"""Convex polygons cut by planes: shared new corners on every side, so that the pieces still fit together."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

# A polygon under way: its corners, and for each corner the line that the side to the next corner lies on.
Ring = tuple[list[int], list[int]]


@dataclass
class Cutter:
    """Corners and lines of polygons that are being cut.

    Every side lies on a *line*: an edge of the input, or a cut. A new corner belongs to a line and is made once for
    each plane, from the line's own ends, so all polygons along the line get the same corner to the last bit. In the
    end the corners on a line are known in order, and a polygon that misses one can take it up: that repairs the
    T-junctions.

    Attributes:
        points: Corner positions, world units.
        tolerance: Corners closer than this are one, world units.
        planes: (planes, 4) normals and offsets: n·x + d is the signed distance.
        ends: The two corners at the ends of every line.
        places: For each line, its corners and their places along it: 0 at the first end, 1 at the second.
    """

    points: list[np.ndarray]
    tolerance: float
    planes: np.ndarray
    ends: list[tuple[int, int]] = field(default_factory=list)
    places: list[dict[int, float]] = field(default_factory=list)
    _lines: dict[tuple[int, int], int] = field(default_factory=dict)
    _cuts: dict[tuple[int, int], int] = field(default_factory=dict)

    def line_of(self, i: int, j: int) -> int:
        """The line of an input edge, whichever way it is walked."""
        key = (min(i, j), max(i, j))
        if key not in self._lines:
            self._lines[key] = self._new_line(*key)
        return self._lines[key]

    def ring(self, corners: Sequence[int]) -> Ring:
        """An input polygon as a ring."""
        follow = [*corners[1:], corners[0]]
        return list(corners), [self.line_of(i, j) for i, j in zip(corners, follow, strict=True)]

    def split(self, ring: Ring, plane: int, distances: Sequence[float]) -> tuple[Ring, Ring]:
        """The parts of a ring before and behind a plane.

        Args:
            ring: A convex polygon with corners on both sides.
            plane: Index of the plane.
            distances: Signed distance of every corner, 0 within the tolerance.
        """
        corners, lines = ring
        front: Ring = ([], [])
        back: Ring = ([], [])
        on_plane: list[int] = []
        # The cut itself is a new line, shared by both parts; its ends are known after the walk.
        chord = len(self.ends)
        for at, (corner, line, here) in enumerate(zip(corners, lines, distances, strict=True)):
            # One walk round the ring: each corner, then the crossing on the side behind it, if there is one.
            before, after = distances[at - 1], distances[(at + 1) % len(corners)]
            if here == 0 and before * after < 0:
                on_plane.append(corner)
            for part, sign in ((front, 1.0), (back, -1.0)):
                # A corner on the plane belongs to the parts it has neighbours in.
                if sign * here > 0 or (here == 0 and max(sign * before, sign * after) > 0):
                    part[0].append(corner)
                    part[1].append(line if sign * here > 0 or sign * after >= 0 else chord)
            if here * after < 0:
                made = self._cut(line, plane)
                on_plane.append(made)
                entered, left = (front, back) if after > 0 else (back, front)
                entered[0].append(made)
                entered[1].append(line)
                left[0].append(made)
                left[1].append(chord)
        if len(on_plane) < 2:  # a sliver, within the tolerance of the plane
            on_plane = [corners[int(np.argmin(np.abs(distances)))]] * 2
        self._new_line(on_plane[0], on_plane[-1])
        return _without_repeats(front), _without_repeats(back)

    def repaired(self, ring: Ring) -> Ring:
        """The ring with every corner that other polygons have on its sides."""
        corners: list[int] = []
        lines: list[int] = []
        for at, (corner, line) in enumerate(zip(*ring, strict=True)):
            after = ring[0][(at + 1) % len(ring[0])]
            places = self.places[line]
            # A side within the tolerance of a cut may run between corners of two lines; it has nothing to take up.
            start, end = places.get(corner, 0.0), places.get(after, 0.0)
            low, high = min(start, end), max(start, end)
            between = [(place, other) for other, place in places.items() if low < place < high]
            between.sort(reverse=start > end)
            corners += [corner, *(other for _, other in between)]
            lines += [line] * (1 + len(between))
        return corners, lines

    def _new_line(self, i: int, j: int) -> int:
        self.ends.append((i, j))
        self.places.append({i: 0.0, j: 1.0})
        return len(self.ends) - 1

    def _cut(self, line: int, plane: int) -> int:
        """The corner where a plane crosses a line."""
        if (line, plane) in self._cuts:
            return self._cuts[line, plane]
        first, second = (self.points[end] for end in self.ends[line])
        normal, offset = self.planes[plane, :3], self.planes[plane, 3]
        one, two = float(normal @ first + offset), float(normal @ second + offset)
        # Linear interpolation of the signed distances of the line's own ends, not of the piece's.
        place = one / (one - two)
        point = first + place * (second - first)
        length = float(np.linalg.norm(second - first))
        # Two planes that cross a line at one place, within the tolerance along it, make one corner.
        near = [other for other, at in self.places[line].items() if abs(at - place) * length <= self.tolerance]
        if near:
            made = near[0]
        else:
            made = len(self.points)
            self.points.append(point)
            self.places[line][made] = place
        self._cuts[line, plane] = made
        return made


def _without_repeats(ring: Ring) -> Ring:
    """The ring without sides from a corner to itself."""
    keep = [at for at in range(len(ring[0])) if ring[0][at] != ring[0][(at + 1) % len(ring[0])]]
    return [ring[0][at] for at in keep], [ring[1][at] for at in keep]
