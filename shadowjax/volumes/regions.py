"""Crossings as convex regions: seen from an eye, a point lies beyond a quad or a cap iff it lies in one.

A segment from the eye to a point crosses a wall of a shadow volume iff the point lies behind that wall, within its
outline: in a region bounded by the planes through the eye and the wall's sides and by the wall's own plane. So counting
crossings is counting regions that hold a point, and every sum of the stencil buffer is one such count.

Planes are tested as ≥ 0 or its negation, never as > 0 against < 0, and two walls that meet test the same numbers: a
point on their common border lies in exactly one of the two. Vertices may be integers; then nothing is rounded.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Num

from shadowjax._checked import Checked, checked
from shadowjax._types import Array, Bool, Int
from shadowjax.volumes.extrude import VolumeEdges, at_infinity, cross, edge_weights, face_signs, inner

# Regions tested in one pass over the points.
UNROLL = 4


class Regions(Checked):
    """Convex regions of space, relative to an eye, each with a weight.

    Attributes:
        planes: Normal and offset of each bounding plane; a point x has the value normal·x + offset.
        sides: True where the region has values ≥ 0, False where it has values < 0.
        weights: What a point inside counts.
        corners: Directions from the eye whose convex cone holds the region's outline.
    """

    planes: Num[Array, "n k 4"]
    sides: Bool[Array, "n k"]
    weights: Int[Array, "n"]
    corners: Num[Array, "n 4 3"]

    def __add__(self, other: "Regions") -> "Regions":
        """Both lists."""
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), self, other)


class Boundary(Checked):
    """All planes of a mesh's shadow volumes, relative to an eye; each number exists once, whoever tests it.

    Attributes:
        edges: The edges.
        signs: How each face casts.
        has_place: Whether the light is a point (w ≠ 0) rather than a direction.
        corners: Vertices relative to the eye.
        away: Where the light throws each vertex.
        lines: Normal of the plane through the eye and each vertex's extruded line.
        fronts: Normal of the plane through the eye and each edge.
        walls: Normal and offset of each quad's plane, which holds the light and the edge.
        faces: Corners of each face.
        caps: Normal and offset of each face's plane.
    """

    edges: VolumeEdges
    signs: Int[Array, "faces"]
    has_place: Bool[Array, ""]
    corners: Num[Array, "vertices 3"]
    away: Num[Array, "vertices 3"]
    lines: Num[Array, "vertices 3"]
    fronts: Num[Array, "edges 3"]
    walls: Num[Array, "edges 4"]
    faces: Int[Array, "faces 3"]
    caps: Num[Array, "faces 4"]

    def held_back(self, roundings: float) -> "Boundary":
        """The same with the faces' planes farther from the eye by a number of roundings of their offsets.

        A face then throws no shadow on what may lie on it. The offset is taken at the corner that leaves the least to
        rounding: from a wide floor that lies level nothing is lost.
        """
        normal = self.caps[:, :3]
        # Products whose sum is the offset, at each of the three corners: rounding is a share of their sizes.
        parts = normal[:, None] * self.corners[self.faces]
        size = jnp.sum(jnp.abs(parts), axis=-1)
        best = jnp.argmin(size, axis=1)[:, None]
        offset = -jnp.take_along_axis(jnp.sum(parts, axis=-1), best, axis=1)
        doubt = roundings * jnp.finfo(normal.dtype).eps * jnp.take_along_axis(size, best, axis=1)
        offset = jnp.where(offset >= 0, offset + doubt, offset - doubt)
        return eqx.tree_at(lambda b: b.caps, self, jnp.concatenate([normal, offset], axis=1))

    def wall_regions(self, beyond: bool) -> Regions:
        """Regions of points whose segment from the eye crosses a wall; with `beyond`, whose ray does so behind them.

        Weights are what the shadow count gains towards the point. With `beyond` they are what is lost on the rest of
        the ray, negated, so that they too are added.
        """
        first, second = self.edges.ends[:, 0], self.edges.ends[:, 1]
        front_side = self.walls[:, 3] >= 0
        total = edge_weights(self.edges, self.signs)
        # A wall without area (an edge without length, or along the light's ray) is no wall.
        total = jnp.where(jnp.any(self.walls[:, :3] != 0, axis=-1), total, 0)
        planes = [_through_eye(part) for part in (self.lines[first], self.lines[second], self.fronts)]
        sides = [~front_side, front_side, front_side]
        # The wall's quad; its far corners are directions, which bound the same cone from the eye.
        outline = jnp.stack([self.corners[first], self.corners[second], self.away[second], self.away[first]], axis=1)
        # Seen from its other side a wall is crossed the other way: its weight changes sign with the eye's side.
        return _crossed(planes, sides, self.walls, jnp.where(front_side, total, -total), outline, beyond)

    def cap_regions(self, beyond: bool) -> Regions:
        """The same for the light caps: the casting faces themselves."""
        front_side = self.caps[:, 3] >= 0
        planes, sides = [], []
        for k in range(3):
            planes.append(_through_eye(self.fronts[self.edges.side_edges[:, k]]))
            sides.append((self.edges.side_signs[:, k] > 0) ^ front_side)
        outline = self.corners[self.faces[:, jnp.asarray([0, 1, 2, 2])]]
        return _crossed(planes, sides, self.caps, jnp.where(front_side, self.signs, -self.signs), outline, beyond)

    def far_regions(self) -> Regions:
        """Directions that end inside a volume: its cap at infinity. A directional light's has no extent."""
        planes, sides = self._side_planes()
        # Two empty planes bring the number of planes to that of walls, so that lists can be joined.
        zero = jnp.zeros_like(planes[0])
        planes = [_through_eye(plane[:, :3]) for plane in planes] + [zero, zero]
        sides = [*sides, jnp.ones_like(sides[0]), jnp.ones_like(sides[0])]
        weights = jnp.where(self.has_place, jnp.abs(self.signs), 0)
        outline = self.away[self.faces[:, jnp.asarray([0, 1, 2, 2])]]
        return Regions(jnp.stack(planes, 1), jnp.stack(sides, 1), weights, outline)

    def volumes(self) -> Regions:
        """The volume of every casting face itself: points behind the face, in the cone from the light."""
        planes, sides = self._side_planes()
        outline = self.corners[self.faces[:, jnp.asarray([0, 1, 2, 2])]]
        return Regions(
            jnp.stack([*planes, self.caps], 1), jnp.stack([*sides, self.signs < 0], 1), jnp.abs(self.signs), outline
        )

    def _side_planes(self) -> tuple[list[Array], list[Array]]:
        edges = [self.edges.side_edges[:, k] for k in range(3)]
        return [self.walls[e] for e in edges], [self.edges.side_signs[:, k] * self.signs < 0 for k in range(3)]


@checked
def boundary(
    vertices: Num[Array, "vertices 3"],
    faces: Int[Array, "faces 3"],
    edges: VolumeEdges,
    light: Num[Array, "4"],
    eye: Num[Array, "3"],
    casters: str = "both",
) -> Boundary:
    """All planes of the shadow volumes of a mesh.

    Args:
        vertices: Positions; integers give exact counts, as long as cubes of coordinates fit their type.
        faces: Corners of each face.
        edges: From `volume_edges`.
        light: Homogeneous position (x, y, z, w), see `Light.homogeneous`.
        eye: Where segments start.
        casters: "both", or "facing" for only the faces whose outer side the light sees.
    """
    seen, away = vertices - eye, at_infinity(vertices, light)
    first, second = edges.ends[:, 0], edges.ends[:, 1]
    step = vertices[second] - vertices[first]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return Boundary(
        edges,
        face_signs(vertices, faces, light, casters),
        light[3] != 0,
        seen,
        away,
        # From differences: the product of two nearly parallel vectors would lose what is short between them, here the
        # light as the eye sees it (away = w·seen + that), there the edge.
        lines=cross(seen, jnp.broadcast_to(at_infinity(eye, light), seen.shape)),
        fronts=cross(seen[first], step),
        walls=_plane(cross(away[first], step), seen[first]),
        faces=faces,
        caps=_plane(cross(b - a, c - a), seen[faces[:, 0]]),
    )


def _plane(normal: Num[Array, "n 3"], point: Num[Array, "n 3"]) -> Num[Array, "n 4"]:
    return jnp.concatenate([normal, -inner(normal, point)[:, None]], axis=-1)


def _through_eye(normal: Num[Array, "n 3"]) -> Num[Array, "n 4"]:
    return jnp.concatenate([normal, jnp.zeros_like(normal[:, :1])], axis=-1)


def _crossed(
    planes: list[Array], sides: list[Array], own: Array, weights: Array, outline: Array, beyond: bool
) -> Regions:
    """Regions behind a piece of the boundary as the eye sees it, or before it."""
    front_side = own[:, 3] >= 0
    if beyond:
        # The ray runs towards the plane, and the point lies on the eye's side of it.
        planes, sides = [*planes, _through_eye(own[:, :3]), own], [*sides, ~front_side, front_side]
        weights = -weights
    else:
        planes, sides = [*planes, own], [*sides, ~front_side]
    return Regions(jnp.stack(planes, 1), jnp.stack(sides, 1), weights, outline)


@checked
def weighted_first(regions: Regions) -> tuple[Regions, Int[Array, ""]]:
    """Regions with a weight before those without, and how many have one."""
    counts = regions.weights != 0
    order = jnp.argsort(~counts, stable=True)
    return jax.tree.map(lambda part: part[order], regions), jnp.sum(counts, dtype=jnp.int32)


@checked
def up_and_down(
    regions: Regions, points: Num[Array, "*points 3"]
) -> tuple[Int[Array, "*points"], Int[Array, "*points"]]:
    """Sums of the positive weights and of the negated negative ones of the regions that hold each point.

    Every point is tested against every region that has a weight.

    Args:
        regions: Relative to an eye.
        points: Relative to the same eye, of the planes' dtype.
    """
    regions, num = weighted_first(regions)
    spare = -regions.weights.shape[0] % UNROLL
    regions = jax.tree.map(lambda part: jnp.pad(part, [(0, spare)] + [(0, 0)] * (part.ndim - 1)), regions)
    shape = points.shape[:-1]
    x, y, z = (points[..., axis].reshape(1, -1) for axis in range(3))

    def step(block: Int[Array, ""], counts: tuple[Array, Array]) -> tuple[Array, Array]:
        up, down = counts
        for k in range(UNROLL):
            a, b, c, d = (regions.planes[block * UNROLL + k, :, axis, None] for axis in range(4))
            side = regions.sides[block * UNROLL + k, :, None]
            # All planes of one region against all points; a padded region has no weight, so its answer does not count.
            inside = jnp.all((a * x + b * y + c * z + d >= 0) == side, axis=0)
            weight = regions.weights[block * UNROLL + k]
            up = up + jnp.where(inside, jnp.maximum(weight, 0), 0)
            down = down + jnp.where(inside, jnp.maximum(-weight, 0), 0)
        return up, down

    none = jnp.zeros(x.size, jnp.int32)
    up, down = jax.lax.fori_loop(jnp.int32(0), -(-num // UNROLL), step, (none, none))
    return up.reshape(shape), down.reshape(shape)


@checked
def count_regions(regions: Regions, points: Num[Array, "*points 3"]) -> Int[Array, "*points"]:
    """Weighted number of regions that hold each point; arguments as in `up_and_down`."""
    up, down = up_and_down(regions, points)
    return up - down
