"""What the searches over filters share: scenes looked at once, maps cast once, and the error of a visibility."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from shadowjax import scenes
from shadowjax._checked import Checked, checked
from shadowjax._checks import require
from shadowjax._types import Array, Bool, Float, Points
from shadowjax.bias.rule import BiasRule
from shadowjax.evaluate.compare import reference_view
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.scenes.base import Scene
from shadowjax.techniques.shadow_mapping import MappedShadows, ShadowMapping

OBJECTIVES = ("light", "visibility")


class Viewed(Checked):
    """Receivers of one view with the truth about them, and a cast map that any filter can read.

    Attributes:
        points: Valid receivers.
        normals: Their unit normals.
        faces: Triangle each lies on.
        exact: Visibility by shadow rays.
        weight: Weight of each squared error: cosine² of incidence for received light, 1 for visibility; adds up to 1.
        valid: Which receivers count.
        shadows: A hard test over the map.
        mesh: What the map was cast from.
        name: Of the scene.
    """

    points: Points
    normals: Points
    faces: Array
    exact: Float[Array, "points"]
    weight: Float[Array, "points"]
    valid: Bool[Array, "points"]
    shadows: MappedShadows
    mesh: Mesh
    name: str = eqx.field(static=True)

    def read(self, filter_: Filter, bias: BiasRule | None = None) -> MappedShadows:
        """The map prepared for another filter."""
        return self.shadows.with_filter(filter_, bias)

    def error(self, visibility: Float[Array, "points"]) -> Float[Array, ""]:
        """Root of the weighted mean squared error."""
        return jnp.sqrt(jnp.sum(self.weight * (visibility - self.exact) ** 2))


@checked
@eqx.filter_jit
def visibility_of(shadows: MappedShadows, viewed: Viewed) -> Float[Array, "points"]:
    """What built maps answer for the receivers of a view."""
    return shadows.visibility(viewed.points, viewed.normals)


@checked
@eqx.filter_jit
def error_of(shadows: MappedShadows, viewed: Viewed) -> Float[Array, ""]:
    """Error of built maps over a view; one compiled program for each kind of filter."""
    return viewed.error(shadows.visibility(viewed.points, viewed.normals))


@checked
def view_scene(
    scene: Scene | str,
    width: int = 160,
    height: int = 120,
    resolution: int = 256,
    objective: str = "light",
    caster: Caster | None = None,
) -> Viewed:
    """Look at a scene and cast its first light's map.

    Args:
        scene: A scene, or the name of a built-in one.
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        resolution: Texels along each side of the map, ≥ 1.
        objective: "light" weighs errors by the cosine of incidence, "visibility" counts all alike.
        caster: Traces all rays; the default caster if None.

    Raises:
        ValueError: If a name or size is wrong, or nothing in view faces the light.
    """
    require(objective in OBJECTIVES, f"objective must be one of {', '.join(OBJECTIVES)}; got {objective!r}")
    scene = scenes.make_scene(scene) if isinstance(scene, str) else scene
    caster = default_caster() if caster is None else caster
    view = reference_view(scene, width, height, caster)
    shadows = ShadowMapping(Hard(), resolution, caster=caster).build(scene.mesh, scene.lights[0], scene.camera)

    def flat(x: Any) -> Array:
        return x.reshape(-1, *x.shape[2:])

    valid = flat(view.valid)
    power = flat(view.cosine) ** 2 if objective == "light" else valid.astype(view.exact.dtype)
    weight = power / jnp.sum(power)
    surface = view.surface
    return Viewed(
        flat(surface.points), flat(surface.normals), flat(surface.face), flat(view.exact), weight, valid, shadows,
        scene.mesh, scene.name,
    )  # fmt: skip


@checked
def view_scenes(names: Sequence[Scene | str], **options: Any) -> tuple[Viewed, ...]:
    """`view_scene` of each; at least one."""
    require(len(names) > 0, "give at least one scene")
    return tuple(view_scene(name, **options) for name in names)


__all__ = ["OBJECTIVES", "Viewed", "error_of", "view_scene", "view_scenes", "visibility_of"]
