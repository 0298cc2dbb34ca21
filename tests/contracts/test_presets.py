"""Presets: every one builds and shadows, says what it is made of, and is found by nearly its name."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax.presets import PRESETS, make_preset, preset
from shadowjax.presets.base import Parameter
from shadowjax.rays.brute import BruteForce

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
    shadows = make_preset(name, 32, BruteForce()).build(mesh, light, camera)
    shift = np.asarray(light.direction)[[0, 2]] / -float(light.direction[1])
    spots = np.array([[*shift], [shift[0] - 2.5, shift[1] + 0.3]])
    points = jnp.asarray(np.stack([spots[:, 0], 0 * spots[:, 0], spots[:, 1]], -1), jnp.float32)
    normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], jnp.float32), points.shape)
    dark, lit = np.asarray(shadows.visibility(points, normals))
    assert dark < 0.2
    # no bias at all is three.js's default, and shows
    assert lit > (0.4 if name == "three-js" else 0.9)


@pytest.mark.parametrize(
    ("given", "told"), [("filamnt", "filament"), ("godot", "godot-4"), ("MJP", "mjp-pcf"), ("zzz", "the presets are")]
)
def test_unknown_presets_get_suggestions(given, told):
    with pytest.raises(ValueError, match=told) as error:
        preset(given)
    assert repr(given) in str(error.value)
