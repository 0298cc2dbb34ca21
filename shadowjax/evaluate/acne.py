"""The acne / peter-panning trade-off: the smallest bias that removes acne, for planes and for meshes; its cost."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from shadowjax._checked import checked
from shadowjax._checks import require, require_value
from shadowjax._types import Array, ArrayLike, Float, Points, as_float_array
from shadowjax.bias.rule import MAX_SLOPE, depth_change, depth_slope, texel_size
from shadowjax.bias.units import BiasScale
from shadowjax.geometry.mesh import Mesh
from shadowjax.maps.sampling import read_texels, texel_index
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.techniques.shadow_mapping import MappedShadows


@checked
def least_plane_bias(
    extent: ArrayLike, resolution: ArrayLike, incidence: ArrayLike, reach: ArrayLike, azimuth: ArrayLike = 0.0
) -> Float[Array, "..."]:
    """Smallest bias that frees a plane of acne, world units: ρ · (extent/resolution) · tan θ · (|cos α| + |sin α|).

    A smooth function of its arguments but for the kinks of |cos α| and |sin α| on the axes.

    Args:
        extent: World size of the map's side, > 0.
        resolution: Texels along it, > 0; any number, so that it can be differentiated.
        incidence: θ, angle between light and normal, radians, in [0, π/2).
        reach: ρ, the filter's reach, texels: ½ for the hard test, K/2 for PCF K × K.
        azimuth: α, direction of the plane's descent in the map, radians.

    Raises:
        ValueError: If a number is out of range.
    """
    resolution = as_float_array(resolution)
    resolution = require_value(resolution, resolution > 0, "resolution must be positive")
    scale = BiasScale.of_plane(as_float_array(extent) / resolution, incidence, azimuth)
    return jnp.asarray(reach, scale.slope.dtype) * scale.slope


@checked
def least_grid_bias(grid: RayGrid, points: Points, normals: Points, reach: float) -> Float[Array, "*points"]:
    """Smallest bias that frees each receiver's plane of acne under any map, world units.

    Through the map's own derivative it is a function of everything that shapes the map: its resolution, and the
    angle γ between light and view where the warp follows the view.

    Args:
        grid: The light rays of the map.
        points: Receivers.
        normals: Their unit normals.
        reach: The filter's reach, texels.
    """
    return depth_change(grid, points, normals, reach)


@checked
def contact_gap(bias: ArrayLike, elevation: ArrayLike, lean: ArrayLike = 0.0) -> Float[Array, "..."]:
    """Lit gap that a bias leaves on the ground at the foot of a thin wall (peter-panning), world units.

    The ray to the light leaves the ground at distance g behind the foot and meets the wall after
    g·cos ψ / cos(ε − ψ). The test tolerates b of that, so all up to g = b·cos(ε − ψ) / cos ψ is lit; for an upright
    wall g = b·cos ε.

    Args:
        bias: b, depth tolerance along the light, world units.
        elevation: ε, of the light above the ground, radians, in (0, π/2].
        lean: ψ, of the wall out of the upright, towards its shadow, radians.

    Raises:
        ValueError: If the elevation is out of range.
    """
    elevation = as_float_array(elevation)
    elevation = require_value(
        elevation, (elevation > 0) & (elevation <= jnp.pi / 2 + 1e-6), "elevation must lie in (0, π/2] radians"
    )
    lean = jnp.asarray(lean, elevation.dtype)
    return jnp.asarray(bias, elevation.dtype) * jnp.cos(elevation - lean) / jnp.cos(lean)


class NeededBias(NamedTuple):
    """What lit receivers of a mesh need so that no tap finds their own surface in front of them.

    Args:
        world: Bias that each receiver needs, world units, ≥ 0; 0 where it is not lit or needs none.
        slope: Depth change of each receiver's plane over a texel, world units.
        texel: Texel at each receiver, world units.
        lit: Receivers that count.
    """

    world: Float[np.ndarray, "points"]
    slope: Float[np.ndarray, "points"]
    texel: Float[np.ndarray, "points"]
    lit: Bool[np.ndarray, "points"]

    @checked
    def least(self, unit: str = "world", share: float = 1.0) -> float:
        """Smallest bias that frees a share of the lit receivers of acne.

        Args:
            unit: "world", "texel" or "slope".
            share: In (0, 1]; 1 frees all. Less leaves out receivers at creases, which no plane predicts.
        """
        require(0 < share <= 1, f"share must lie in (0, 1]; got {share}")
        sizes = {"world": np.ones_like(self.world), "texel": self.texel, "slope": self.slope}
        require(unit in sizes, f"unit must be one of {', '.join(sizes)}; got {unit!r}")
        counted = self.lit & (sizes[unit] > 0)
        if not counted.any():
            return 0.0
        # "higher" takes a bias that a receiver needs, never one between two, which would free too few.
        return float(np.quantile(self.world[counted] / sizes[unit][counted], share, method="higher"))


@checked
def component_labels(mesh: Mesh, precision: float = 1e-6) -> Int[np.ndarray, "faces"]:
    """Number of the connected body that each triangle belongs to; corners closer than `precision` · extent are one."""
    # Corners rounded to a lattice weld what files repeat to their last digit.
    vertices = np.asarray(mesh.vertices, float)
    scale = max(float(np.ptp(vertices, axis=0).max()), 1e-30) * precision
    _, welded = np.unique(np.round(vertices / scale).astype(np.int64), axis=0, return_inverse=True)
    faces = welded.reshape(-1)[np.asarray(mesh.faces)]
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = int(faces.max()) + 1
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return labels[faces[:, 0]]


@checked
def needed_bias(
    shadows: MappedShadows,
    mesh: Mesh,
    points: Float[Array, "points 3"],
    normals: Float[Array, "points 3"],
    faces: Int[Array, "points"],
    lit: Bool[Array, "points"],
    kernel_size: int = 1,
) -> NeededBias:
    """The bias that lit receivers need, measured on one map of a technique: how far their own body lies before them.

    A tap whose texel saw the receiver's own connected body, at most 16 texels of depth before it, is acne where the
    receiver is lit. What other bodies hide, or the same body from farther away, is shadow and is left aside.

    Args:
        shadows: Built maps; the first one is read.
        mesh: What they were cast from.
        points: Receivers.
        normals: Their unit normals.
        faces: Triangle that each lies on.
        lit: Whether each is lit in the reference, such as by shadow rays.
        kernel_size: K of the K × K taps, ≥ 1.
    """
    shadow_map = shadows.maps[0]
    labels = jnp.asarray(component_labels(mesh), jnp.int32)
    position, depth = shadow_map.grid.locate(points)
    seen = jnp.where(shadow_map.face >= 0, labels[jnp.maximum(shadow_map.face, 0)], -1).astype(depth.dtype)
    # Depth and body as two planes, so that every tap reads both from the same texel.
    planes = jnp.stack([shadow_map.depth, seen])
    own = labels[jnp.maximum(faces, 0)].astype(depth.dtype)
    texel = texel_size(shadow_map.grid, points)
    needed = jnp.zeros_like(depth)
    offsets = [i - (kernel_size - 1) / 2 for i in range(kernel_size)]
    for down in offsets:
        for across in offsets:
            col, row = texel_index(position[:, 0] + across), texel_index(position[:, 1] + down)
            stored, body = read_texels(planes, col, row, "clamp")
            before = depth - stored
            acne = (body == own) & (before > 0) & (before <= MAX_SLOPE * texel * kernel_size)
            needed = jnp.maximum(needed, jnp.where(acne, before, 0))
    slope = depth_slope(shadow_map.grid, points, normals)
    counted = np.asarray(lit & (faces >= 0))
    values = (np.where(counted, np.asarray(needed), 0.0), np.asarray(slope), np.asarray(texel))
    return NeededBias(*values, counted)


__all__ = [
    "NeededBias", "component_labels", "contact_gap", "least_grid_bias", "least_plane_bias", "needed_bias",
]  # fmt: skip
