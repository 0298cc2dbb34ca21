"""Texels against objects: how long a texel is where things stand, and the shadow distance that would shorten it."""

import dataclasses
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shadowjax._checked import checked
from shadowjax._checks import require_int
from shadowjax._numerics import norm
from shadowjax._types import Array, ArrayLike, Float, Points, Scalar
from shadowjax.evaluate.shimmer import in_view
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.partitions.base import Partition
from shadowjax.partitions.by_light import ByLight
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.techniques.base import Technique
from shadowjax.warps.stable import StableFit, bounding_sphere

# An object of fewer texels than this across has a shadow of a few stairs.
WANTED = 16
TRIED = 48  # shadow distances between the object and the far plane
MOST_OBJECTS = 512


@checked
@dataclass(frozen=True)
class TexelAdvice:
    """An object of middling size, and the texels of the map that answers there; lengths in world units.

    Attributes:
        texel: Length of the longer side of a texel, across the light.
        size: Longest side of the object's box.
        wanted: Texels that it should have across.
        distance: The largest shadow distance that gives it that many; None if none does, or slices do not depend on it.
        resolution: Texels along a side of each map that give that many at the present distance.
        far: The present one, or the camera's far plane.
    """

    texel: float
    size: float
    wanted: int
    distance: float | None
    resolution: int
    far: float

    @property
    def across(self) -> float:
        """Texels across the object."""
        return self.size / self.texel

    def __str__(self) -> str:
        remedy = f"maps of {self.resolution} texels along a side"
        if self.distance is not None:
            remedy = f"a shadow distance of {self.distance:.3g} in place of {self.far:.4g}, or {remedy},"
        return (
            f"a texel is {self.texel:.3g} long where an object {self.size:.3g} large stands, {self.across:.2g} texels "
            f"across it; {remedy} would make it {self.size / self.wanted:.2g}, {self.wanted} texels across"
        )


@checked
def stable_texel(camera: Camera, far: ArrayLike, resolution: int, steps: int = StableFit().steps) -> Scalar:
    """Length of a texel of one `StableFit` map over a view that ends at a distance, world units.

    With τ the tangent of half the angle across the image's diagonal, f·τ·2·steps/((steps − 1)·resolution) where the far
    plane's corners bound the sphere (a wide view), and in proportion to f for any view of n ≪ f.

    Args:
        camera: The view.
        far: Where shadows end, world units, > the camera's near distance.
        resolution: Texels along a side.
        steps: Of the fit.
    """
    end = jnp.asarray(far, camera.near.dtype)
    _, radius = bounding_sphere(eqx.tree_at(lambda c: c.far, camera, end))
    return 2 * radius * steps / (steps - 1) / require_int(resolution, "resolution", 1)


@checked
def objects(mesh: Mesh) -> tuple[Float[np.ndarray, "objects 3"], Float[np.ndarray, "objects"]]:
    """Middles and longest sides of the boxes of connected parts, those left out that span half the scene or more.

    Args:
        mesh: With known vertices; places that are equal count as one vertex.
    """
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    # Two sides of each triangle connect its three corners.
    sides = place.reshape(-1)[faces[:, [0, 1, 1, 2]]].reshape(-1, 2)
    number = int(place.max()) + 1
    graph = coo_matrix((np.ones(len(sides), bool), sides.T), shape=(number, number))
    part = connected_components(graph, directed=False)[1][place.reshape(-1)[faces[:, 0]]]
    count = int(part.max()) + 1
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = vertices[faces]
    np.minimum.at(lower, part, corners.min(axis=1))
    np.maximum.at(upper, part, corners.max(axis=1))
    used = np.isfinite(lower[:, 0])
    lower, upper = lower[used], upper[used]
    # What spans half the scene is ground or walls, on which no single texel looks too long.
    size = (upper - lower).max(axis=1)
    small = size < 0.5 * (upper.max(axis=0) - lower.min(axis=0)).max()
    keep = small if small.any() else np.ones_like(small)
    return 0.5 * (lower + upper)[keep], size[keep]


@checked
@eqx.filter_jit
def texel_lengths(
    partition: Partition, mesh: Mesh, light: Light, camera: Camera, resolution: int, points: Points
) -> Float[Array, "*points"]:
    """Longer side of the texel that answers for each point, across the light, world units."""
    placed = partition.fit(mesh, light, camera)
    grids = placed.grids(mesh, light, camera, resolution)
    region = placed.select(grids, camera, points)
    sides = [jnp.maximum(*(norm(step) for step in grid.cell_vectors(points))) for grid in grids]
    return jnp.take_along_axis(jnp.stack(sides), region[None], axis=0)[0]


@checked
def texel_advice(
    technique: Technique, mesh: Mesh, light: Light, camera: Camera, wanted: int = WANTED
) -> TexelAdvice | None:
    """What to do where texels are too long for the objects in view; None where they are short enough.

    The object of the median number of texels across stands for all. One map of `SingleMap(StableFit())` is the same as
    one slice of `Cascades(1, warp=StableFit(), tight=False, distance=…)`, which can end sooner.

    Args:
        technique: Shadow maps.
        mesh: The scene.
        light: The light.
        camera: The view.
        wanted: Texels across an object that are enough.
    """
    technique = technique.as_shadow_mapping("advice about texels needs")
    middles, sizes = objects(mesh)
    seen = np.flatnonzero(np.asarray(in_view(camera, jnp.asarray(middles, camera.near.dtype))))
    if len(seen) == 0:
        return None
    seen = seen[np.linspace(0, len(seen) - 1, min(len(seen), MOST_OBJECTS)).astype(int)]
    partition, resolution = technique.partition, technique.resolution
    partition = partition.of(light) if isinstance(partition, ByLight) else partition
    if isinstance(partition, SingleMap) and isinstance(partition.warp, StableFit):
        partition = Cascades(1, warp=partition.warp, tight=False)  # the same map, whose end can be moved
    points = jnp.asarray(middles[seen], camera.near.dtype)
    texels = np.asarray(texel_lengths(partition, mesh, light, camera, resolution, points), float)
    across = sizes[seen] / texels
    middle = int(np.argsort(across)[len(across) // 2])
    if across[middle] >= wanted:
        return None
    size, texel, point = float(sizes[seen][middle]), float(texels[middle]), points[middle]
    far, distance = float(camera.far), None
    if isinstance(partition, Cascades) and partition.cuts is None:
        far = far if partition.distance is None else min(far, float(partition.distance))
        nearest = float(camera.to_view(point)[2]) + size
        if nearest < far:
            # The object must stay in the shadow: no distance that ends before its far side is tried.
            tried = np.geomspace(nearest, far, TRIED)
            lengths = _lengths_at(partition, mesh, light, camera, resolution, point, jnp.asarray(tried, point.dtype))
            enough = tried[size / np.asarray(lengths) >= wanted]
            distance = float(enough.max()) if len(enough) else None
    needed = int(np.ceil(resolution * wanted / across[middle]))
    return TexelAdvice(texel, size, wanted, distance, needed, far)


@eqx.filter_jit
def _lengths_at(
    partition: Cascades, mesh: Mesh, light: Light, camera: Camera, resolution: int, point: Array, distances: Array
) -> Array:
    """The texel at a point for every shadow distance."""

    def length(distance: Array) -> Array:
        moved = dataclasses.replace(partition, distance=distance)
        return texel_lengths(moved, mesh, light, camera, resolution, point[None])[0]

    return jax.lax.map(length, distances)


__all__ = ["TexelAdvice", "objects", "stable_texel", "texel_advice", "texel_lengths"]
