"""stencil, tables 1 to 3: polygons and shadow polygons of four scenes, and how long each stage of a frame takes.

Table 1 counts the polygons of the BSP tree, built for the fewest cuts, and the shadow polygons of a frame, the mean of
ten places of the light. Tables 2 and 3 give milliseconds for generation (the polygons that face the light and their
outer edges), capping and rendering, with and without 3-D acceleration, in pictures of 400 × 300 pixels (here less).

Measured, on the scenes rebuilt (`stencil_scenes` says what the source does not): the same counts. The cubes come out
exactly: 125 cubes that each show the light three faces have 6 outer edges each, and the ground 4, which makes 754. The
recursive tetrahedron's come out within a few percent. A check in closed form holds for every scene: an edge between two
faces whose normals differ by δ belongs to the silhouette for a share δ/π of all directions, so the mean count of a body
is the sum of δ/π over its edges. The stages are run in their plainest form: shadow sides between eye and surface are
counted, entered minus left, with what the cap adds for the eye; light is where the count is 0, and that is compared
with shadow rays pixel by pixel, and with the technique `ShadowVolumes`.

Times are compared as ratios only: between scenes, for one stage, next to the source's. Rendering is that of the
technique itself, which draws each quad over the part of the picture that it can cover: so its time for a quad is a
result, and differs between scenes by what the quads cover.

How to read it: pictures are shaded where the count is 0. Bars on the left are counts, in pairs, the source's and
these; on the right, times per polygon relative to the first scene's.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true
from experiments.stencil_counting import count_crossings, generate, volumes_around
from experiments.stencil_scenes import (
    ACCELERATED,
    CUBES,
    EMULATED,
    PUBLISHED,
    SCENES,
    SOLIDS,
    SPHERE,
    TETRAHEDRON,
    Built,
    build,
    padded_rows,
)
from shadowjax._checks import require, require_int
from shadowjax.geometry.adjacent_edges import EdgeSides, edge_sides, find_adjacent_edges, silhouette_counts
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight, PointLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.plotting import PALETTE, label, styled
from shadowjax.plotting.style import new_figure
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.scenes.parts import Part
from shadowjax.shading import Surface, shade, trace_surface, valid_receivers
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_volumes import ShadowVolumes
from shadowjax.volumes.bsp import build_bsp

GENERATION, CAPPING, RENDERING = STAGES = ("generation", "capping", "rendering")


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        num_lights: Places of the light, ≥ 1; the source has ten.
        light_distance: Of each from the middle of the scene, in halves of the scene's diagonal, > 1.
        candidates: Planes tried for each node of the tree, ≥ 1.
        width: Pixels across, ≥ 16.
        height: Pixels down, ≥ 12.
        num_directions: Directions over which the mean silhouette is taken, ≥ 100.
        turns: Times each stage is measured, ≥ 0; the least time counts. With 0 no time is measured or claimed.
    """

    num_lights: int = 10
    light_distance: float = 4.0
    candidates: int = 64
    width: int = 240
    height: int = 180
    num_directions: int = 4000
    turns: int = 3

    def __post_init__(self):
        for value, name, least in (
            (self.num_lights, "num_lights", 1), (self.candidates, "candidates", 1), (self.width, "width", 16),
            (self.height, "height", 12), (self.num_directions, "num_directions", 100), (self.turns, "turns", 0),
        ):  # fmt: skip
            require_int(value, name, least)
        require(self.light_distance > 1, f"light_distance must exceed 1, the scene itself; got {self.light_distance}")


@dataclass(frozen=True)
class Counted:
    """One scene.

    Attributes:
        triangles: Of the model.
        pieces: Polygons of the tree.
        outer: Outer edges of the tree's polygons that face the light, one number for each light.
        inner: Their inner edges: what marking saves is twice this.
        masked: Outer edges of the model's triangles that face the light, by the mask under `jit`.
        listed: The same by the lists of figure 3.
        writes: Mean number of shadow sides that a pixel's line of sight crosses, for each light.
        wrong: Pixels, for each light, whose count says otherwise than their shadow ray.
        pixels: Pixels that look at a side facing the light, for each light.
        apart: Pixels, for each light, to which `ShadowVolumes` gives another answer than the count; none if not timed.
        quads: Quads that `ShadowVolumes` draws for each light; none if not timed.
        expected: Sum of δ/π over the edges of the bodies.
        mean: Mean silhouette of the bodies over directions, and its standard error.
        times: Stage → seconds of the processor, mean over the lights; empty if not timed.
        image: The picture for the first light, sRGB.
    """

    triangles: int
    pieces: int
    outer: tuple[int, ...]
    inner: tuple[int, ...]
    masked: tuple[int, ...]
    listed: tuple[int, ...]
    writes: tuple[float, ...]
    wrong: tuple[int, ...]
    pixels: tuple[int, ...]
    apart: tuple[int, ...]
    quads: tuple[int, ...]
    expected: float
    mean: tuple[float, float]
    times: Mapping[str, float]
    image: np.ndarray

    @property
    def shadow_polygons(self) -> float:
        """Mean over the lights: the source's nShadow."""
        return float(np.mean(self.outer))


def run(config: Config) -> Mapping[str, Counted]:
    """All scenes, in double precision."""
    with jax.enable_x64(True):
        scenes = build(config.num_lights, config.light_distance)
        return {name: _counted(scene, config) for name, scene in scenes.items()}


@eqx.filter_jit
def _masked(mesh: Mesh, sides: EdgeSides, light: Any) -> jnp.ndarray:
    return silhouette_counts(mesh, sides, light)


_shaded = eqx.filter_jit(lambda surface, light, lit: shade(surface, (light,), (lit,)))


@eqx.filter_jit
def _exact(mesh: Mesh, camera: Camera, light: PointLight, surface: Surface) -> tuple[jnp.ndarray, jnp.ndarray]:
    """Shadow rays, and where they matter."""
    visible = Exact(BruteForceCaster()).build(mesh, light, camera).visibility(surface.points, surface.normals)
    return visible, valid_receivers(surface, light)


@eqx.filter_jit
def _mean_outline(mesh: Mesh, sides: EdgeSides, directions: jnp.ndarray) -> jnp.ndarray:
    """Silhouette of each direction of light."""
    one = jnp.ones(3, directions.dtype)
    return jax.lax.map(
        lambda travel: jnp.sum(jnp.abs(silhouette_counts(mesh, sides, DirectionalLight(travel, one)))), directions
    )


def _counted(scene: Built, config: Config) -> Counted:
    part, mesh = scene.part, scene.mesh
    tree = build_bsp(part.vertices, part.faces, candidates=config.candidates)
    pieces = [c[:n] for c, n in zip(np.asarray(tree.corners), np.asarray(tree.num_corners), strict=True)]
    planes = np.asarray(tree.planes)[np.asarray(tree.node)] * np.where(np.asarray(tree.turned), -1, 1)[:, None]
    sides = _padded(edge_sides(mesh), mesh)
    surface = trace_surface(mesh, scene.camera, config.width, config.height, BruteForceCaster())
    triangles = jnp.asarray(np.asarray(mesh.vertices)[np.asarray(mesh.faces)])
    points, eye = surface.points.reshape(-1, 3), scene.camera.position
    rows: dict[str, list[Any]] = {
        key: [] for key in ("outer", "inner", "masked", "listed", "writes", "wrong", "pixels", "apart", "quads")
    }
    times: dict[str, list[float]] = {stage: [] for stage in STAGES} if config.turns else {}
    real = Mesh.create(part.vertices, part.faces, part.colors)
    image = None
    for light in scene.lights:
        place = np.asarray(light.position)
        edges, _ = generate(planes, pieces, place)
        count = np.asarray(_masked(mesh, sides, light))
        drawn = np.flatnonzero(count)
        ends = np.asarray(mesh.vertices)[np.asarray(sides.vertices)[drawn]]
        length = len(sides.vertices)
        drawing = padded_rows(ends, length), padded_rows(count[drawn], length), jnp.asarray(len(drawn), jnp.int32)
        cap = volumes_around(eye, light.position, triangles)
        signed, crossed = count_crossings(eye, points, light.position, *drawing)
        lit = ((signed + cap) == 0).astype(points.dtype).reshape(surface.is_seen.shape)
        exact, valid = _exact(mesh, scene.camera, light, surface)
        if config.turns:
            times[GENERATION].append(_least(lambda at=place: generate(planes, pieces, at), config.turns)[1])
            times[CAPPING].append(_least(lambda at=light: volumes_around(eye, at.position, triangles), config.turns)[1])
            shadows = ShadowVolumes().build(real, light, scene.camera)
            drawn_lit, seconds = _least(
                lambda what=shadows: what.visibility(surface.points, surface.normals), config.turns
            )
            times[RENDERING].append(seconds)
            rows["quads"].append(int(shadows.num_quads))
            rows["apart"].append(int(jnp.sum((drawn_lit != lit) & valid)))
        facing = part.faces[_faces_light(part, place)]
        rows["outer"].append(len(edges.external))
        rows["inner"].append(len(edges.internal))
        rows["masked"].append(int(np.abs(count).sum()))
        rows["listed"].append(len(find_adjacent_edges(facing).external))
        rows["writes"].append(float(jnp.mean(crossed)))
        rows["wrong"].append(int(jnp.sum((lit != exact) & valid)))
        rows["pixels"].append(int(jnp.sum(valid)))
        if image is None:
            image = np.asarray(_shaded(surface, light, lit))
    expected, mean = _outline(scene, sides, config.num_directions)
    assert image is not None
    return Counted(
        part.num_faces, tree.num_pieces, **{key: tuple(values) for key, values in rows.items()}, expected=expected,
        mean=mean, times={stage: float(np.mean(values)) for stage, values in times.items()}, image=image,
    )  # fmt: skip


def _padded(sides: EdgeSides, mesh: Mesh) -> EdgeSides:
    """Edges filled up to as many as there are sides, so that all scenes share one program."""
    return eqx.tree_at(lambda s: s.vertices, sides, padded_rows(np.asarray(sides.vertices), 3 * mesh.num_faces))


def _faces_light(part: Part, place: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
    return np.sum(np.cross(b - a, c - a) * (place - a), axis=1) > 0


def _least(work: Callable[[], Any], turns: int) -> tuple[Any, float]:
    """Result and least processor time of several calls, after one that compiles."""
    result, least = jax.block_until_ready(work()), np.inf
    for _ in range(turns):
        start = time.process_time()
        jax.block_until_ready(work())
        least = min(least, time.process_time() - start)
    return result, float(least)


def _outline(scene: Built, sides: EdgeSides, num_directions: int) -> tuple[float, tuple[float, float]]:
    """Sum of δ/π over the edges of closed bodies, and the mean silhouette over directions; the open ground left out."""
    mesh, keep = scene.mesh, np.arange(scene.mesh.num_faces) < scene.part.num_faces - 2
    faces = np.where(keep[:, None], np.asarray(mesh.faces), 0)
    bodies = Mesh(mesh.vertices, jnp.asarray(faces, jnp.int32), mesh.face_colors)
    own = _padded(edge_sides(bodies), mesh)
    a, b, c = np.moveaxis(np.asarray(mesh.vertices)[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    face = np.repeat(np.arange(len(faces)), 3)
    real = np.asarray(own.sense) != 0
    order = np.argsort(np.asarray(own.edge)[real], kind="stable")
    pairs = face[real][order].reshape(-1, 2)
    one, two = normals[pairs[:, 0]], normals[pairs[:, 1]]
    angles = np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.sum(one * two, axis=1))
    directions = np.random.default_rng(0).normal(size=(num_directions, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    counts = np.asarray(_mean_outline(bodies, own, jnp.asarray(directions)), float)
    return float(angles.sum() / np.pi), (float(counts.mean()), float(counts.std() / np.sqrt(len(counts))))


def per_polygon(times: Mapping[str, tuple[float, ...]], stage: int, counts: Mapping[str, float]) -> dict[str, float]:
    """Time of a stage for each polygon, relative to the first scene's."""
    each = {name: times[name][stage] / counts[name] for name in SCENES}
    return {name: value / each[SCENES[0]] for name, value in each.items()}


def relative_times(result: Mapping[str, Counted]) -> dict[str, dict[str, dict[str, float]]]:
    """Stage → whose → scene → time per polygon: of the tree for generation and capping, of the shadow for rendering.

    Nothing of this machine where no time was measured.
    """
    timed = all(counted.times for counted in result.values())
    sources = {"table 2": ACCELERATED, "table 3": EMULATED}
    out: dict[str, dict[str, dict[str, float]]] = {}
    for index, stage in enumerate(STAGES):
        column = int(stage == RENDERING)
        published = {name: float(PUBLISHED[name][column]) for name in SCENES}
        out[stage] = {whose: per_polygon(times, index, published) for whose, times in sources.items()}
        if timed:
            here = {name: tuple(counted.times[stage] for stage in STAGES) for name, counted in result.items()}
            measured = {n: float(np.mean(c.quads)) if column else float(c.pieces) for n, c in result.items()}
            out[stage]["here"] = per_polygon(here, index, measured)
    return out


def _spread(values: Mapping[str, float]) -> float:
    return max(values.values()) / min(values.values())


def claims(result: Mapping[str, Counted]) -> tuple[Claim, ...]:
    """Counts, their closed form, their use, and the ratios of times."""
    cubes, shadows = result[CUBES], {name: counted.shadow_polygons for name, counted in result.items()}
    wrong, pixels = (sum(sum(getattr(c, key)) for c in result.values()) for key in ("wrong", "pixels"))
    tetrahedra, closed = result[TETRAHEDRON], 161 * 6 * (np.pi - np.arccos(1 / 3)) / np.pi + 4
    timed = _timed_claims(result) if all(counted.times for counted in result.values()) else ()
    return (
        Claim(
            "table 1, cubes: 1502 polygons in the tree and 754 shadow polygons a frame, exactly",
            (cubes.pieces, cubes.shadow_polygons) == PUBLISHED[CUBES], f"{cubes.pieces} and {cubes.shadow_polygons:g}",
            "1502 and 754",
        ),
        Claim(
            "table 1: fewer shadow polygons for the sphere than for the solids, although its tree has more polygons",
            shadows[SPHERE] < shadows[SOLIDS] and result[SPHERE].pieces > result[SOLIDS].pieces,
            f"{shadows[SPHERE]:.1f} of {result[SPHERE].pieces} and {shadows[SOLIDS]:.1f} of {result[SOLIDS].pieces}",
            "27 of 256 and 34 of 94 in the source",
        ),
        Claim(
            "table 1, recursive tetrahedron: 161 closed tetrahedra have the source's shadow polygons, which 256 cannot",
            # a few lights say little: its tetrahedra face few ways, so their outer edges come and go together
            tetrahedra.triangles == 4 * 161 + 2
            and abs((tetrahedra.mean[0] + 4) / PUBLISHED[TETRAHEDRON][1] - 1) < 0.05
            and PUBLISHED[TETRAHEDRON][1] < 256 * 3,
            f"{shadows[TETRAHEDRON]:.1f}; {closed:.1f} in the mean over directions; 256 have at least 772",
            "596 within 5 %",
        ),
        Claim(
            "table 1: the other scenes, rebuilt by guess, have the source's shadow polygons within a factor 2",
            all(0.5 < shadows[n] / PUBLISHED[n][1] < 2 for n in (SPHERE, SOLIDS)),
            ", ".join(f"{shadows[n]:.1f}" for n in (SPHERE, SOLIDS)), "27, 34 times 0.5 to 2",
        ),
        all_true(
            "the mask over all edges and the lists of figure 3 give the same outer edges for every scene and light",
            [c.masked == c.listed for c in result.values()], "scenes",
        ),
        Claim(
            "bodies have, in the mean over directions, the sum of δ/π outer edges",
            all(abs(c.mean[0] - c.expected) <= 5 * c.mean[1] + 1e-6 * c.expected for c in result.values()),
            ", ".join(f"{c.mean[0]:.2f} ({c.expected:.2f})" for c in result.values()), "within 5 standard errors",
        ),
        Claim(
            "light is where the count of sides and cap is 0: the answer of shadow rays but for pixels on an edge",
            wrong <= 2e-4 * pixels, f"{wrong} of {pixels} pixels differ", "at most 2 in 10 000",
        ),
        Claim(
            "marking saves two sides for every inner edge: most of them",
            all(2 * sum(c.inner) > sum(c.outer) for n, c in result.items() if n != TETRAHEDRON),
            ", ".join(f"{2 * np.mean(c.inner):.0f} of {2 * np.mean(c.inner) + c.shadow_polygons:.0f}"
                      for c in result.values()), "more than half, but for lone triangles",
        ),
        *timed,
    )  # fmt: skip


def _timed_claims(result: Mapping[str, Counted]) -> tuple[Claim, ...]:
    """What rests on a clock, and that the technique which is timed draws the same shadows."""
    ratios = relative_times(result)
    share = {name: c.times[RENDERING] / sum(c.times.values()) for name, c in result.items()}
    seconds = [result[name].times[RENDERING] for name in SCENES]
    apart, pixels = (sum(sum(getattr(c, key)) for c in result.values()) for key in ("apart", "pixels"))
    return (
        Claim(
            "the technique ShadowVolumes, whose rendering is timed, gives the answers of the count",
            apart <= 2e-4 * pixels, f"{apart} of {pixels} pixels differ", "at most 2 in 10 000",
        ),
        Claim(
            "generation takes about as long for each polygon of the tree in every scene, as in tables 2 and 3",
            _spread(ratios[GENERATION]["here"]) < 3, f"×{_spread(ratios[GENERATION]['here']):.2f} between scenes",
            f"less than ×3 (source ×{_spread(ratios[GENERATION]['table 2']):.2f})", timed=True,
        ),
        Claim(
            "rendering by ShadowVolumes takes longest for the two scenes of many shadow polygons, as in table 2",
            min(seconds[2:]) > max(seconds[:2]),
            ", ".join(f"{1e3 * one:.1f} ms" for one in seconds)
            + f"; ×{_spread(ratios[RENDERING]['here']):.2f} between scenes for each quad",
            f"tetrahedron and cubes after sphere and solids (source ×{_spread(ratios[RENDERING]['table 2']):.2f})",
            timed=True,
        ),
        Claim(
            "rendering is the longest stage of the two larger scenes", min(share[TETRAHEDRON], share[CUBES]) > 0.5,
            f"{share[TETRAHEDRON]:.0%} and {share[CUBES]:.0%} of a frame", "more than half (source 90 % and 87 %)",
            timed=True,
        ),
    )  # fmt: skip


def numbers(result: Mapping[str, Counted]) -> dict[str, Any]:
    """Tables 1 to 3, here and in the source."""
    return {
        "scenes": {
            name: {
                "triangles": c.triangles, "n_bsp": c.pieces, "n_shadow": c.shadow_polygons,
                "total": c.pieces + c.shadow_polygons, "source": PUBLISHED[name], "quads_of_shadow_volumes": c.quads,
                "inner_edges": float(np.mean(c.inner)),
                "sides_crossed_per_pixel": float(np.mean(c.writes)), "wrong_pixels": c.wrong,
                "sum_of_angles_over_pi": c.expected, "mean_silhouette_and_standard_error": c.mean, "seconds": c.times,
            }
            for name, c in result.items()
        },
        "time_per_polygon_relative_to_the_first_scene": relative_times(result),
    }  # fmt: skip


@styled
def draw(result: Mapping[str, Counted]) -> Figure:
    """Pictures above, counts and relative times below."""
    figure, axes = new_figure(11.5, 6.2, 2, 4)
    for spot, (name, counted) in zip(axes[0], result.items(), strict=True):
        spot.imshow(np.clip(counted.image, 0, 1))
        spot.set_title(f"{name}\nsides crossed per pixel: {np.mean(counted.writes):.2f}", fontsize=9)
        spot.set_axis_off()
    grid = axes[1, 0].get_gridspec()
    for spot in axes[1]:
        spot.remove()
    left, right = figure.add_subplot(grid[1, :2]), figure.add_subplot(grid[1, 2:])
    place = np.arange(len(SCENES))
    bars = {
        "tree, source": ([PUBLISHED[n][0] for n in SCENES], PALETTE[0], 0.45),
        "tree, here": ([result[n].pieces for n in SCENES], PALETTE[0], 1.0),
        "shadow, source": ([PUBLISHED[n][1] for n in SCENES], PALETTE[1], 0.45),
        "shadow, here": ([result[n].shadow_polygons for n in SCENES], PALETTE[1], 1.0),
    }
    for index, (name, (heights, color, alpha)) in enumerate(bars.items()):
        drawn = left.bar(place + 0.2 * (index - 1.5), heights, 0.19, color=color, alpha=alpha, label=name)
        left.bar_label(drawn, fmt="%.0f", fontsize=6.5, padding=1)
    left.set_yscale("log")
    left.set_ylim(top=6000)
    label(left, "", "polygons a frame (mean over lights)", "Table 1")
    ratios = relative_times(result)
    series = [(stage, whose) for stage in (GENERATION, RENDERING) for whose in ratios[stage]]
    for index, (stage, whose) in enumerate(series):
        heights = [ratios[stage][whose][n] for n in SCENES]
        color = PALETTE[2 if stage == GENERATION else 3]
        alpha = {"table 2": 0.35, "table 3": 0.65, "here": 1.0}[whose]
        right.bar(place + 0.14 * (index - 2.5), heights, 0.13, color=color, alpha=alpha, label=f"{stage}, {whose}")
    label(right, "", "time per polygon (first scene = 1)", "Tables 2 and 3, as ratios")
    for spot in (left, right):
        spot.set_xticks(
            place, [n.replace("recursive ", "recursive\n").replace("geodesic ", "geodesic\n") for n in SCENES]
        )
        spot.legend(fontsize=7, ncols=2, loc="upper left")
    right.set_ylim(top=1.7 * right.get_ylim()[1])
    return figure
