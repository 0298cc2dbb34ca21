"""A built-in scene under adaptive and uniform maps: what the camera sees, the exact shadow, and pixels that differ."""

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from shadowjax import scenes
from shadowjax._checks import require, require_choice, require_int
from shadowjax.evaluate import compare
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.mesh import Mesh
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.shading import visibility_on
from shadowjax.techniques.adaptive import AdaptiveShadowMapping, AdaptiveShadows
from shadowjax.techniques.base import Shadows
from shadowjax.techniques.shadow_mapping import ShadowMapping

KIB = 1024
# Pixels on both sides of an exact shadow's edge that count as near it.
NEAR = 2


def check_view(scene: str, num_triangles: int, height: int) -> None:
    """Complain about a view that cannot be made."""
    require_choice(scene, "scene", scenes.SCENES)
    require_int(num_triangles, "num_triangles", 1)
    require_int(height, "height", 24)


@dataclass(frozen=True)
class Wrong:
    """Pixels whose answer is not the exact one.

    Attributes:
        near: Within two pixels of an exact shadow's edge.
        lit: Lit and should not be, anywhere.
        dark: Dark and should not be, anywhere.
    """

    near: int
    lit: int
    dark: int

    @property
    def total(self) -> int:
        """All of them."""
        return self.lit + self.dark


def filled_up(mesh: Mesh, num_vertices: int, num_faces: int) -> Mesh:
    """The mesh with triangles without area up to a common count, so that scenes share compiled programs."""
    vertices, faces = num_vertices - mesh.vertices.shape[0], num_faces - mesh.faces.shape[0]
    more = (
        jnp.repeat(mesh.vertices[:1], vertices, axis=0), jnp.zeros((faces, 3), mesh.faces.dtype),
        jnp.repeat(mesh.face_colors[:1], faces, axis=0),
    )  # fmt: skip
    leaves = (mesh.vertices, mesh.faces, mesh.face_colors)
    joined = tuple(jnp.concatenate(pair) for pair in zip(leaves, more, strict=True))
    return eqx.tree_at(lambda one: (one.vertices, one.faces, one.face_colors), mesh, joined)


class Stage:
    """A scene, a camera and the exact shadow of what it sees; float32, as the maps.

    Attributes:
        scene: With its camera.
        view: Surface, valid receivers, exact visibility.
        near: Valid pixels near an edge of the exact shadow.
    """

    def __init__(
        self,
        scene: str,
        num_triangles: int | None,
        height: int,
        camera: Camera | None = None,
        filled: tuple[int, int] | None = None,
    ) -> None:
        made = scenes.make_scene(scene, num_triangles, dtype=jnp.float32)
        if filled is not None:
            made = eqx.tree_at(lambda one: one.mesh, made, filled_up(made.mesh, *filled))
        self.scene = made if camera is None else eqx.tree_at(lambda one: one.camera, made, camera)
        self.height = height
        width = round(height * float(self.scene.camera.aspect))
        self.view = compare.reference_view(self.scene, width, height, GridCaster())
        self.valid, self.exact = np.asarray(self.view.valid), np.asarray(self.view.exact)
        darkest = ndimage.minimum_filter(np.where(self.valid, self.exact, 1), 2 * NEAR + 1)
        brightest = ndimage.maximum_filter(np.where(self.valid, self.exact, 0), 2 * NEAR + 1)
        self.near = self.valid & (brightest > 0.5) & (darkest < 0.5)

    def picture(self, shadows: Shadows) -> np.ndarray:
        """Visibility of every pixel."""
        return np.asarray(visibility_on(self.view.surface, shadows))

    def wrong(self, shadows: Shadows) -> Wrong:
        """Count the pixels that differ from the exact shadow."""
        found = self.picture(shadows)
        lit, dark = (self.valid & (found > self.exact), self.valid & (found < self.exact))
        return Wrong(int(((lit | dark) & self.near).sum()), int(lit.sum()), int(dark.sum()))

    def uniform(self, resolution: int) -> Wrong:
        """The hard test on one uniform map."""
        technique = ShadowMapping(resolution=resolution, caster=GridCaster())
        return self.wrong(technique.build(self.scene.mesh, self.scene.lights[0], self.scene.camera))

    def technique(self, budget_kib: int, **options) -> AdaptiveShadowMapping:
        """An adaptive map that looks at the very pixels of this view."""
        require(budget_kib > 0, f"a budget must be positive; got {budget_kib} KiB")
        return AdaptiveShadowMapping(KIB * budget_kib, num_rows=self.height, caster=GridCaster(), **options)

    def adaptive(self, budget_kib: int, **options) -> AdaptiveShadows:
        """An adaptive map of this view."""
        made = self.technique(budget_kib, **options)
        return made.build(self.scene.mesh, self.scene.lights[0], self.scene.camera)


__all__ = ["KIB", "NEAR", "Stage", "Wrong", "check_view", "filled_up"]
