"""Over a bare plane no pixel is dark: every technique, warp and partition, with the light ever so near to the view."""

import contextlib
import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from shadowjax import PARTITIONS, TECHNIQUES, AdaptiveShadowMapping, Camera, DirectionalLight, Mesh, make_technique
from shadowjax.rays.grid.caster import GridCaster
from shadowjax.shading import trace_surface
from shadowjax.techniques.base import Technique
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.warps.registry import WARP_FITS

GAMMAS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
PARTITION_NAMES = (*PARTITIONS, "z4+stable")


def combined():
    """Every partition with every warp that it takes."""
    for partition, warp in itertools.product(PARTITIONS, WARP_FITS):
        with contextlib.suppress(ValueError):
            make_technique(f"{partition}+{warp}")
            yield f"{partition}+{warp}"


SEEN = eqx.filter_jit(lambda mesh, camera: trace_surface(mesh, camera, 43, 36, GridCaster()))


def shadowed(technique: Technique, mesh, light, camera, surface):
    """Pixels that are not wholly lit, of those that see the plane."""
    shadows = technique.build(mesh, light, camera)
    return surface.is_seen & (shadows.visibility_of(surface.points, surface.normals, surface.face) < 0.999)


SHADOWED = eqx.filter_jit(shadowed)


def falsely_dark(technique: Technique, dtype, gammas=GAMMAS, azimuth=0.7):
    """How many pixels, for each γ."""
    corners = np.array([[-4, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]], float)
    mesh = Mesh.create(corners, np.array([[0, 2, 1], [0, 3, 2]]), dtype=dtype)
    camera = Camera.look_at((0.0, 8, 0), (0.0, 0, 0), (0.0, 0, -1), phi_y=0.4, near=1, far=20, aspect=1.2, dtype=dtype)
    surface = SEEN(mesh, camera)
    # Adaptive maps are refined on the host.
    built = shadowed if isinstance(technique, AdaptiveShadowMapping) else SHADOWED
    counts = []
    for gamma in gammas:
        sideways = np.sin(gamma) * np.array([np.cos(azimuth), 0, np.sin(azimuth)])
        light = DirectionalLight.create(sideways - np.array([0, np.cos(gamma), 0]), dtype=dtype)
        counts.append(int(jnp.sum(built(technique, mesh, light, camera, surface))))
    return counts


@pytest.mark.parametrize("name", ["exact", "hard", "pcf-3x3", "evsm4", "shadow-volumes"])
def test_no_technique_darkens_a_bare_plane(name):
    assert falsely_dark(make_technique(name, 64, GridCaster()), jnp.float32) == [0] * len(GAMMAS)


@pytest.mark.parametrize("name", ["minimax", "log", "stable", "z2+lispsm"])
def test_no_warp_of_a_partition_darkens_a_bare_plane(name):
    assert falsely_dark(make_technique(name, 64), jnp.float32) == [0] * len(GAMMAS)


@pytest.mark.long
@pytest.mark.parametrize("name", TECHNIQUES)
def test_no_technique_at_all_darkens_a_bare_plane(name, dtype):
    assert falsely_dark(make_technique(name, 64, GridCaster()), dtype) == [0] * len(GAMMAS)


@pytest.mark.long
@pytest.mark.parametrize("name", [*combined(), "faces", "cube"])
def test_no_warp_of_any_partition_darkens_a_bare_plane(name, dtype):
    for azimuth in (0.7, 0.0, -2.0):
        assert falsely_dark(make_technique(name, 64), dtype, azimuth=azimuth) == [0] * len(GAMMAS)


@pytest.mark.long
@pytest.mark.parametrize(("name", "partition"), list(zip(TECHNIQUES, itertools.cycle(PARTITION_NAMES), strict=False)))
def test_no_filter_of_a_partition_darkens_a_bare_plane(name, partition):
    technique = make_technique(name, 64, GridCaster())
    if not isinstance(technique, ShadowMapping):
        pytest.skip("without a map there is no partition")
    technique = eqx.tree_at(lambda t: t.partition, technique, make_technique(partition).partition)
    assert falsely_dark(technique, jnp.float32) == [0] * len(GAMMAS)
