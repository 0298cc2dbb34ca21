"""A shadow map: the first depth along every ray of a grid of light rays."""

import equinox as eqx

from shadowjax._checked import Checked, checked
from shadowjax._checks import require_choice
from shadowjax._types import Array, Float, Int
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.outlines import MeshEdges
from shadowjax.rays.caster import Caster
from shadowjax.rays.layers import LAYERS, back_layer, second_layer
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.silhouettes.coverage import OutlinePieces, default_room, outline_pieces


class ShadowMap(Checked):
    """Depth seen from a light.

    Attributes:
        grid: The light rays the map samples.
        depth: Distance along each ray, world units, `depth[t_index, s_index]`; the grid's `far` where nothing is hit.
        face: Triangle seen by each texel, -1 where nothing is hit.
        outlines: Where outlines cross texels, for filters that average values over a texel's area; None if a texel
            knows the ray through its centre alone.
    """

    grid: RayGrid
    depth: Float[Array, "rows cols"]
    face: Int[Array, "rows cols"]
    outlines: OutlinePieces | None = None

    @property
    def border(self) -> str:
        """What lies outside the map: lit, or the folded continuation of an omnidirectional map."""
        return self.grid.space.border


@checked
@eqx.filter_jit
def build_shadow_map(caster: Caster, mesh: Mesh, grid: RayGrid, layer: str = "first") -> ShadowMap:
    """Cast one ray through each texel's centre.

    Args:
        caster: Any caster; all give the same map.
        mesh: Everything that casts shadows.
        grid: The light rays.
        layer: Which depth to keep (`rays.layers.LAYERS`): "first" is a shadow map; "second" the next surface; "back"
            the first surface met from behind; "midpoint" the mean of the first depth and the second.

    Returns:
        The map; its depth is differentiable in mesh, light and warp at fixed visibility. Faces are those of the kept
        layer, of the first for midpoints.

    Raises:
        ValueError: If the layer is unknown.

    Source: filtering, section 2.1.3 (second-depth shadow mapping); midpoints are Woo's, 1992.
    """
    require_choice(layer, "layer", LAYERS)
    if layer == "back":
        hit = back_layer(caster, mesh, grid)
        return ShadowMap(grid, hit.depth, hit.face)
    first = caster.closest_on_grid(mesh, grid)
    if layer == "first":
        return ShadowMap(grid, first.depth, first.face)
    second = second_layer(caster, mesh, grid, first)
    if layer == "second":
        return ShadowMap(grid, second.depth, second.face)
    return ShadowMap(grid, 0.5 * (first.depth + second.depth), first.face)


@checked
def build_covered_map(caster: Caster, mesh: Mesh, grid: RayGrid, edges: MeshEdges) -> ShadowMap:
    """A map that knows where outlines cross its texels, so that averages over texels move as outlines do.

    Args:
        caster: Any caster.
        mesh: Everything that casts shadows.
        grid: The light rays, of a space that keeps lines straight.
        edges: From `mesh_edges`.

    Raises:
        ValueError: If the space bends lines: one map around a point light.
        RuntimeError: If outlines cross more texels than there is room for: one crossing for each texel, and four for
            each edge.
    """
    plain = build_shadow_map(caster, mesh, grid)
    most = max(default_room(grid), grid.num_rows * grid.num_cols + 4 * edges.vertices.shape[0])
    return ShadowMap(grid, plain.depth, plain.face, outline_pieces(mesh, edges, grid, caster, most))
