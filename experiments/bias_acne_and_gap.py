"""The acne / peter-panning trade-off: what a bias of each size does to a plane and to the foot of a wall, predicted and
measured.

Too little bias and a plane shadows itself; too much and light shows between a wall's foot and its shadow. In texels of
slope the border of acne is one number for every incidence and resolution: the filter's reach. In texels, in world units
and in depth-buffer units it is a curve that no constant follows. The gap is b·cos ε, so the bias that frees a plane
of acne costs a gap of ρ texels along the ground whatever the light's elevation, and half the map's size halves it.

Measured: a plane and a thin wall under light of many elevations, biases on a grid, through the package's own maps; the
share of the plane that is falsely dark, and the length of the lit strip behind the wall.

A second part follows γ, the angle between light and view, under the perspective warp of least worst error. From γ_lim
on, its n' puts a point at depth z of the view axis at z' = sin γ·(z + √(nf)). A texel is as wide as z' at its far end,
so along the view the least bias grows by one factor at every such γ. What γ changes is the whole level: the nearer
light and view are to right angles, the smaller the bias everywhere. Below γ_lim the warp, and the growth, fade.

How to read it: left, dots are biases with acne; the line is ρ·tan θ. Middle, the gap in texels of the map; lines are
b·cos ε. Right, the least bias in world units along the view for several γ; curves of one shape differ in level only.
"""

import itertools
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import agrees
from shadowjax import Bias, Camera, DirectionalLight, Mesh, PercentageCloser, ShadowMapping
from shadowjax._checks import require, require_int
from shadowjax._types import Array
from shadowjax.bias.rule import texel_size
from shadowjax.evaluate.acne import contact_gap, least_grid_bias, least_plane_bias
from shadowjax.partitions.single import SingleMap
from shadowjax.plotting import MARKERS, PALETTE, label, new_figure, styled
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.techniques.shadow_mapping import MappedShadows
from shadowjax.theory.aliasing.light_frustum import LightFrustum
from shadowjax.warps.fit import PerspectiveFit

HALF = 4.0  # half the extent of the ground, world units


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        elevations_deg: Of the light above the ground, degrees in (0, 90).
        kernel_size: K of the PCF, ≥ 1.
        resolution: Texels along a side of the map, ≥ 8.
        largest: Largest bias tried, texels.
        num_biases: Biases tried, ≥ 4.
        num_points: Receivers along a side of the ground, ≥ 8.
        gammas_deg: Angles between light and view of the last part, degrees in (0, 90].
    """

    elevations_deg: tuple[float, ...] = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
    kernel_size: int = 3
    resolution: int = 64
    largest: float = 8.0
    num_biases: int = 25
    num_points: int = 72
    gammas_deg: tuple[float, ...] = (10.0, 35.0, 60.0, 90.0)

    def __post_init__(self):
        require_int(self.kernel_size, "kernel_size", 1)
        require_int(self.resolution, "resolution", 8)
        require_int(self.num_biases, "num_biases", 4)
        require_int(self.num_points, "num_points", 8)
        require(self.largest > 0, f"largest must be positive; got {self.largest}")
        require(all(0 < e < 90 for e in self.elevations_deg), "elevations_deg must lie in (0, 90)")
        require(all(0 < g <= 90 for g in self.gammas_deg), "gammas_deg must lie in (0, 90]")


@dataclass(frozen=True)
class Result:
    """Acne and gaps.

    Attributes:
        elevation: ε, radians.
        bias: Biases, texels.
        acne: (elevations, biases) share of the plane that is falsely dark.
        border: Least bias without acne, texels: predicted.
        gap: (elevations, biases) lit strip behind the wall, texels across the light.
        texel: World size of the texel at each elevation.
        reach: ρ.
        depth: Depths along the view, world units.
        needed: γ in degrees → least bias there, world units.
        grows: γ in degrees → the factor by which the last of them exceeds the first, predicted; None below γ_lim.
    """

    elevation: np.ndarray
    bias: np.ndarray
    acne: np.ndarray
    border: np.ndarray
    gap: np.ndarray
    texel: np.ndarray
    reach: float
    depth: np.ndarray
    needed: dict[float, np.ndarray]
    grows: dict[float, float | None]


def _quad(corners: list[list[float]]) -> Mesh:
    return Mesh.create(np.array(corners), np.array([[0, 2, 1], [0, 3, 2]]), dtype=jnp.float32)


FLOOR = [[-HALF, 0, -HALF], [HALF, 0, -HALF], [HALF, 0, HALF], [-HALF, 0, HALF]]
WALL = [[0, 0, -HALF], [0, 0, HALF], [0, 6.0, HALF], [0, 6.0, -HALF]]
CAMERA = ((0.3, 5.0, 7.0), (0.1, 0.2, 0.0))


@eqx.filter_jit
def _visibilities(shadows: MappedShadows, points: Array, biases: Array) -> Array:
    """Visibility of points for each bias in texels."""
    up = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], points.dtype), points.shape)

    def one(value: Array) -> Array:
        changed = eqx.tree_at(lambda s: s.bias.value, shadows, value)
        return changed.visibility(points, up)

    return jax.lax.map(one, biases)


def run(config: Config) -> Result:
    """Every elevation with every bias; then the warped map under three lights."""
    camera = Camera.look_at(*CAMERA, phi_y=0.45, near=2.0, far=16.0, dtype=jnp.float32)
    technique = ShadowMapping(
        PercentageCloser(config.kernel_size), config.resolution, caster=BruteForceCaster(),
        bias=Bias(jnp.asarray(0.0, jnp.float32), "texel"),
    )  # fmt: skip
    biases = np.linspace(0, config.largest, config.num_biases)
    # receivers of acne lie before the wall, those of the gap behind it; as many of each, for one compiled program
    line, side = (np.linspace(low * HALF, high * HALF, config.num_points) for low, high in ((-0.8, 0.8), (-0.8, -0.1)))
    plane = np.stack(np.meshgrid(side, [0.0], line, indexing="ij"), -1).reshape(-1, 3)
    strip = np.linspace(0, HALF, len(plane))[:, None] * [1.0, 0, 0] + [0, 0, 0.37]
    mesh = Mesh.merge([_quad(FLOOR), _quad(WALL)])
    acne, gap, texels, border = [], [], [], []
    for elevation in np.radians(config.elevations_deg):
        turn = 0.4  # of the light out of the map's axes would not matter: its frame turns with it
        # the wall faces the light: it travels along +x and down
        straight = DirectionalLight.create([np.cos(elevation), -np.sin(elevation), 0.0], dtype=jnp.float32)
        aside = DirectionalLight.create(
            [np.cos(elevation) * np.cos(turn), -np.sin(elevation), np.cos(elevation) * np.sin(turn)], dtype=jnp.float32
        )
        bare = technique.build(mesh, aside, camera)
        points = jnp.asarray(plane, jnp.float32)
        normals = jnp.broadcast_to(jnp.asarray([0.0, 1.0, 0.0], jnp.float32), (1, 3))
        size = float(texel_size(bare.maps[0].grid, points[:1])[0])
        acne.append(np.asarray(1 - _visibilities(bare, points, jnp.asarray(biases, jnp.float32))).mean(axis=-1))
        border.append(float(least_grid_bias(bare.maps[0].grid, points[:1], normals, technique.filter.reach)[0]) / size)
        with_wall = technique.build(mesh, straight, camera)
        wide = float(texel_size(with_wall.maps[0].grid, points[:1])[0])
        lit = np.asarray(_visibilities(with_wall, jnp.asarray(strip, jnp.float32), jnp.asarray(biases, jnp.float32)))
        first_dark = np.array([int(np.argmax(row < 0.5)) if (row < 0.5).any() else len(row) for row in lit])
        gap.append(first_dark * HALF / len(strip) * np.sin(elevation) / wide)
        texels.append(wide)
    depth, needed, grows = np.geomspace(2.2, 15.0, 24), {}, {}
    for gamma in config.gammas_deg:
        needed[gamma] = _needed_along_view(camera, np.radians(gamma), depth, config)
        grows[gamma] = _growth(camera, np.radians(gamma), depth, config)
    return Result(
        np.radians(config.elevations_deg), biases, np.array(acne), np.array(border), np.array(gap), np.array(texels),
        technique.filter.reach, depth, needed, grows,
    )  # fmt: skip


def _needed_along_view(camera: Camera, gamma: float, depth: np.ndarray, config: Config) -> np.ndarray:
    """Least bias of surfaces tilted 45° to the light, on the view axis, under the minimax warp."""
    forward, up = np.asarray(camera.forward, float), np.array([0.0, 1.0, 0.0])
    side = np.cross(forward, up)
    above = np.cross(side / np.linalg.norm(side), forward)
    light = DirectionalLight.create(np.cos(gamma) * forward - np.sin(gamma) * above, dtype=jnp.float32)
    box = _quad(FLOOR)
    warp = SingleMap(PerspectiveFit("minimax", tight=False))
    grid = warp.grids(box, light, camera, config.resolution)[0]
    points = np.asarray(camera.position, float) + depth[:, None] * forward
    tilted = -np.asarray(light.direction, float) + side / np.linalg.norm(side)
    normals = np.broadcast_to(tilted / np.linalg.norm(tilted), points.shape)
    needed = least_grid_bias(
        grid, jnp.asarray(points, jnp.float32), jnp.asarray(normals, jnp.float32), config.kernel_size / 2
    )
    return np.asarray(needed, float)


def _growth(camera: Camera, gamma: float, depth: np.ndarray, config: Config) -> float | None:
    """Least bias at the last depth over that at the first, in closed form from γ_lim on.

    The bias is half the kernel times the texel's width at the kernel's far end, which is as wide as its z'. On a map of
    R rows the warp puts ρ rows more at 1/(1/z' − c), c = ρ/R·(f' − n')/(f'·n').
    """
    near, far, tangent = float(camera.near), float(camera.far), float(camera.half_size[1])
    sine, leaning = np.sin(gamma), tangent * np.cos(gamma)
    view = LightFrustum(*(jnp.asarray(x) for x in (near, far, np.arctan(tangent), np.arctan(tangent), gamma)))
    if gamma < float(view.gamma_limit):
        return None
    # the corners of the view nearest to and farthest from the warp's centre, and the axis between them
    virtual_near = sine * np.sqrt(near * far) + near * (sine - leaning)
    virtual_far = virtual_near + far * (sine + leaning) - near * (sine - leaning)
    places = sine * (depth[[0, -1]] + np.sqrt(near * far))
    step = 0.5 * config.kernel_size / config.resolution * (1 / virtual_near - 1 / virtual_far)
    nearest, farthest = 1 / (1 / places - step)
    return float(farthest / nearest)


def claims(result: Result) -> tuple[Claim, ...]:
    """Borders of acne, gaps, and how γ moves them."""
    over = result.bias[None, :] >= result.border[:, None] * (1 + 1e-4)
    under = result.bias[None, :] <= 0.8 * result.border[:, None]
    clean = float(result.acne[over].max()) if over.any() else 0.0
    dirty = float(result.acne[under].min())
    predicted = (
        np.asarray(contact_gap(result.bias[None, :], result.elevation[:, None])) * np.sin(result.elevation)[:, None]
    )
    off = float(np.abs(result.gap - predicted).max())
    at_border = result.border * np.cos(result.elevation) * np.sin(result.elevation)
    flat = least_plane_bias(2 * HALF, 64.0, 0.9, result.reach)
    fine = least_plane_bias(2 * HALF, 128.0, 0.9, result.reach)
    gradient = float(jax.grad(lambda r: least_plane_bias(2 * HALF, r, 0.9, result.reach))(64.0))
    growth = {gamma: values[-1] / values[0] for gamma, values in result.needed.items()}
    known = sorted(gamma for gamma, factor in result.grows.items() if factor is not None)
    bent = [growth[gamma] for gamma in known]
    return (
        Claim("no acne from the predicted bias on", clean == 0, f"{clean:.4f} of the plane dark", "0"),
        Claim("acne below four fifths of it", dirty > 0, f"at least {dirty:.4f} of the plane dark", "more than 0"),
        Claim(
            "the gap is b·cos ε",
            off < result.reach + 0.5,
            f"off by {off:.2f} texels",
            f"the kernel's reach and half a texel, {result.reach + 0.5:g}",
        ),
        Claim(
            "freeing a plane of acne costs at most reach·√2 texels of gap",
            bool((at_border <= result.reach * np.sqrt(2) + 1e-6).all()),
            f"{at_border.max():.2f} texels",
            f"at most {result.reach * np.sqrt(2):.2f}",
        ),
        Claim("twice the resolution halves both", abs(float(flat / fine) - 2) < 1e-6, f"{float(flat / fine):.6f}", "2"),
        Claim(
            "the gradient by the resolution is −b/resolution",
            abs(gradient * 64 / float(flat) + 1) < 1e-5,
            f"{gradient:.6f}",
            f"{-float(flat) / 64:.6f}",
        ),
        agrees(
            "under a warp the least bias grows along the view by (z₂ + √(nf))/(z₁ + √(nf)), γ ≥ γ_lim",
            [growth[gamma] for gamma in known],
            [result.grows[gamma] for gamma in known],
            0.01,
        ),
        Claim(
            "that is one factor at every such γ; below γ_lim it is less",
            bool(np.ptp(bent) < 0.03 * np.mean(bent)) and all(growth[g] < min(bent) for g in growth if g not in known),
            ", ".join(f"γ = {g:g}°: ×{v:.2f}" for g, v in growth.items()),
            "within 3 % of each other from γ_lim on",
        ),
        Claim(
            "what γ changes is the level: the nearer to right angles, the smaller the bias everywhere",
            all(bool((result.needed[a] > result.needed[b]).all()) for a, b in itertools.pairwise(known)),
            ", ".join(f"γ = {g:g}°: {result.needed[g][0]:.3f}" for g in known) + " nearby",
            "falling",
        ),
    )


def numbers(result: Result) -> dict[str, Any]:
    """Borders and gaps."""
    return {
        "elevation_deg": np.degrees(result.elevation), "acne_free_bias_texels": result.border,
        "bias_texels": result.bias,
        "gap_texels": result.gap, "depth": result.depth, "needed_world": result.needed,
        "predicted_growth": result.grows,
    }  # fmt: skip


@styled
def draw(result: Result) -> Figure:
    """Phase diagram, gaps, and γ."""
    figure, axes = new_figure(11.6, 4.0, 1, 3)
    left, middle, right = axes[0]
    degrees = np.degrees(result.elevation)
    across, up = np.meshgrid(degrees, result.bias, indexing="ij")
    dark = result.acne > 0
    left.scatter(across[dark], up[dark], s=6 + 160 * np.clip(result.acne[dark], 0, 0.4), color=PALETTE[1], label="acne")
    left.scatter(across[~dark], up[~dark], s=6, color=PALETTE[0], marker="s", label="clean")
    left.plot(degrees, result.border, color="#1d2330", label="predicted border")
    left.legend(loc="upper right", frameon=True, framealpha=1.0, edgecolor="none")
    label(left, "elevation of the light (°)", "bias (texels)", "Acne, and the line it ends at")
    for index, row in enumerate(range(0, len(degrees), max(1, len(degrees) // 3))):
        middle.plot(
            result.bias,
            result.gap[row],
            MARKERS[index],
            color=PALETTE[index],
            markersize=4,
            label=f"ε = {degrees[row]:g}°",
        )
        middle.plot(
            result.bias,
            result.bias * np.cos(result.elevation[row]) * np.sin(result.elevation[row]),
            color=PALETTE[index],
        )
    middle.legend(loc="upper left")
    label(middle, "bias (texels)", "gap behind a wall (texels of the map)", "What the bias costs")
    for index, (gamma, values) in enumerate(result.needed.items()):
        right.plot(
            result.depth, values, color=PALETTE[index], marker=MARKERS[index], markevery=4, label=f"γ = {gamma:g}°"
        )
    right.set_xscale("log")
    right.set_yscale("log")
    right.set_xticks([2, 4, 8, 16], ["2", "4", "8", "16"])
    right.minorticks_off()
    ticks = [0.1, 0.2, 0.4, 0.8]
    right.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    right.legend(loc="upper left")
    label(right, "depth along the view (world units)", "least bias (world units)", "A warp moves the border with depth")
    return figure
