"""The capability table against derivatives: 0 where it says so, central differences where it says exact."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapes import above, lights, plate_over_plane

from shadowjax import (
    TECHNIQUES,
    Bias,
    BruteForceCaster,
    Convolution,
    DirectionalLight,
    Exponential,
    FourierStep,
    Hard,
    Mesh,
    Prefilter,
    Variance,
    make_technique,
    mesh_edges,
)
from shadowjax._numerics import normalize
from shadowjax.evaluate.capability import FUNCTIONS, GRADES, PARAMETERS, capability, capability_table
from shadowjax.filters.offset_pcf import OffsetPercentageCloser
from shadowjax.maps.shadow_map import build_covered_map, build_shadow_map
from shadowjax.partitions.cascades import Cascades
from shadowjax.techniques.shadow_mapping import MappedShadows
from shadowjax.warps.base import WarpFit
from shadowjax.warps.fit import corners, padded, view_axis, visible_range
from shadowjax.warps.perspective import PerspectiveWarp

# One of each kind of filter; the others of the registry differ in numbers, or in the layer that their maps keep.
KINDS = ("hard", "pcf-2x2", "pcf-bilinear", "pcss", "brabec-seidel", "3sm", "vsm", "esm", "csm")
MOVED = ("vertices", "light", "camera", "near distance", "splits", "bias")
# How far each is moved where more than a slope is asked for: less than two texels at the plate's shadow.
REACH = np.array([0.4, 0.12, 0.2, 12.0, 0.12, 0.6])
# On so small a map a wide blur of exponentials is 1 everywhere, clamped; few terms compile fast.
SPECIAL = {
    "csm": Convolution(FourierStep(2), Prefilter(1)),
    "esm": Exponential(10.0, Prefilter(1)),
    "vsm": Variance(Prefilter(3), footprint=0.0),
    "vsm+coverage": Variance(Prefilter(3), footprint=0.0),
    "OffsetPercentageCloser": OffsetPercentageCloser.create([(0.3, 0.2)]),
}
MESH, SIZE = plate_over_plane(), 12
EDGES = mesh_edges(MESH)
SIDE = np.linspace(-1.9, 1.6, 8)
POINTS = jnp.asarray([(x + 0.03 * z, 0.0, z) for x in SIDE for z in SIDE])
NORMALS = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0]), POINTS.shape)


def kind_of(name):
    return type(getattr(make_technique(name), "filter", None))


class Near(WarpFit):
    """A perspective warp of a given n'."""

    distance: jax.Array

    def fit(self, space, light, mesh, camera):
        body = space.project(corners(camera, *visible_range(camera, mesh)))[0]
        return PerspectiveWarp.fit(padded(body), 1 / self.distance, view_axis(space, camera))


def placed(amounts):
    """The mesh, the grid of each slice, lookups in each, and the share of each, with everything moved."""
    shift, turn, step, near, split, bias = amounts
    plate = jnp.arange(8)[:, None] >= 4
    vertices = MESH.vertices + shift * jnp.where(plate, jnp.asarray([1.0, 0.1, 0.3]), jnp.asarray([0.02, 0.0, 0.01]))
    mesh = Mesh(vertices, MESH.faces, MESH.face_colors)
    light = lights()["directional"]
    light = DirectionalLight(normalize(light.direction + turn * jnp.asarray([1.0, 0.0, -0.5])), light.color)
    camera = eqx.tree_at(lambda c: c.position, above(), above().position + step * jnp.asarray([0.5, 0.2, -0.4]))
    partition = Cascades(2, cuts=jnp.stack([2.0 + 0 * split, 8.0 + split, 16.0 + 0 * split]), warp=Near(9.0 + near))
    grids = partition.grids(mesh, light, camera, SIZE)
    maps = tuple(build_shadow_map(BruteForceCaster(), mesh, grid) for grid in grids)
    shadows = MappedShadows(Hard(), partition, camera, maps, (), Bias(0.02 + bias, "world"))
    lookups = tuple(shadows.lookup(one, POINTS, NORMALS) for one in maps)
    flat = jnp.zeros((len(POINTS), 2))
    lookups = tuple(dataclasses.replace(one, gradient=flat) for one in lookups)
    return mesh, grids, lookups, partition.shares(grids, camera, POINTS)


@eqx.filter_jit
def push(function, at, along):
    """What a function gives, and its derivative along each of several directions of its inputs' real numbers."""
    moving, fixed = eqx.partition(at, eqx.is_inexact_array)

    def apply(moving):
        return eqx.partition(function(eqx.combine(moving, fixed)), eqx.is_inexact_array)

    value, forward, rest = jax.linearize(apply, moving, has_aux=True)
    return eqx.combine(value, rest), jax.vmap(forward)(along)


def cast_plain(part):
    return build_shadow_map(BruteForceCaster(), *part)


def cast_covered(part):
    return build_covered_map(BruteForceCaster(), *part, EDGES)


class Read(eqx.Module):
    """Visibility, weighted by each point's share of a slice."""

    filter: eqx.Module

    def __call__(self, part):
        shadow_map, lookup, share = part
        if self.filter.cast_factor == 1:
            return share * self.filter.visibility(self.filter.prepare_map(shadow_map), lookup)
        fine = jnp.repeat(jnp.repeat(shadow_map.depth, 2, axis=0), 2, axis=1)
        lookup = eqx.tree_at(lambda one: one.position, lookup, 2 * lookup.position)
        return share * self.filter.visibility(self.filter.prepare(fine), lookup)


def followed(name, amounts):
    """Visibility of every point, its derivative by everything that moves, and the share of each slice."""
    cast = cast_covered if name == "vsm+coverage" else cast_plain
    filter_ = SPECIAL.get(name) or make_technique(name).filter
    (mesh, grids, lookups, shares), moves = push(placed, jnp.asarray(amounts), jnp.eye(len(MOVED)))
    total, slopes = 0, 0
    for k in range(2):
        shadow_map, change = push(cast, (mesh, grids[k]), (moves[0], moves[1][k]))
        part = (shadow_map, lookups[k], shares[k])
        value, slope = push(Read(filter_), part, (change, moves[2][k], moves[3][k]))
        total, slopes = total + value, slopes + slope
    return np.asarray(total), np.asarray(slopes), np.asarray(shares[0])


@pytest.mark.parametrize("name", [*KINDS, "vsm+coverage", "OffsetPercentageCloser"])
def test_what_the_table_says_of_a_technique_is_what_its_derivative_does(name):
    """Of visibility at fixed points, through mesh, light, camera, warp, slices and bias: one by one."""
    value, slopes, share = followed(name, np.zeros(6))
    assert 5 < share.sum() < len(POINTS) - 5
    for k, parameter in enumerate(MOVED):
        grade = capability(name, parameter)
        step = 1e-6 * np.eye(6)[k]
        differences = (followed(name, step)[0] - followed(name, -step)[0]) / 2e-6
        np.testing.assert_allclose(slopes[k], differences, atol=1e-4 * max(1, np.abs(differences).max()))
        assert np.any(slopes[k] != 0) == (grade != "values"), parameter
        assert grade in ("values", "topology", "silhouettes")
        if grade == "values":
            assert np.any(followed(name, REACH * np.eye(6)[k])[0] != value), parameter


def test_maps_that_do_not_follow_the_camera_are_graded_so():
    """Grids of the partitions that techniques come with, by where the camera is and by where it looks."""
    light = lights()["directional"]
    partitions = {repr(p): (p, name) for name in TECHNIQUES if (p := getattr(make_technique(name), "partition", None))}
    assert len(partitions) == 2  # SingleMap and CubeMap, both uniform
    follows = Cascades(2, cuts=jnp.asarray([2.0, 8.0, 16.0]))
    for partition, name in (*partitions.values(), (follows, None)):

        def placed_at(amounts, partition=partition):
            turn = jnp.stack([jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(3), jnp.asarray([-1.0, 0.0, 0.0])])
            moved = above().position + amounts[0] * jnp.asarray([0.5, 0.2, -0.4])
            rotation = above().rotation @ (jnp.eye(3) + amounts[1] * turn)
            camera = eqx.tree_at(lambda c: (c.position, c.rotation), above(), (moved, rotation))
            return partition.grids(MESH, light, camera, SIZE)

        _, slopes = push(placed_at, jnp.zeros(2), jnp.eye(2))
        moves, turns = (any(np.any(np.asarray(leaf[k]) != 0) for leaf in jax.tree.leaves(slopes)) for k in (0, 1))
        assert turns
        assert moves == (name is None)
        assert name is None or capability(name, "camera position") == "zero"


def leftover(name, k, num=20):
    """Part of the change of visibility along a way that the slopes at its steps do not tell."""
    way = [followed(name, REACH * np.eye(6)[k] * at) for at in np.linspace(0, 1, num + 1)]
    # Which slice answers for a point is a choice without a gradient.
    stays = np.all([share == way[0][2] for *_, share in way], axis=0)
    assert stays.sum() > 0.9 * len(POINTS)
    values = np.array([value for value, *_ in way])[:, stays]
    slopes = np.array([slopes[k] for _, slopes, _ in way])[:, stays] * REACH[k] / num
    change = np.diff(values, axis=0)
    return np.abs(change - 0.5 * (slopes[1:] + slopes[:-1])).sum() / np.abs(change).sum()


@pytest.mark.parametrize("parameter", MOVED[:5])
def test_coverage_follows_what_fixed_topology_misses(parameter):
    """Slopes add up to the change along a way on which texels change the surfaces they see, where nothing jumps."""
    k = MOVED.index(parameter)
    assert capability("vsm+coverage", parameter) == "silhouettes"
    assert leftover("vsm+coverage", k) < 0.05
    # Under light and slices the map moves with what it holds: hardly a texel changes surfaces on so short a way.
    if parameter in ("vertices", "camera", "near distance"):
        assert capability("vsm", parameter) == "topology"
        assert leftover("vsm", k) > 0.5


def test_coverage_keeps_gradients_finite():
    """No area, a plate on the edge of the floor, one in the light's own plane, and one that no texel sees."""
    (mesh, grids, *_), moves = push(placed, jnp.zeros(6), jnp.eye(6))
    plate = np.asarray(mesh.vertices[4:])
    along = np.asarray(lights()["directional"].direction)
    upright = np.stack([plate[0], plate[1], plate[1] + along, plate[0] + along])
    for corners_ in (plate * 0, plate[[0, 0, 2, 2]], np.asarray(mesh.vertices[:4]), upright, plate + 500.0):
        moved = Mesh(mesh.vertices.at[4:].set(corners_), mesh.faces, mesh.face_colors)
        shadow_map, change = push(cast_covered, (moved, grids[0]), (moves[0], moves[1][0]))
        planes, change = push(Prepared(SPECIAL["vsm"]), shadow_map, change)
        for leaf in jax.tree.leaves((planes, change)):
            assert np.isfinite(leaf).all()
        assert np.abs(planes.planes).max() > 0


class Prepared(eqx.Module):
    """What a filter stores of a map."""

    filter: eqx.Module

    def __call__(self, shadow_map):
        return self.filter.prepare_map(shadow_map)


def test_every_technique_is_of_a_checked_kind_and_graded_like_it():
    checked = {kind_of(name): name for name in KINDS}
    for name in TECHNIQUES:
        if name in ("exact", "vsm+coverage") or kind_of(name) not in checked:
            continue
        for parameter in MOVED:
            assert capability(name, parameter) == capability(checked[kind_of(name)], parameter)
    # The page on differentiability, which tests run, differentiates these.
    elsewhere = {kind_of(name) for name in ("msm-hamburger", "xcsm", "evsm4")}
    known = set(checked) | {type(None)} | elsewhere
    assert {kind_of(name) for name in TECHNIQUES} <= known


def test_kernels_are_static_in_size_and_in_weights():
    """Another number is another program: no leaf to differentiate, another structure, and another answer."""
    sized = {"pcf-2x2": "kernel_size", "pcf-bilinear": "kernel_size", "pcss": "num_taps", "3sm": "kernel_size"}
    for name, field in sized.items():
        filter_ = make_technique(name).filter
        other = dataclasses.replace(filter_, **{field: getattr(filter_, field) + 1})
        assert other.num_fetches > filter_.num_fetches
        assert jax.tree.structure(other) != jax.tree.structure(filter_)
        assert (capability(name, "kernel size"), capability(name, "kernel weights")) == ("static", "none")
    for name in ("vsm", "esm", "csm", "evsm4", "msm-hamburger", "xcsm", "vsm+coverage"):
        filter_ = make_technique(name).filter
        for parameter, change in (("kernel size", {"size": 9}), ("kernel weights", {"sigma": 2.0})):
            other = dataclasses.replace(filter_, prefilter=dataclasses.replace(filter_.prefilter, **change))
            weights = [one.prefilter.weights for one in (filter_, other)]
            assert weights[0].shape != weights[1].shape or np.abs(weights[0] - weights[1]).max() > 0.01
            assert jax.tree.structure(other) != jax.tree.structure(filter_)
            assert capability(name, parameter) == "static"
    for name in ("hard", "exact", "brabec-seidel", "shadow-volumes", "asm", *FUNCTIONS):
        assert capability(name, "kernel size") == capability(name, "kernel weights") == "none"


def test_static_numbers_are_no_leaves_and_the_table_is_complete():
    table = capability_table()
    assert set(table) == set(TECHNIQUES) | set(FUNCTIONS)
    for name, row in table.items():
        assert set(row) == set(PARAMETERS)
        assert set(row.values()) <= set(GRADES)
        if name in TECHNIQUES and name != "asm" and "static" in row.values():
            assert not jax.tree.leaves(make_technique(name).filter)
    assert table["esm"]["exponent"] == table["evsm2"]["exponent"] == "static"
    assert table["hard"]["exponent"] == table["exact"]["bias"] == "none"


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="parameter must be one of"):
        capability("hard", "colour")
    with pytest.raises(ValueError, match="unknown technique 'harder'; did you mean hard"):
        capability("harder", "bias")
