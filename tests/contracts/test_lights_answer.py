"""Lights, light spaces and techniques answer questions about themselves: nothing asks for their class."""

import ast
from importlib import import_module
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, plate_over_plane

import shadowjax as sj
from shadowjax._numerics import norm, normalize
from shadowjax.cli.options import PictureOptions, SceneOptions
from shadowjax.cli.scene_choice import open_scene
from shadowjax.geometry import light, light_space
from shadowjax.geometry.light import Light
from shadowjax.geometry.light_space import PerspectiveSpace
from shadowjax.geometry.transforms import any_perpendicular, view_frame
from shadowjax.scenes.lights import LIGHTS, LightKind
from shadowjax.volumes.jitter import disc

ROOT = Path(sj.__file__).parent
TECHNIQUE_FILES = [path.stem for path in (ROOT / "techniques").glob("[!_]*.py")]
BASES = {"Light", "LightSpace", "Technique", "Shadows"}  # of anything it may be asked whether it is one at all
ASKED = light, light_space, *(import_module(f"shadowjax.techniques.{name}") for name in TECHNIQUE_FILES)
KINDS = {
    name
    for module in ASKED
    for name, value in vars(module).items()
    if isinstance(value, type) and issubclass(value, eqx.Module) and value.__module__ == module.__name__
} - BASES  # fmt: skip


def test_nothing_asks_for_the_class_of_a_light_a_space_or_a_technique():
    assert {"DirectionalLight", "SpotLight", "OctahedralSpace", "ShadowMapping", "AdaptiveShadows", "Exact"} <= KINDS
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
                named = {part.id for part in ast.walk(node.args[1]) if isinstance(part, ast.Name)}
                assert not named & KINDS, f"{path.relative_to(ROOT)}:{node.lineno}"


class Panel(Light):
    """A rectangular light that shines to one side, read from its middle: what a user would write in one file."""

    position: jnp.ndarray
    direction: jnp.ndarray
    half_size: jnp.ndarray
    color: jnp.ndarray

    def space(self, view, lower, upper):
        return PerspectiveSpace(self.position, view_frame(self.direction, any_perpendicular(self.direction)))

    @property
    def homogeneous(self):
        return jnp.concatenate([self.position, jnp.ones(1, self.position.dtype)])

    def moved(self, offsets, towards):
        right, up, _ = view_frame(self.direction, any_perpendicular(self.direction))
        across = self.half_size[0] * offsets[:, :1] * right + self.half_size[1] * offsets[:, 1:] * up
        return tuple(Panel(place, self.direction, self.half_size, self.color) for place in self.position + across)

    @property
    def cone(self):
        return jnp.asarray(2.0, self.position.dtype)

    def to_light(self, points):
        return normalize(self.position - points), norm(self.position - points)

    def covers(self, points):
        return (jnp.sum((points - self.position) * self.direction, axis=-1) > 0).astype(points.dtype)

    def radiance(self, points):
        return self.color * (self.covers(points) / norm(self.position - points) ** 2)[..., None]


CASTER = sj.rays.GridCaster()


def test_a_new_light_is_one_line_for_the_command_line(monkeypatch):
    half = jnp.asarray([0.3, 0.1])
    panel = LightKind(lambda at: Panel(*map(jnp.asarray, (at.place, at.axis)), half, jnp.asarray(at.color)), 2.0)
    monkeypatch.setitem(LIGHTS, "panel", panel)
    for kind in LIGHTS:
        (found,) = open_scene("plate-over-plane", SceneOptions(light=kind), PictureOptions()).lights
        middle = jnp.zeros((1, 3))
        assert np.isfinite(np.asarray(found.to_light(middle)[0])).all()
    assert type(open_scene("cubes", SceneOptions(light="panel"), PictureOptions()).lights[0]) is Panel
    with pytest.raises(ValueError, match=r"--light must be one of .*'panel'"):
        open_scene("cubes", SceneOptions(light="torch"), PictureOptions())


TECHNIQUES = {
    "warped": sj.ShadowMapping(resolution=256, caster=CASTER, partition=sj.SingleMap(sj.PerspectiveFit())),
    "volumes": sj.ShadowVolumes(),
    "map": sj.ShadowMapping(resolution=256, caster=CASTER),
    "cube": sj.ShadowMapping(resolution=256, caster=CASTER, partition=sj.CubeMap()),
    "cascades": sj.ShadowMapping(resolution=256, caster=CASTER, partition=sj.Cascades(2)),
}
SHORT = ("warped", "volumes")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in SHORT else pytest.mark.long) for name in TECHNIQUES]
)
def test_a_new_light_is_one_class(name):
    """Maps, warps, cubes and volumes agree with rays for a light that they do not know."""
    mesh, camera = plate_over_plane(), above()
    panel = Panel(jnp.asarray([0.6, 2.5, -0.4]), jnp.asarray([0.0, -1.0, 0.0]), jnp.asarray([0.3, 0.1]), jnp.ones(3))
    surface = sj.trace_surface(mesh, camera, 24, 24, CASTER)
    valid = np.asarray(surface.is_seen)
    truth = np.asarray(sj.visibility_on(surface, sj.Exact(CASTER).build(mesh, panel, camera)))
    assert 0.02 < (truth[valid] < 0.5).mean() < 0.9
    found = np.asarray(sj.visibility_on(surface, TECHNIQUES[name].build(mesh, panel, camera)))
    # wrong at most along the edge, whose pixels are counted by the picture of the reference itself
    edge = sum(np.abs(np.diff(truth, axis=axis)).sum() for axis in (0, 1))
    assert np.abs(found - truth)[valid].sum() <= 0.5 * edge
    places = {tuple(np.round(np.asarray(one.position), 6)) for one in panel.moved(disc(4), panel.position)}
    assert len(places) == 4
