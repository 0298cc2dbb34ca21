"""The expected error of a filtered map over all placements of its texels: smooth in n', bias and width of the kernel.

Counts of depth tests have no gradient, and a map's texels lie differently for every n', so its measured error is rough.
Both go once the error is averaged over the place of each receiver inside its texel. A tap is then any place of the
light's plane at a distance that n' sets. Whether it darkens the receiver is read from one fine map that no parameter
changes: nothing is lost at the edges of shadows. What is softened is set by one number, `softness`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_int
from shadowjax._numerics import normalize
from shadowjax._types import Array, ArrayLike, Float, Points, Scalar
from shadowjax.bias.rule import Bias, depth_slope, texel_size
from shadowjax.evaluate.compare import View, reference_view
from shadowjax.filters.hard import Hard
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.transforms import any_perpendicular
from shadowjax.maps.sampling import is_outside, texel_index
from shadowjax.maps.shadow_map import ShadowMap
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.rays.ray_grid import RayGrid
from shadowjax.scenes.base import Scene
from shadowjax.shading import visibility_on
from shadowjax.techniques.base import Shadows
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.theory.aliasing.near_distances import generalised
from shadowjax.warps.fit import PerspectiveFit, light_frustum, visible_range

SUN_RAYS = 12  # directions that stand for the sun's disc
# Places of the bilinear taps for a kernel of width 1.
PATTERN = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 2)


class MapSettings(Checked):
    """What is chosen for one map.

    Attributes:
        bend: W/(n' + W) in [0, 1): 0 is the uniform map.
        bias: Slope bias, texels, ≥ 0.
        width: Distance between the 3 × 3 bilinear taps of the filter, texels, ≥ 0.
    """

    bend: Scalar
    bias: Scalar
    width: Scalar

    @classmethod
    def of(cls, numbers: Float[Array, "3"]) -> "MapSettings":
        """From bend, bias and width in a vector."""
        return cls(numbers[0], numbers[1], numbers[2])

    def technique(self, resolution: int, caster: Caster | None = None) -> ShadowMapping:
        """The shadow map with these settings."""
        caster = default_caster() if caster is None else caster
        # The bias is given, so how far taps reach need not be known before compilation.
        taps = OffsetPercentageCloser(self.width * jnp.asarray(PATTERN, self.width.dtype), 1.0)
        return ShadowMapping(
            taps, resolution, SingleMap(PerspectiveFit(bend=self.bend)), caster, Bias(self.bias, "slope")
        )


class ExpectedError(Checked):
    """What the error of a map with any settings is computed from.

    Attributes:
        points: Receivers.
        normals: Their unit normals.
        exact: Reference visibility.
        weight: Of each squared error; adds up to 1.
        fractions: Places of each receiver inside its texel, in [0, 1).
        mesh: The scene.
        light: A directional light.
        camera: The view.
        fine: A map so fine that it stands for the scene.
        scale: Depth over which a test is softened, world units, of each receiver.
        published: Settings as the package has them by default, with n' of eq. 42 and 44.
        resolution: Texels along each side of the map that is judged.
    """

    points: Points
    normals: Points
    exact: Float[Array, "points"]
    weight: Float[Array, "points"]
    fractions: Float[Array, "points placements 2"]
    mesh: Mesh
    light: DirectionalLight
    camera: Camera
    fine: ShadowMap
    scale: Float[Array, "points"]
    published: Float[Array, "3"]
    resolution: int = eqx.field(static=True)

    @classmethod
    def create(
        cls, scene: Scene, width: int = 96, height: int = 72, resolution: int = 128, finer: int = 8,
        num_placements: int = 1, softness: float = 0.1, sun_radius: float = 0.0, caster: Caster | None = None,
    ) -> "ExpectedError":  # fmt: skip
        """Look at a scene under its first light, and cast the fine map.

        Args:
            scene: With a directional light first.
            width: Pixels across, ≥ 1.
            height: Pixels down, ≥ 1.
            resolution: Texels along each side of the map that is judged, ≥ 1.
            finer: How many times as many the fine map has, ≥ 2.
            num_placements: Places of each receiver inside its texel, ≥ 1.
            softness: Depth over which a test is softened, in texels of slope at the default settings, > 0.
            sun_radius: Of the sun's disc, radians: the reference is the mean over its directions. 0 for sharp shadows.
            caster: Traces all rays; the default caster if None.

        Raises:
            ValueError: If a number is out of range or the light is not directional.
        """
        light = scene.lights[0].as_directional("the expected error needs")
        require_int(finer, "finer", 2)
        require_int(num_placements, "num_placements", 1)
        require(softness > 0, f"softness must be positive; got {softness}")
        require(0 <= sun_radius < 0.5, f"sun_radius must lie in [0, 0.5) radians; got {sun_radius}")
        caster = default_caster() if caster is None else caster
        view = reference_view(scene, width, height, caster)
        points, normals = view.surface.points.reshape(-1, 3), view.surface.normals.reshape(-1, 3)
        power = view.cosine.reshape(-1) ** 2
        fractions = np.random.default_rng(0).uniform(size=(len(points), num_placements, 2))
        fine = ShadowMapping(Hard(), finer * resolution, SingleMap(PerspectiveFit("generalised")), caster)
        made = fine.build(scene.mesh, light, scene.camera).maps[0]
        found = cls(
            points, normals, _truth(view, scene, light, sun_radius, caster).reshape(-1), power / jnp.sum(power),
            jnp.asarray(fractions, points.dtype), scene.mesh, light, scene.camera, made,
            jnp.ones(len(points), points.dtype), jnp.ones(3, points.dtype), resolution,
        )  # fmt: skip
        return eqx.tree_at(lambda x: (x.published, x.scale), found, _defaults(found, softness))

    def grid(self, bend: Scalar) -> RayGrid:
        """The map's light rays for a bend."""
        space = self.fine.grid.space
        warp = PerspectiveFit(bend=bend).fit(space, self.light, self.mesh, self.camera)
        return RayGrid(space, warp, self.fine.grid.far, self.resolution, self.resolution, self.fine.grid.seen)

    def visibility(self, settings: MapSettings) -> Float[Array, "points placements"]:
        """What the filter answers for every receiver and place inside a texel."""
        grid = self.grid(settings.bend)
        position, depth = grid.locate(self.points)
        forgiven = Bias(settings.bias, "slope").in_world(grid, self.points, self.normals)
        level = depth - forgiven - grid.receiver_rounding(self.points, self.normals)
        # A receiver at the fraction f of its texel: tap positions counted from the texel's own corner, and from texel
        # centres.
        place = self.fractions[:, :, None] + settings.width * jnp.asarray(PATTERN, depth.dtype) - 0.5
        base = jnp.floor(jax.lax.stop_gradient(place))
        part = place - base
        total = jnp.zeros(place.shape[:2], depth.dtype)
        for right in (0.0, 1.0):
            for down in (0.0, 1.0):
                corner = jnp.asarray([right, down], depth.dtype)
                share = jnp.prod(jnp.where(corner > 0, part, 1 - part), axis=-1)
                # The receiver stays where it is and the lattice of texels moves: that texel's centre, in grid
                # positions.
                centre = position[:, None, None] + base + corner + 0.5 - self.fractions[:, :, None]
                plane = grid.plane_map.inverse(centre / self.resolution)
                lit = self._lit(plane, level[:, None, None], self.scale[:, None, None])
                total = total + jnp.sum(share * lit, axis=-1)
        return total / len(PATTERN)

    def _lit(self, plane: Array, level: Array, scale: Array) -> Array:
        """Softened depth tests at places of the light's plane: bilinear between those at the fine texels."""
        fine = self.fine
        position = fine.grid.plane_map.forward(plane) * fine.grid.resolution
        # Bilinear between the four fine texels around a place; each answers with a softened test.
        corner = position - 0.5
        base = jnp.floor(jax.lax.stop_gradient(corner))
        part = corner - base
        rows, cols = fine.depth.shape
        col, row = texel_index(base[..., 0]), texel_index(base[..., 1])
        value = jnp.zeros_like(level + part[..., 0])
        for right in (0, 1):
            for down in (0, 1):
                share = (part[..., 0] if right else 1 - part[..., 0]) * (part[..., 1] if down else 1 - part[..., 1])
                x, y = jnp.clip(col + right, 0, cols - 1), jnp.clip(row + down, 0, rows - 1)
                # Lit surfaces stay lit: the ramp lies on the dark side.
                ramp = jnp.clip((fine.depth[y, x] - level) / scale + 1, 0.0, 1.0)
                value = value + share * ramp * ramp * (3 - 2 * ramp)
        return jnp.where(is_outside(position, rows, cols), jnp.ones_like(value), value)

    def error(self, settings: MapSettings) -> Float[Array, ""]:
        """Root of the weighted mean squared error, softened, over all receivers and placements."""
        # First over the placements of a receiver, then over receivers by weight.
        each = jnp.mean((self.visibility(settings) - self.exact[:, None]) ** 2, axis=-1)
        return jnp.sqrt(jnp.sum(self.weight * each))

    def seen(self, settings: MapSettings, caster: Caster | None = None) -> Float[Array, "points"]:
        """Visibility by the shadow map itself: cast, filtered by tests, read at the receivers."""
        shadows = settings.technique(self.resolution, caster).build(self.mesh, self.light, self.camera)
        return _visibility(shadows, self.points, self.normals)

    def measured(self, settings: MapSettings, caster: Caster | None = None) -> float:
        """The error of `seen`."""
        return float(jnp.sqrt(jnp.sum(self.weight * (self.seen(settings, caster) - self.exact) ** 2)))


@eqx.filter_jit
def _defaults(expected: ExpectedError, softness: float) -> tuple[Float[Array, "3"], Float[Array, "points"]]:
    """Bend of eq. 42 and 44, the least bias that frees planes of acne, and taps a texel apart; and the depth over which
    tests are softened: a part of the slope with these settings, and a trace of a texel."""
    camera = expected.camera
    frustum = light_frustum(camera, expected.light.direction, *visible_range(camera, expected.mesh))
    bend = frustum.extent / (frustum.extent + generalised(frustum))
    bias = OffsetPercentageCloser(jnp.asarray(PATTERN, bend.dtype), 1.0).bias_reach
    grid = expected.grid(bend)
    scale = softness * depth_slope(grid, expected.points, expected.normals) + 1e-3 * texel_size(grid, expected.points)
    return jnp.stack([bend, bias * jnp.ones_like(bend), jnp.ones_like(bend)]), scale


@eqx.filter_jit
def _visibility(shadows: Shadows, points: Points, normals: Points) -> Float[Array, "points"]:
    return shadows.visibility(points, normals)


def _truth(view: View, scene: Scene, light: DirectionalLight, radius: float, caster: Caster) -> Array:
    """Visibility of the sun's disc: the mean over directions spread evenly on it."""
    if radius == 0:
        return view.exact
    count, total = SUN_RAYS, jnp.zeros_like(view.exact)
    across = any_perpendicular(light.direction)
    along = jnp.cross(light.direction, across)
    for index in range(count):
        # Vogel's spiral: equal areas of the disc, turned by the golden angle.
        length, turn = np.tan(radius) * np.sqrt((index + 0.5) / count), index * np.pi * (3 - 5**0.5)
        moved = light.direction + length * (np.cos(turn) * across + np.sin(turn) * along)
        sun = DirectionalLight(normalize(moved), light.color)
        total = total + visibility_on(view.surface, Exact(caster).build(scene.mesh, sun, scene.camera))
    return total / count


@checked
@eqx.filter_jit
def error_and_slope(expected: ExpectedError, numbers: ArrayLike) -> tuple[Array, Array]:
    """ln of the expected error at bend, bias and width, and its slope."""
    at = jnp.asarray(numbers, expected.exact.dtype)
    return jax.value_and_grad(lambda x: jnp.log(expected.error(MapSettings.of(x))))(at)


__all__ = ["PATTERN", "ExpectedError", "MapSettings", "error_and_slope"]
