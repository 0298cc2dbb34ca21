"""Fits of warps to a camera, a light and a scene, and the registry of rules for the virtual near distance n'."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import checked
from shadowjax._checks import concrete, require, require_choice
from shadowjax._numerics import dot, norm, normalize, rotate, safe_divide
from shadowjax._types import Array, Float, Scalar, Vector3, as_float_array
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import DirectionalSpace, LightSpace
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.transforms import PARALLEL_ROUNDINGS, light_frame, perpendicular_part
from shadowjax.theory.aliasing import near_distances, optimal
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.theory.aliasing.strength import least_worst_strength
from shadowjax.warps.base import WarpFit
from shadowjax.warps.logarithmic import LogarithmicWarp, log_distance
from shadowjax.warps.perspective import PerspectiveWarp
from shadowjax.warps.receivers import receiver_outline
from shadowjax.warps.trapezoidal import trapezoidal

NearDistanceRule = Callable[[LightFrustum], Float[Array, "..."]]

# How each named technique picks n', for a directional light; one line a rule.
NEAR_DISTANCES: dict[str, NearDistanceRule] = {
    "uniform": near_distances.uniform,
    "psm": near_distances.psm,
    "lispsm": near_distances.wimmer,
    "lispsm_sine": near_distances.wimmer_over_sine,
    "generalised": near_distances.generalised,
    "generalised_sine": lambda frustum: near_distances.generalised(frustum, "sine"),
    "minimax": optimal.minimax,
    "minimax_whole": lambda frustum: optimal.minimax(frustum, "whole"),
    "least_storage": optimal.least_storage,
    "balanced": optimal.balanced,
    "trapezoidal": trapezoidal,
}

MARGIN = 1e-3  # of a map's size, beyond what is seen on each side
SAMPLES = 33  # depths on the view axis at which a spot light's error is weighed


@checked
def light_frustum(camera: Camera, light_direction: Vector3, near: Scalar, far: Scalar) -> LightFrustum:
    """The camera's frustum as a directional light sees it, for any roll of the camera.

    With roll, the angles of view along and across light space are those of the smallest upright frustum around the
    camera's: its half sizes are projected on the two directions.

    Args:
        camera: The camera.
        light_direction: Direction along which the light travels.
        near: Nearest depth that matters, world units.
        far: Farthest depth that matters, world units.
    """
    frame = light_frame(-light_direction, camera.forward)
    # Light space's x and the part of its z' in the image plane are perpendicular there: the second has the components
    # (|up·x|, |right·x|), the first's in reverse order.
    across = jnp.abs(camera.rotation[:2] @ frame[0])  # x of light space in the image plane: (|right·x|, |up·x|)
    # Support of the image rectangle along both directions: |right·d|·half_x + |up·d|·half_y.
    half = camera.half_size
    tan_x = dot(across, half)
    tan_y = dot(across[::-1], half)
    return LightFrustum(near, far, jnp.arctan(tan_y), jnp.arctan(tan_x), camera.gamma(light_direction))


@checked
def visible_range(camera: Camera, mesh: Mesh) -> tuple[Scalar, Scalar]:
    """Depths between the camera's planes at which the scene has vertices, so has surfaces."""
    depth = camera.to_view(mesh.vertices)[:, 2]
    near = jnp.clip(jnp.min(depth), camera.near, camera.far)
    far = jnp.clip(jnp.max(depth), camera.near, camera.far)
    # No vertex in view leaves an empty range: the camera's own planes stand in.
    some = far > near * (1 + 1e-3)
    return jnp.where(some, near, camera.near), jnp.where(some, far, camera.far)


@checked
def corners(camera: Camera, near: Scalar, far: Scalar) -> Float[Array, "8 3"]:
    """World corners of the part of the camera's frustum between two depths."""
    part = eqx.tree_at(lambda c: (c.near, c.far), camera, (near, far))
    return part.frustum_corners()


@checked
def padded(points: Float[Array, "points 2"], margin: float = MARGIN) -> Float[Array, "points 2"]:
    """Plane points moved away from their middle, so that nothing the camera sees falls on the border of a map."""
    middle = (jnp.min(points, axis=0) + jnp.max(points, axis=0)) / 2
    return middle + (points - middle) * (1 + 2 * margin)


def _number(value: float | Scalar | None) -> Array | None:
    return None if value is None else as_float_array(value)


class PerspectiveFit(WarpFit):
    """Covers what the camera sees with a perspective warp whose n' follows a named rule, or is given.

    Only the frustum has to be covered: each ray of a directional or spot light carries every caster that can darken its
    receivers, however far outside the frustum they are, so no caster is clipped.

    A spot light has no closed form: any rule but "uniform" then means the strength of least worst error on the view
    axis and at the corners of what is seen, weighed with the true distances from light and camera. Its map covers what
    of the view the cone reaches (`receiver_outline`), and is uniform where it reaches nothing.

    A given n', or a given bend, is for directional lights: it takes the place of the rule.

    Attributes:
        rule: Key of `NEAR_DISTANCES`.
        tight: Whether the depths are cut to those at which the scene has vertices.
        near_distance: n', world units, > 0, such as an optimiser's; a huge one is the uniform map. None for the rule's.
        bend: W/(n' + W) in [0, 1) with the map's extent W: 0 is the uniform map. None for the rule's.
        margin: How far the map reaches beyond what is seen on each side, as a share of its size, in [0, 0.1].
    """

    rule: str = eqx.field(static=True, default="minimax")
    tight: bool = eqx.field(static=True, default=True)
    near_distance: float | Scalar | None = eqx.field(converter=_number, default=None)
    bend: float | Scalar | None = eqx.field(converter=_number, default=None)
    margin: float = eqx.field(static=True, default=MARGIN)

    def __check_init__(self) -> None:
        require_choice(self.rule, "warp rule", NEAR_DISTANCES)
        require(
            self.near_distance is None or self.bend is None,
            "near_distance and bend both say how strong the warp is; give one of them",
        )
        require(0 <= self.margin <= 0.1, f"margin, a share of the map, must lie in [0, 0.1]; got {self.margin}")
        distance, bend = (None if x is None else concrete(x) for x in (self.near_distance, self.bend))
        require(distance is None or bool(distance > 0), f"n', near_distance, must be positive; got {distance}")
        require(bend is None or bool(0 <= bend < 1), f"bend, W/(n' + W), must lie in [0, 1); got {bend}")

    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> PerspectiveWarp:
        """The warp around the visible part of the camera's frustum.

        Raises:
            ValueError: If the light is a point light: its rays fill a sphere and have no plane to warp. If n' or a bend
                is given and the light is not directional.
        """
        near, far = visible_range(camera, mesh) if self.tight else (camera.near, camera.far)
        if space.is_parallel:
            space = space.as_directional("a perspective fit needs")
            points = padded(space.project(corners(camera, near, far))[0], self.margin)
            axis = view_axis(space, camera)
            return PerspectiveWarp.fit(points, self._strength(space, camera, near, far, points @ axis), axis)
        require(
            self.near_distance is None and self.bend is None,
            f"a given n' or bend needs a directional light; got {type(light).__name__}: give a rule instead",
        )
        part = eqx.tree_at(lambda c: (c.near, c.far), camera, (near, far))
        points, axis, strength = spot_strength(space, light, mesh, part)
        if self.rule == "uniform":
            strength = jnp.zeros_like(strength)
        return PerspectiveWarp.fit(padded(points, self.margin), strength, axis)

    def _strength(self, space: DirectionalSpace, camera: Camera, near: Array, far: Array, along: Array) -> Array:
        """1/n' for corners that lie so far along the view."""
        if self.near_distance is not None:
            return 1 / jnp.asarray(self.near_distance, near.dtype)
        if self.bend is not None:
            bend = jnp.asarray(self.bend, near.dtype)
            # b = W/(n' + W) solved for 1/n', with W the length of what is covered along the axis.
            return bend / (1 - bend) / (jnp.max(along) - jnp.min(along))
        return 1 / NEAR_DISTANCES[self.rule](light_frustum(camera, -space.frame[1], near, far))


class LogarithmicFit(WarpFit):
    """Covers what the camera sees with a logarithmic warp of least error along z', for directional lights.

    Attributes:
        tight: Whether the depths are cut to those at which the scene has vertices.
    """

    tight: bool = eqx.field(static=True, default=True)

    def fit(self, space: LightSpace, light: Light, mesh: Mesh, camera: Camera) -> LogarithmicWarp:
        """The warp around the visible part of the camera's frustum.

        Raises:
            ValueError: If the light is not directional.
        """
        light.as_directional("the logarithmic warp needs", ": use PerspectiveFit")
        space = space.as_directional("the logarithmic warp needs")
        near, far = visible_range(camera, mesh) if self.tight else (camera.near, camera.far)
        points = padded(space.project(corners(camera, near, far))[0])
        frustum = light_frustum(camera, -space.frame[1], near, far)
        return LogarithmicWarp.fit(points, 1 / log_distance(frustum), view_axis(space, camera))


@checked
def view_axis(space: DirectionalSpace, camera: Camera) -> Float[Array, "2"]:
    """Direction on the light's plane in which the view recedes; z of the light space where light and view align."""
    # The view direction less its part along the light, in the light plane's coordinates x and z.
    along, sine = perpendicular_part(camera.forward, space.frame[1])
    seen = jnp.stack([dot(space.frame[0], along), dot(space.frame[2], along)])
    return jnp.where(sine > 0, normalize(seen), jnp.asarray([0.0, 1.0], seen.dtype))


@checked
def spot_strength(
    space: LightSpace, light: Light, mesh: Mesh, camera: Camera
) -> tuple[Float[Array, "corners 2"], Float[Array, "2"], Scalar]:
    """Outline of a view's receivers, the direction in which the view recedes there, and the best strength on its axis.

    Args:
        space: The light's rays.
        light: The light.
        mesh: Everything that casts or receives.
        camera: The view; its planes bound the depths that are weighed.

    Raises:
        ValueError: If the space is not that of a spot light.
    """
    space = space.as_perspective("perspective warps need a directional or a spot light", ": use UniformFit")
    seen = receiver_outline(space, light, mesh, camera)
    points = seen.plane
    near, far = camera.near, camera.far
    # Evenly in the logarithm of depth, as errors vary with ratios of depths.
    depths = near * (far / near) ** jnp.linspace(0, 1, SAMPLES, dtype=near.dtype)
    samples = camera.position + depths[:, None] * camera.forward
    # on the line (x, y, z) + λ(x', y', z'), d(x/z)/dλ is (x'z − xz')/z², whose numerator is the same all along it
    place, ahead = rotate(camera.position - space.position, space.frame), rotate(camera.forward, space.frame)
    direction = ahead[:2] * place[2] - place[:2] * ahead[2]
    # A view axis through the light is one place on the plane, to the rounding of where the camera is.
    recedes = norm(direction) > PARALLEL_ROUNDINGS * jnp.finfo(direction.dtype).eps * norm(place)
    axis = jnp.where(recedes, normalize(direction), jnp.asarray([0.0, 1.0], direction.dtype))
    # u of every sample: its place along the axis from the lowest corner of what the map covers.
    lowest = jnp.min(points @ axis)
    extent = jnp.max(points @ axis) - lowest
    offset = space.project(samples)[0] @ axis - lowest
    inside = space.in_front(samples) & (offset >= 0) & (offset <= extent)
    # Corners count too: where the axis leaves the cone, they alone say how far the receivers reach. They span what is
    # covered, so the outermost are not asked whether they lie in it: rounding would decide.
    samples = jnp.concatenate([samples, seen.corners])
    offset = jnp.concatenate([offset, points @ axis - lowest])
    weighed = jnp.concatenate([inside, jnp.ones(len(points), bool)]) & recedes & seen.some
    distance = (samples - space.position) @ space.frame[2]
    weight = jnp.where(weighed, safe_divide(jnp.abs(distance), (samples - camera.position) @ camera.forward), 0)
    # what has no weight lies at the far end, where without any other point nothing asks for a warp
    strength = least_worst_strength(jnp.where(weighed, offset, extent), weight, extent)
    return points, axis, strength


__all__ = [
    "NEAR_DISTANCES",
    "LogarithmicFit",
    "NearDistanceRule",
    "PerspectiveFit",
    "corners",
    "light_frustum",
    "padded",
    "spot_strength",
    "view_axis",
    "visible_range",
]  # fmt: skip
