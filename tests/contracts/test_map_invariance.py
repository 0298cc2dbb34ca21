"""Maps answer alike wherever the scene lies, however wide its ground, at any scale and however turned.

Every technique with a map, pairwise with partitions and warps; numbers in world units are scaled with the scene. A
picture is judged by the closed form of the box's shadow where a few texels do not decide it, and against the picture of
the unmoved scene.
"""

import dataclasses
import itertools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from box_shadow import HEIGHT, WIDTH, as_numpy, ground_shadow, stage, undecided

from shadowjax import PARTITIONS, TECHNIQUES, make_technique
from shadowjax.bias.kinds import NormalOffset, ReceiverPlane
from shadowjax.bias.rule import Bias
from shadowjax.filters.hard import Hard
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.single import SingleMap
from shadowjax.presets import PRESETS, make_preset
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.shading import trace_surface
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.warps.fit import NEAR_DISTANCES, LogarithmicFit, PerspectiveFit
from shadowjax.warps.stable import StableFit
from shadowjax.warps.uniform import UniformFit

# Wide grounds and far places leave a few roundings between right and wrong.
pytestmark = pytest.mark.optimised

RESOLUTION = 512
WITHOUT_BIAS = ("three-js", "three-js-csm")  # their own defaults, which leave acne
EPS = float(jnp.finfo(jnp.float32).eps)
# Metres by which a shadow may be off: a few texels of a map of the view.
BLUR = 0.1
WARPS = {
    "uniform": lambda: UniformFit("view"),
    "stable": StableFit,
    "logarithmic": LogarithmicFit,
    **{rule: lambda rule=rule: PerspectiveFit(rule) for rule in NEAR_DISTANCES},
}
MAPPED = [name for name in TECHNIQUES if isinstance(make_technique(name), ShadowMapping)]
TURN = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
HALVES = tuple({"half": half} for half in (1e2, 1e3, 1e4, 1e5, 1e6))
MOTIONS = (
    *({"shift": (size, 0.0, -size)} for size in (1e2, 1e3, 1e4, 1e5)),
    *({"scale": scale} for scale in (1e-3, 1e-1, 10.0, 1e3)),
    {"turn": TURN},
    {"turn": TURN, "scale": 30.0, "shift": (2e3, -1e3, 1e3), "half": 50.0},
)


def pictured(technique, mesh, light, camera):
    """Pixels that see the ground, and visibility."""
    surface = trace_surface(mesh, camera, WIDTH, HEIGHT, GridCaster())
    shadows = technique.build(mesh, light, camera)
    return surface.is_seen & (surface.face < 2), shadows.visibility_of(surface.points, surface.normals, surface.face)


PICTURED = eqx.filter_jit(pictured)


def scaled(part: Any, by: float) -> Any:
    """A technique for a scene `by` times as large: its numbers in world units are scaled, all others kept."""
    changes = {}
    if isinstance(part, Cascades):
        lengths = ("distance", "first")
    elif isinstance(part, Bias | NormalOffset) and part.unit == "world":
        lengths = ("value",)
    else:
        lengths = ("constant",) if isinstance(part, ReceiverPlane) else ()
    if isinstance(part, tuple):
        return tuple(scaled(inner, by) for inner in part)
    if not dataclasses.is_dataclass(part):
        return part
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if field.name in lengths and value is not None:
            changes[field.name] = jnp.asarray(value, jnp.float32) * by
        elif dataclasses.is_dataclass(value) or isinstance(value, tuple):
            changes[field.name] = scaled(value, by)
    return dataclasses.replace(part, **changes) if changes else part


def picture(technique, kind, make, **motion):
    scene = stage(jnp.float32, kind=kind, **motion)
    chosen = scaled(technique, motion.get("scale", 1.0))
    return tuple(as_numpy(part) for part in make(chosen, scene.mesh, scene.light, scene.camera))


def assert_alike(technique, motions, kind="directional", make=PICTURED, start=None, has_acne=False):
    """The closed form's answer, and the unmoved scene's, for every motion; with acne only what is dark is judged."""
    on_ground, dark = ground_shadow(kind)
    still = None
    for motion in (start or {}, *motions):
        # A box of a metre is told to a few roundings of its place.
        off = 2 * EPS * max(map(abs, motion.get("shift", (0.0,)))) / motion.get("scale", 1.0)
        told = ~undecided(kind, BLUR + off) & on_ground
        assert np.sum(told & dark) >= 5
        ground, visible = picture(technique, kind, make, **motion)
        still = visible if still is None else still
        told &= ground > 0
        told &= dark if has_acne else True
        answer = np.broadcast_to(dark, visible.shape)
        np.testing.assert_array_equal((visible < 0.5)[..., told], answer[..., told], err_msg=str(motion))
        assert np.max(np.abs(visible - still)[..., told], initial=0.0) <= 0.2, motion


def partition_of(name, warp):
    made = PARTITIONS[name]()
    return eqx.tree_at(lambda p: p.warp, made, WARPS[warp]()) if hasattr(made, "warp") else made


@eqx.filter_jit
def read_twice(technique, mesh, light, camera):
    """As `pictured`, of moments and of single depths in one map."""
    surface = trace_surface(mesh, camera, WIDTH, HEIGHT, GridCaster())
    shadows = technique.build(mesh, light, camera)
    each = [read.visibility(surface.points, surface.normals) for read in (shadows, shadows.with_filter(Hard()))]
    return surface.is_seen & (surface.face < 2), jnp.stack(each)


def test_a_map_answers_alike_wherever_the_scene_lies():
    motions = ({"half": 1e6}, {"shift": (1e4, 0.0, -1e4)}, {"scale": 1e-3}, {"scale": 1e3}, {"turn": TURN})
    technique = make_technique("msm-hamburger", RESOLUTION, GridCaster(), partition=SingleMap(UniformFit("view")))
    assert_alike(technique, motions, make=read_twice)


@pytest.mark.long
@pytest.mark.parametrize("name", MAPPED)
def test_every_filter_answers_alike_wherever_the_scene_lies(name):
    partition = {} if name.startswith("cube") else {"partition": SingleMap(UniformFit("view"))}
    technique = make_technique(name, RESOLUTION, GridCaster(), **partition)
    if name.startswith("cube"):
        return assert_alike(technique, (*HALVES, *MOTIONS), "point")
    return assert_alike(technique, (*HALVES, *MOTIONS))


@pytest.mark.long
@pytest.mark.parametrize(
    ("partition", "warp", "name"),
    [
        (partition, warp, name)
        for (partition, warp), name in zip(
            itertools.product([p for p in PARTITIONS if hasattr(PARTITIONS[p](), "warp")], WARPS),
            itertools.cycle([name for name in MAPPED if not name.startswith("cube")]),
            strict=False,
        )
    ],
)
def test_every_partition_and_warp_answers_alike_wherever_the_scene_lies(partition, warp, name):
    technique = make_technique(name, RESOLUTION, GridCaster(), partition=partition_of(partition, warp))
    assert_alike(technique, (*HALVES, *MOTIONS))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["spot", "point"])
@pytest.mark.parametrize("name", ["hard", "pcf-3x3", "2sm-max", "second-depth"])
def test_a_lamp_s_map_answers_alike_wherever_the_scene_lies(name, kind):
    partition = PARTITIONS["cube"]() if kind == "point" else SingleMap(UniformFit("view"))
    assert_alike(make_technique(name, RESOLUTION, GridCaster(), partition=partition), (*HALVES, *MOTIONS), kind)


@pytest.mark.long
@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_answers_alike_wherever_the_scene_lies(name):
    """On a ground that fills the maps, whose depths then span one range; with the engine's distance cut to the view."""
    technique = make_preset(name, 1024, GridCaster())
    slices = getattr(technique.partition, "directional", None)
    if getattr(slices, "distance", None) is not None:
        technique = scaled(technique, float(stage(jnp.float32).camera.far) / float(slices.distance))
    # One map of a whole scene has texels as wide as its ground.
    wide = slices is not None
    motions = [{"half": 1e2, **motion} for motion in MOTIONS if "half" not in motion] if wide else list(MOTIONS[:-1])
    start, motions = ({"half": 1e2}, [*motions, *HALVES[1:]]) if wide else ({}, motions)
    # Without a bias the ground has acne, which rounding decides.
    assert_alike(technique, motions, start=start, has_acne=name in WITHOUT_BIAS)


def test_every_number_in_world_units_is_scaled():
    """A preset with lengths, texels and factors: lengths alone are scaled."""
    given, larger = make_preset("bevy", 64, GridCaster()), scaled(make_preset("bevy", 64, GridCaster()), 2.0)
    slices, bias = larger.partition.directional, larger.bias.parts
    assert (float(slices.distance), float(slices.first)) == (300.0, 20.0)
    assert [float(part.value) for part in bias] == pytest.approx([0.04, 1.8])
    assert (slices.blend, slices.fade) == (given.partition.directional.blend, given.partition.directional.fade)
