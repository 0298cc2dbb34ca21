"""Adjacent edges: the source's worked example, any order of polygons, any number of faces at an edge, and the mask."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from shapes import bumpy_sphere, plate_over_plane

from shadowjax import DirectionalLight, Mesh, PointLight
from shadowjax.geometry.adjacent_edges import edge_sides, find_adjacent_edges, silhouette_counts
from shadowjax.geometry.edges import edge_adjacency, silhouette

# The polygons of figure 4; its D and E, not legible in print, are the only ones that give its table.
FIGURE_4 = [[0, 1, 8, 3], [3, 8, 10, 7], [1, 4, 5, 11, 8], [1, 2, 9, 6, 4], [5, 6, 9, 11]]
counts = eqx.filter_jit(silhouette_counts)


def surplus(polygons):
    """Directed edges left when opposite ones cancel: the signed boundary, as a multiset in a sorted list."""
    walked = [(i, j) for p in polygons for i, j in zip(p, [*p[1:], p[0]], strict=True) if i != j]
    total = {side: walked.count(side) - walked.count(side[::-1]) for side in walked}
    return sorted(itertools.chain.from_iterable([side] * max(n, 0) for side, n in total.items()))


def external(polygons):
    return sorted(map(tuple, find_adjacent_edges(polygons).external.tolist()))


def test_worked_example_of_figure_4():
    found = find_adjacent_edges(FIGURE_4)
    table = {vertex: [j for j, _ in entries] for vertex, entries in found.lists().items()}
    assert {vertex: set(js) for vertex, js in table.items()} == {
        0: {1}, 1: {8, 4, 2}, 2: {9}, 3: {0}, 4: {5}, 5: {11, 6}, 6: {4}, 7: {3}, 8: {3, 10}, 9: {6, 11}, 10: {7},
        11: {8},
    }  # fmt: skip
    assert {tuple(side) for side in found.internal.tolist()} == {(1, 8), (1, 4), (5, 11), (8, 3), (9, 6)}
    assert len(found.external) == 12
    assert found.polygons[found.sides.tolist().index([8, 3])] == 0
    assert found.partners[found.sides.tolist().index([8, 3])] == 1


def test_visible_entries_are_the_signed_boundary_whatever_the_order():
    """Random soups of polygons on few vertices: edges with many faces, both senses, repeated polygons."""
    rng = np.random.default_rng(0)
    crowded = 0
    for _ in range(300):
        polygons = [rng.permutation(5)[: rng.integers(3, 5)].tolist() for _ in range(rng.integers(1, 9))]
        expected = surplus(polygons)
        crowded += len(expected) != len(set(expected))
        assert external(polygons) == expected
        assert external([polygons[i] for i in rng.permutation(len(polygons))]) == expected
        assert external([np.roll(p, rng.integers(len(p))).tolist() for p in polygons]) == expected
    assert crowded > 20


def marks_that_match_again(polygons):
    """Figure 3 with marks in place of deletion, and marked entries found again: what the text would have."""
    lists, hidden = {}, set()
    for polygon in polygons:
        for i, j in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
            if i in lists.get(j, []):
                hidden.add((j, i))
            else:
                lists.setdefault(i, []).append(j)
    return sorted((i, j) for i, js in lists.items() for j in js if (i, j) not in hidden)


def test_an_entry_that_is_marked_must_match_no_second_side():
    fan = [[0, 1, 2], [1, 0, 3], [1, 0, 4]]
    assert external(fan).count((1, 0)) == 1
    assert marks_that_match_again(fan).count((1, 0)) == 0
    assert external(FIGURE_4) == marks_that_match_again(FIGURE_4)


def test_sides_without_length_and_unlike_orientation():
    assert external([[0, 1, 1, 2], [2, 1, 3]]) == surplus([[0, 1, 2], [2, 1, 3]])
    # The second triangle is wound the other way: both sides of the shared edge stay.
    assert external([[0, 1, 2], [1, 2, 3]]).count((1, 2)) == 2
    with pytest.raises(ValueError, match="polygon 1 has 2"):
        find_adjacent_edges([[0, 1, 2], [0, 1]])


def facing_faces(mesh, light):
    to_light, _ = light.to_light(mesh.triangles()[:, 0])
    return np.asarray(jnp.sum(mesh.area_vectors() * to_light, axis=1) > 0)


def crowded_mesh():
    """Random triangles on few vertices: many at every edge, without order."""
    rng = np.random.default_rng(3)
    return Mesh.create(rng.normal(size=(8, 3)), np.stack([rng.permutation(8)[:3] for _ in range(60)]))


def test_counts_of_the_mask_are_the_visible_entries():
    """For a body, an open plate and a crowd of faces at every edge, in one mesh."""
    mesh = Mesh.merge([crowded_mesh(), bumpy_sphere(subdivisions=1), plate_over_plane()])
    sides = edge_sides(mesh, weld=False)
    for light in (DirectionalLight.create((-0.3, -1.0, 0.2)), PointLight.create((0.4, 5.0, 0.1))):
        count = np.asarray(counts(mesh, sides, light))
        ends = np.asarray(sides.vertices)
        made = [tuple(e if n > 0 else e[::-1]) for e, n in zip(ends.tolist(), count.tolist(), strict=True)
                for _ in range(abs(n))]  # fmt: skip
        assert sorted(made) == external(np.asarray(mesh.faces)[facing_faces(mesh, light)].tolist())


def test_pairs_of_the_mask_bound_the_shadow_on_crowded_edges():
    """`edge_adjacency` pairs opposite senses only, so its mask, summed with signs, is the boundary too."""
    mesh = crowded_mesh()
    light = DirectionalLight.create((0.1, -1.0, 0.3))
    facing, edges = facing_faces(mesh, light), edge_adjacency(mesh)
    mask = np.asarray(silhouette(mesh, edges, light))
    walked = []
    for (i, j), (one, two), seen in zip(
        *(np.asarray(x).tolist() for x in (edges.vertices, edges.faces, mask)), strict=True
    ):
        ends = [[i, j]] * int(seen and facing[one]) + [[j, i]] * int(seen and two >= 0 and facing[two])
        walked += [tuple(end) for end in ends]
    total = sorted(side for side in set(walked) for _ in range(walked.count(side) - walked.count(side[::-1])))
    assert total == surplus(np.asarray(mesh.faces)[facing].tolist())
    assert np.asarray(edges.num_faces).max() > 2


def test_orientation_does_not_matter_where_all_faces_cast():
    mesh = bumpy_sphere(subdivisions=1)
    sides = edge_sides(mesh)
    assert sides.is_watertight
    flip = np.random.default_rng(0).random(mesh.num_faces) < 0.3
    mixed = Mesh(
        mesh.vertices, jnp.where(jnp.asarray(flip)[:, None], mesh.faces[:, ::-1], mesh.faces), mesh.face_colors
    )
    mixed_sides = edge_sides(mixed)
    assert not mixed_sides.is_watertight
    assert not edge_adjacency(mixed).is_closed
    light = PointLight.create((0.3, 4.0, 1.0))
    whole, turned = (np.asarray(counts(m, s, light, "all")) for m, s in ((mesh, sides), (mixed, mixed_sides)))
    np.testing.assert_array_equal(np.abs(whole), np.abs(turned))
    # The front and the back of a body both end at its silhouette: twice what the front alone gives.
    np.testing.assert_array_equal(whole, 2 * np.asarray(counts(mesh, sides, light)))
    with pytest.raises(ValueError, match="'facing', 'all'"):
        silhouette_counts(mesh, sides, light, "both")


@eqx.filter_jit
def count_and_mask(mesh, sides, edges, light):
    return silhouette_counts(mesh, sides, light), silhouette(mesh, edges, light)


def test_faces_without_length_or_area_change_no_silhouette():
    """A cube seen corner on has a hexagon for an outline, with degenerate faces along its edges too."""
    box = trimesh.creation.box()
    thin = Mesh.create(box.vertices, np.concatenate([box.faces, [[0, 0, 1], [2, 3, 2]]]))
    sides, edges = edge_sides(thin), edge_adjacency(thin)
    assert sides.is_watertight
    count, mask = count_and_mask(thin, sides, edges, DirectionalLight.create((-1.0, -1.1, -1.2)))
    outline = np.asarray(sides.vertices)[np.asarray(count) != 0]
    assert len(outline) == 6
    assert (np.bincount(outline.reshape(-1)) <= 2).all()
    assert int(mask.sum()) == 6
