"""Builds a BSP tree on the host: the splitting plane of each group of polygons, chosen among some of their own."""

from dataclasses import dataclass

import numpy as np

from shadowjax.volumes._cutting import Cutter, Ring

NONE = -1


@dataclass
class Grown:
    """A tree as it leaves the builder; nodes come before their children.

    Attributes:
        planes: Index of the plane of every node.
        parents: Node above; -1 for the root.
        in_front: Whether a node lies in front of its parent's plane.
        rings: The pieces.
        sources: Input polygon of every piece.
        nodes: Node of every piece.
        num_splits: How many polygons were cut, pieces cut again included.
    """

    planes: list[int]
    parents: list[int]
    in_front: list[bool]
    rings: list[Ring]
    sources: list[int]
    nodes: list[int]
    num_splits: int = 0


def grow(cutter: Cutter, rings: list[Ring], sources: np.ndarray, balance: float, candidates: int, seed: int) -> Grown:
    """Part polygons by planes of their own until each group is one plane's.

    Args:
        cutter: Holds corners, lines and the plane of every input polygon (same index).
        rings: The polygons.
        sources: Input polygon of each ring.
        balance: Weight of balance against splits, in [0, 1].
        candidates: Planes tried for each node, ≥ 1.
        seed: Of the choice of candidates.
    """
    rng = np.random.default_rng(seed)
    pool = _Pool(cutter, rings, sources)
    grown = Grown([], [], [], [], [], [])
    waiting = [(np.arange(len(rings)), NONE, False)]
    while waiting:
        group, parent, in_front = waiting.pop()
        tried = pool.candidates(group, candidates, rng)
        ahead, behind = pool.sides(group, tried)
        # A polygon is cut where it reaches both sides; the lean is how many more lie in front than behind.
        lean = np.sum(ahead & ~behind, axis=0) - np.sum(behind & ~ahead, axis=0)
        best = int(np.argmin((1.0 - balance) * np.sum(ahead & behind, axis=0) + balance * np.abs(lean)))
        ahead, behind = ahead[:, best], behind[:, best]
        node, plane = len(grown.planes), int(tried[best])
        grown.planes.append(plane)
        grown.parents.append(parent)
        grown.in_front.append(in_front)
        for piece in group[~ahead & ~behind]:
            grown.rings.append(pool.rings[piece])
            grown.sources.append(int(pool.sources[piece]))
            grown.nodes.append(node)
        cut = group[ahead & behind]
        front, back = pool.split(cut, plane)
        grown.num_splits += len(cut)
        sides = (
            (np.concatenate([group[ahead & ~behind], front]), True),
            (np.concatenate([group[behind & ~ahead], back]), False),
        )
        # A stack instead of recursion: trees may be deeper than Python's limit.
        waiting += [(side, node, is_front) for side, is_front in sides if len(side)]
    return grown


class _Pool:
    """All polygons met so far, with corners padded to one length so that a group is classified at once."""

    def __init__(self, cutter: Cutter, rings: list[Ring], sources: np.ndarray):
        self.cutter = cutter
        self.rings = list(rings)
        self.sources = np.asarray(sources)
        width = max(len(corners) for corners, _ in rings) + 2
        self.corners = np.stack([_padded(corners, width) for corners, _ in rings])
        self.points = np.stack(cutter.points)

    def candidates(self, group: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Planes to try: of some polygons of the group, each plane once."""
        chosen = group if len(group) <= count else rng.choice(group, count, replace=False)
        return np.unique(self.sources[chosen])

    def sides(self, group: np.ndarray, planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether each polygon reaches before and behind each plane, by more than the tolerance."""
        where = self.points[self.corners[group]]
        equations = self.cutter.planes[planes]
        distance = where @ equations[:, :3].T + equations[:, 3]
        # A polygon lies in its own plane, whatever its corners' rounding says: so every node holds one at least.
        other = self.sources[group][:, None] != planes
        tolerance = self.cutter.tolerance
        return (distance.max(axis=1) > tolerance) & other, (distance.min(axis=1) < -tolerance) & other

    def split(self, group: np.ndarray, plane: int) -> tuple[np.ndarray, np.ndarray]:
        """Cut polygons by a plane; the numbers of their new pieces before and behind it."""
        if not len(group):
            return group, group
        equation, tolerance = self.cutter.planes[plane], self.cutter.tolerance
        distances = self.points[self.corners[group]] @ equation[:3] + equation[3]
        distances = np.where(np.abs(distances) <= tolerance, 0, distances)
        # New pieces are numbered behind all that exist, in the order in which they are made.
        known = len(self.rings)
        parts: tuple[list[int], list[int]] = ([], [])
        added, sources = [], []
        for piece, distance in zip(group, distances.tolist(), strict=True):
            # Rows of corners are padded to one length: only as many distances count as the ring has corners.
            ring = self.rings[piece]
            for part, made in zip(parts, self.cutter.split(ring, plane, distance[: len(ring[0])]), strict=True):
                if len(made[0]) >= 3:
                    part.append(known + len(added))
                    added.append(made)
                    sources.append(int(self.sources[piece]))
        self._extend(added, sources)
        return np.asarray(parts[0], int), np.asarray(parts[1], int)

    def _extend(self, rings: list[Ring], sources: list[int]) -> None:
        if not rings:
            return
        width = max(len(corners) for corners, _ in rings)
        if width > self.corners.shape[1]:
            more = width + 4 - self.corners.shape[1]
            self.corners = np.concatenate([self.corners, np.repeat(self.corners[:, :1], more, axis=1)], axis=1)
        self.rings += rings
        added = np.stack([_padded(corners, self.corners.shape[1]) for corners, _ in rings])
        self.corners = np.concatenate([self.corners, added])
        self.sources = np.concatenate([self.sources, sources])
        if len(self.cutter.points) > len(self.points):
            self.points = np.concatenate([self.points, np.stack(self.cutter.points[len(self.points) :])])


def _padded(corners: list[int], width: int) -> np.ndarray:
    """Corners with copies of the first behind them: they change no least or greatest distance."""
    return np.asarray(corners + corners[:1] * (width - len(corners)))
