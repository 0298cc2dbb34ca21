"""Presets: every one builds and shadows, says what it is made of, and is found by nearly its name."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import ShadowMapping
from shadowjax.partitions.by_light import ByLight
from shadowjax.partitions.cascades import Cascades
from shadowjax.presets import PRESETS, make_preset, preset
from shadowjax.presets.base import Parameter
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.techniques.shadow_mapping import _placed
from shadowjax.warps.uniform import UniformFit

ENGINES = {"Filament", "Godot 4", "three.js", "bgfx example 16", "DiligentFX", "MJP's shadow sample", "bevy"}


def test_every_engine_is_there_and_every_preset_says_what_it_cannot_do():
    assert {one.engine for one in PRESETS.values()} == ENGINES
    for name, one in PRESETS.items():
        record = json.loads(json.dumps(one.to_json(), allow_nan=False))
        assert record["name"] == name
        assert len(record["parameters"]) >= 2
        assert len({parameter["name"] for parameter in record["parameters"]}) == len(record["parameters"])
        for parameter in record["parameters"]:
            assert parameter["verified"] in (True, False)
    unsure = {(name, p.name) for name, one in PRESETS.items() for p in one.parameters if not p.verified}
    assert ("godot-4", "map size") in unsure
    assert ("godot-4", "constant bias") in unsure
    assert preset("bevy")["normal bias"] == 1.8
    assert preset("filament-evsm2")["exponent"] == 5.54
    with pytest.raises(ValueError, match="unit of a parameter"):
        Parameter("size", 1, "metres")


@pytest.mark.parametrize("name", ["filament", "godot-4", "three-js", "bgfx-vsm", "diligent-fx-evsm4", "mjp-pcf"])
def test_a_preset_casts_the_shadow_of_a_plate(name):
    """Lit far outside the shadow, dark in its middle."""
    mesh, camera, light = plate_over_plane(jnp.float32), above(jnp.float32), lights(jnp.float32)["directional"]
    shadows = make_preset(name, 128, BruteForceCaster()).build(mesh, light, camera)
    shift = np.asarray(light.direction)[[0, 2]] / -float(light.direction[1])
    spots = np.array([[*shift], [shift[0] - 2.5, shift[1] + 0.3]])
    points = jnp.asarray(np.stack([spots[:, 0], 0 * spots[:, 0], spots[:, 1]], -1), jnp.float32)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], jnp.float32), points.shape)
    dark, lit = np.asarray(shadows.visibility(points, normals))
    assert dark < 0.2
    # no bias at all is three.js's default, and shows
    assert lit > (0.4 if name == "three-js" else 0.9)


CASCADED = {
    "godot-4": 4, "three-js-csm": 3, "bgfx-pcf": 4, "diligent-fx-pcf": 4, "diligent-fx-evsm4": 4, "mjp-pcf": 4,
    "mjp-evsm4": 4, "mjp-msm-hamburger": 4, "mjp-msm-hausdorff": 4, "bevy": 4,
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in ("godot-4", "bevy") else pytest.mark.long) for name in CASCADED]
)
def test_cascades_of_presets_are_maps_of_their_own_and_lamps_get_one(name):
    """As many different maps as the engine has cascades, each slice finer than the next."""
    mesh, camera, every = plate_over_plane(jnp.float32), above(jnp.float32), lights(jnp.float32)
    technique = make_preset(name, 64, BruteForceCaster())
    _, grids = _placed(technique.partition.with_margin(2), mesh, every["directional"], camera, 64)
    assert len(grids) == CASCADED[name]
    sizes = [float(jnp.max(jnp.abs(grid.cell_vectors(camera.position)[0]))) for grid in grids]
    assert (np.diff(sizes) > 0.02 * sizes[0]).all(), (name, sizes)
    for kind in ("spot", "point"):
        assert len(_placed(technique.partition, mesh, every[kind], camera, 64)[1]) == 1


def test_the_presets_with_cascades_are_those():
    sliced = {name for name in PRESETS if isinstance(make_preset(name, 8, BruteForceCaster()).partition, ByLight)}
    assert set(CASCADED) == sliced


def test_a_shadow_distance_ends_shadows_in_a_fade():
    """Lit beyond it, as dark as before short of the fade, in proportion between."""
    mesh, camera, light = plate_over_plane(jnp.float32), above(jnp.float32), lights(jnp.float32)["directional"]
    shift = np.asarray(light.direction)[[0, 2]] / -float(light.direction[1])
    point = jnp.asarray([[shift[0], 0.0, shift[1]]], jnp.float32)
    depth = float(camera.to_view(point)[0, 2])
    normal = jnp.asarray([[0.0, 1.0, 0.0]], jnp.float32)
    seen = []
    for end in (depth * 0.9, depth / 0.95, depth / 0.9, depth / 0.7):
        slices = Cascades(2, warp=UniformFit(), tight=False, distance=end, fade=0.2)
        shadows = ShadowMapping(resolution=64, partition=slices).build(mesh, light, camera)
        seen.append(float(shadows.visibility(point, normal)[0]))
    np.testing.assert_allclose(seen, [1, 0.75, 0.5, 0], atol=1e-4)


@pytest.mark.parametrize(
    ("given", "told"), [("filamnt", "filament"), ("godot", "godot-4"), ("MJP", "mjp-pcf"), ("zzz", "the presets are")]
)
def test_unknown_presets_get_suggestions(given, told):
    with pytest.raises(ValueError, match=told) as error:
        preset(given)
    assert repr(given) in str(error.value)
