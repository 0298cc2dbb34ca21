"""What the searches over filters share: scenes looked at once, maps cast once, and the error of a visibility."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from shadowjax._checked import Checked, checked
from shadowjax._checks import require, require_choice
from shadowjax._numerics import safe_sqrt
from shadowjax._types import Array, Bool, Float, Points, Scalar
from shadowjax.bias.rule import BiasRule
from shadowjax.evaluate.compare import reference_view
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.presets.names import as_technique
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.scenes.base import Scene
from shadowjax.scenes.loading import Source, as_scene
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import MappedShadows, ShadowMapping
from shadowjax.warps.fit import light_frustum, visible_range

# Visibility, exact visibility, and cosine of the light's incidence (0 where no shadow counts) of every pixel → the
# picture's error, ≥ 0.
PictureError = Callable[[Float[Array, "points"], Float[Array, "points"], Float[Array, "points"]], Float[Array, ""]]


def _root_mean_square(off: Array, weight: Array) -> Array:
    return safe_sqrt(jnp.sum(weight * off**2) / jnp.sum(weight))


# What the error of a picture is; one line each.
PICTURE_OBJECTIVES: dict[str, PictureError] = {
    "light": lambda seen, exact, cosine: _root_mean_square(seen - exact, cosine**2),
    "visibility": lambda seen, exact, cosine: _root_mean_square(seen - exact, (cosine > 0).astype(seen.dtype)),
}


class Viewed(Checked):
    """Receivers of one view with their reference visibility, and a cast map that any filter can read.

    Attributes:
        points: Valid receivers.
        normals: Their unit normals.
        faces: Triangle each lies on.
        exact: Visibility by shadow rays.
        cosine: Cosine of the light's incidence; 0 where no shadow counts.
        shadows: A hard test over the map.
        mesh: What the map was cast from.
        light: What it was cast for.
        name: Of the scene.
        objective: What the error of a picture is.
    """

    points: Points
    normals: Points
    faces: Array
    exact: Float[Array, "points"]
    cosine: Float[Array, "points"]
    shadows: MappedShadows
    mesh: Mesh
    light: Light
    name: str = eqx.field(static=True)
    objective: PictureError = eqx.field(static=True)

    @property
    def valid(self) -> Bool[Array, "points"]:
        """Which receivers count."""
        return self.cosine > 0

    @property
    def resolution(self) -> int:
        """Texels along each side of the map."""
        return self.shadows.maps[0].depth.shape[-1]

    def read(self, filter_: Filter, bias: BiasRule | None = None) -> MappedShadows:
        """The map prepared for another filter."""
        return self.shadows.with_filter(filter_, bias)

    def build(self, technique: ShadowMapping | Filter) -> MappedShadows:
        """Shadow maps of a technique, without a bias of its own; a filter alone reads the map that is there."""
        if isinstance(technique, Filter):
            return self.read(technique)
        return dataclasses.replace(technique, bias=None).build(self.mesh, self.light, self.shadows.camera)

    def error(self, visibility: Float[Array, "points"]) -> Float[Array, ""]:
        """The error of a picture, by the objective."""
        return self.objective(visibility, self.exact, self.cosine)


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


Views = Viewed | Scene | Source | Sequence[Viewed | Scene | Source]


@checked
def view_scene(
    scene: Scene | Source,
    width: int = 160,
    height: int = 120,
    resolution: int = 256,
    objective: str | PictureError = "light",
    caster: Caster | None = None,
) -> Viewed:
    """Look at a scene and cast its first light's map.

    Args:
        scene: A scene, or a name or a file as `load_scene` takes it.
        width: Pixels across, ≥ 1.
        height: Pixels down, ≥ 1.
        resolution: Texels along each side of the map, ≥ 1.
        objective: "light", the root mean square of errors weighed by the cosine of incidence; "visibility", which
            counts all alike; or a function of visibility, exact visibility and cosine of incidence (0 where no shadow
            counts) of every pixel that gives the picture's error, ≥ 0.
        caster: Traces all rays; the default caster if None.

    Raises:
        ValueError: If a name or size is wrong, or nothing in view faces the light.
    """
    error = (
        PICTURE_OBJECTIVES[require_choice(objective, "objective", PICTURE_OBJECTIVES)]
        if isinstance(objective, str)
        else objective
    )
    scene = as_scene(scene)
    caster = default_caster() if caster is None else caster
    view = reference_view(scene, width, height, caster)
    light = scene.lights[0]
    shadows = ShadowMapping(Hard(), resolution, caster=caster).build(scene.mesh, light, scene.camera)

    def flat(x: Any) -> Array:
        return x.reshape(-1, *x.shape[2:])

    # Pixels as one list: searches do not need the image's shape.
    surface = view.surface
    return Viewed(
        flat(surface.points), flat(surface.normals), flat(surface.face), flat(view.exact), flat(view.cosine), shadows,
        scene.mesh, light, scene.name, error,
    )  # fmt: skip


@checked
def as_maps(technique: str | Technique | Filter, resolution: int = 256) -> ShadowMapping | Filter:
    """What a search over maps takes: shadow maps by name or as an object, or a filter that reads maps that are there.

    Args:
        technique: Any name that `make_technique` takes, an object, or a filter.
        resolution: Texels along each side of a map, ≥ 1, of a technique that is given by name.

    Raises:
        ValueError: If a name is wrong, or the technique reads no map.
    """
    if isinstance(technique, Filter):
        return technique
    return as_technique(technique, resolution).as_shadow_mapping("a search of numbers needs")


@checked
def filter_of(searched: ShadowMapping | Filter) -> Filter:
    """The filter of what `as_maps` gives."""
    return searched if isinstance(searched, Filter) else searched.filter


@checked
def refiltered(searched: ShadowMapping | Filter, filter_: Filter) -> ShadowMapping | Filter:
    """What `as_maps` gives, read by another filter with its own default bias."""
    return filter_ if isinstance(searched, Filter) else dataclasses.replace(searched, filter=filter_, bias=None)


@checked
def parts_of(searched: ShadowMapping | Filter) -> dict[str, Any]:
    """Fields of the shadow maps that were searched, but their resolution: attribute of `ShadowMapping` to value."""
    if isinstance(searched, Filter):
        return {"filter": searched}
    return {
        item.name: getattr(searched, item.name) for item in dataclasses.fields(searched) if item.name != "resolution"
    }


class ViewNumbers(NamedTuple):
    """What the closed forms ask of a view.

    Attributes:
        near: Least depth at which the scene has vertices, world units.
        far: Largest.
        phi: Half the vertical angle of view, radians; for a camera that rolls about the light's plane, of the upright
            frustum round its own.
        gamma: Angle between light and view, radians.
    """

    near: Scalar
    far: Scalar
    phi: Scalar
    gamma: Scalar


@checked
def view_of(scene: Scene | Source) -> ViewNumbers:
    """Near, far, φ and γ of a scene's camera and first light, in the order in which optimisers take them.

    Args:
        scene: A scene, or a name or a file as `load_scene` takes it.

    Raises:
        ValueError: If the light is not directional.
    """
    scene = as_scene(scene)
    light = scene.lights[0].as_directional("the angle γ needs")
    frustum = light_frustum(scene.camera, light.direction, *visible_range(scene.camera, scene.mesh))
    return ViewNumbers(frustum.near, frustum.far, frustum.phi_y, frustum.gamma)


@checked
def as_views(views: Views, **options: Any) -> tuple[Viewed, ...]:
    """What a search looks at: views as they are, and `view_scene` of scenes and names.

    Raises:
        ValueError: If there is none.
    """
    given = (views,) if not isinstance(views, Sequence) or isinstance(views, str) else tuple(views)
    require(len(given) > 0, "give at least one scene")
    return tuple(one if isinstance(one, Viewed) else view_scene(one, **options) for one in given)


__all__ = [
    "PICTURE_OBJECTIVES", "PictureError", "ViewNumbers", "Viewed", "Views", "as_maps", "as_views", "error_of",
    "filter_of", "parts_of", "refiltered", "view_of", "view_scene", "visibility_of",
]  # fmt: skip
