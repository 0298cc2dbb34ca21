"""stencil, figures 5 to 8: parity lost at the near plane, globally and locally, and what repairs it.

Walls of shadow volumes that the near plane cuts away are not counted. In figure 5 the whole near plane lies in a volume
and every count is off by the same number; in figure 6 only parts of it do. Figure 7 shows the cap polygons, the volumes
cut by the near plane, and figure 8 the repaired picture.

Measured, in both views: the share of pixels that can be lit in which a rule decides wrongly, against shadow rays. The
rules are no repair, one correction for the whole picture (Crow's), caps that decrement as the source prints with
normals that point into the shadow, caps that increment, outward normals with caps that decrement, and z-fail, which
counts behind the surface and needs no cap; each with 8 bits that wrap, 8 bits that saturate, and 1 bit.

How to read it: pictures of the two views, and below them one dot for each rule and arithmetic. Dots at 0 are right.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.base import Claim
from experiments.claiming import all_true
from experiments.layout import empty_figure
from shadowjax._checks import require, require_int
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import PointLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.plotting import label, series_style, show_image, styled
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.scenes.base import to_mesh
from shadowjax.scenes.primitives import box
from shadowjax.shading import shade, trace_surface, valid_receivers, visibility_on
from shadowjax.techniques.exact import Exact
from shadowjax.volumes.extrude import volume_edges
from shadowjax.volumes.regions import boundary
from shadowjax.volumes.stencil import Counts, Stencil, eye_counts, is_lit, near_plane_counts

INSIDE, CUT = "near plane inside", "near plane cut"
ARITHMETIC = {
    "8 bits, wrapping": Stencil(8),
    "8 bits, saturating": Stencil(8, wraps=False),
    "1 bit": Stencil(1),
}
NONE, WHOLE, PRINTED, INCREMENT, OUTWARD, FAIL = (
    "no caps", "one correction", "caps decrement", "caps increment", "outward, caps decrement", "z-fail",
)  # fmt: skip
RULES = NONE, WHOLE, PRINTED, INCREMENT, OUTWARD, FAIL
WRAPPING, SATURATING, ONE_BIT = ARITHMETIC


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        width: Pixels across each picture, ≥ 32.
        near: Distance of the near plane, metres, in [0.2, 1.5].
        light_height: Height of the light above the floor, metres, in [2, 4].
    """

    width: int = 320
    near: float = 1.0
    light_height: float = 3.0

    def __post_init__(self):
        require_int(self.width, "width", 32)
        require(0.2 <= self.near <= 1.5, f"near must lie in [0.2, 1.5] metres; got {self.near}")
        require(2 <= self.light_height <= 4, f"light_height must lie in [2, 4] metres; got {self.light_height}")


@dataclass(frozen=True)
class Seen:
    """One view.

    Attributes:
        num_valid: Pixels that can be lit.
        wrong: (rule, arithmetic) → pixels decided wrongly.
        inverted: Pixels that the rule "light where the buffer holds more than 0" decides wrongly.
        even: Pixels with an even number of volumes, not 0, around their surface.
        one_bit_is_even: Whether those are exactly the pixels that one bit gets wrong.
        caps: Volumes around the near plane, the least and the most over those pixels.
        pictures: Rule → picture with 8 wrapping bits; and the caps alone.
    """

    num_valid: int
    wrong: Mapping[tuple[str, str], int]
    inverted: int
    even: int
    one_bit_is_even: bool
    caps: tuple[int, int]
    pictures: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Result:
    """Both views.

    Attributes:
        views: Name → what was seen.
        triangles: Of the scene.
    """

    views: Mapping[str, Seen]
    triangles: int


def stage() -> Mesh:
    """A floor, two panels one behind the other, and three small boxes between the light and a camera."""
    parts = [
        box((-4.0, -0.2, -3.5), (9.0, 0.0, 7.5)).painted((0.72, 0.70, 0.66)),
        box((1.8, 0.0, -1.2), (5.0, 3.4, -1.0)).painted((0.62, 0.40, 0.30)),
        box((3.0, 0.8, 0.2), (5.2, 2.6, 0.4)).painted((0.38, 0.50, 0.62)),
        box((0.02, 1.66, -0.14), (0.30, 1.94, 0.14)).painted((0.62, 0.40, 0.30)),
        box((0.12, 2.00, -2.1), (0.36, 2.24, -1.9)).painted((0.38, 0.50, 0.62)),
        box((-0.50, 1.30, -0.14), (-0.25, 1.60, 0.14)).painted((0.55, 0.58, 0.35)),
    ]
    return to_mesh(parts)


def look_at(mesh: Mesh, light: PointLight, camera: Camera, width: int) -> Seen:
    """Count everything in one view."""
    caster, height = BruteForceCaster(), width * 3 // 4
    surface = trace_surface(mesh, camera, width, height, caster)
    valid = np.asarray(valid_receivers(surface, light))
    exact = np.asarray(visibility_on(surface, Exact(caster).build(mesh, light, camera))) > 0
    found = boundary(mesh.vertices, mesh.faces, volume_edges(mesh), light.homogeneous, camera.position, "facing")
    to_light, _ = light.to_light(surface.points)
    seen = surface.points + 1e-4 * (surface.normals + to_light) - camera.position
    near = seen * (camera.near / jnp.maximum(seen @ camera.forward, 1e-6))[..., None]
    cut, fail = near_plane_counts(found, seen, near), eye_counts(found, seen, "z-fail")
    none = jnp.zeros_like(cut.up)
    # Crow's repair takes one number for the picture, here the one in its middle.
    drawn = {
        NONE: cut._replace(start=none), WHOLE: cut._replace(start=none + cut.start[height // 2, width // 2]),
        PRINTED: cut._replace(start=-cut.start), INCREMENT: cut,
        OUTWARD: Counts(-cut.start, cut.down, cut.up), FAIL: fail._replace(start=none + fail.start),
    }  # fmt: skip
    values = {(rule, bits): np.asarray(s.value(*drawn[rule])) for rule in RULES for bits, s in ARITHMETIC.items()}
    lit = {key: np.asarray(is_lit(jnp.asarray(value))) for key, value in values.items()}
    total = np.asarray(cut.total)
    even = valid & (total > 0) & (total % 2 == 0)
    pictures = {
        rule: np.asarray(shade(surface, (light,), (jnp.asarray(lit[rule, WRAPPING] * valid, surface.depth.dtype),)))
        for rule in (NONE, WHOLE, INCREMENT)
    }
    caps = np.asarray(cut.start)
    pictures["caps"] = np.where((caps > 0)[..., None], 0.6 + 0.2 * np.minimum(caps, 2)[..., None], pictures[NONE])
    return Seen(
        int(valid.sum()),
        {key: int(np.sum(valid & (shown != exact))) for key, shown in lit.items()},
        int(np.sum(valid & (lit[INCREMENT, WRAPPING] == exact))),
        int(even.sum()),
        bool(np.array_equal(even, valid & (lit[INCREMENT, ONE_BIT] != exact))),
        (int(caps[valid].min()), int(caps[valid].max())),
        pictures,
    )


def run(config: Config) -> Result:
    """Both views of one scene."""
    mesh = stage()
    light = PointLight.create((0.4, config.light_height, -6.0), 60.0)
    places = {
        INSIDE: ((6.7, 1.0, 4.2), (2.2, 0.3, 3.6), 38.0),
        CUT: ((0.0, 1.0, 5.0), (0.1, 0.9, 0.0), 25.0),
    }
    views = {}
    for name, (position, target, half_deg) in places.items():
        camera = Camera.look_at(position, target, phi_y=np.radians(half_deg), near=config.near, far=30.0, aspect=4 / 3)
        views[name] = look_at(mesh, light, camera, config.width)
    return Result(views, mesh.num_faces)


def claims(result: Result) -> tuple[Claim, ...]:
    """Caps that increment are right; everything else fails where the arithmetic says it must."""
    views = result.views
    inside, cut = views[INSIDE], views[CUT]

    def none_wrong(name: str, rule: str, *bits: str) -> Claim:
        counts = [view.wrong[rule, b] for view in views.values() for b in bits]
        return Claim(name, not any(counts), f"{counts} pixels wrong", "none in either view")

    def some_wrong(name: str, *cases: tuple[str, str, str]) -> Claim:
        shares = [views[v].wrong[rule, b] / views[v].num_valid for v, rule, b in cases]
        return Claim(name, min(shares) > 0.01, ", ".join(f"{share:.1%}" for share in shares), "more than 1 % each")

    both = list(views)
    return (
        none_wrong("caps that increment repair both views", INCREMENT, WRAPPING, SATURATING),
        none_wrong("z-fail needs no caps", FAIL, WRAPPING),
        some_wrong("without caps parity is lost", *((view, NONE, WRAPPING) for view in both)),
        Claim(
            "one correction repairs a near plane that lies inside as a whole",
            inside.wrong[WHOLE, WRAPPING] == 0 and inside.caps[0] == inside.caps[1] > 0,
            f"{inside.wrong[WHOLE, WRAPPING]} pixels wrong, {inside.caps} volumes around it", "none, one number",
        ),
        some_wrong("one correction fails where the near plane is cut", (CUT, WHOLE, WRAPPING)),
        some_wrong("caps that decrement fail with normals into the shadow", *((v, PRINTED, WRAPPING) for v in both)),
        none_wrong("with outward normals caps that decrement are right if counters wrap", OUTWARD, WRAPPING),
        some_wrong("and wrong if they saturate", *((view, OUTWARD, SATURATING) for view in both)),
        all_true(
            "one bit is wrong exactly where an even number of volumes is nested",
            [view.one_bit_is_even for view in views.values()] + [inside.even > 0], "statements",
        ),
        all_true(
            "light where the buffer holds more than 0 is the negative",
            [view.inverted == view.num_valid for view in views.values()], "views",
        ),
        Claim("the cut near plane holds places without a volume and with several", cut.caps[0] == 0 and cut.caps[1] > 1,
              f"{cut.caps[0]} to {cut.caps[1]} volumes", "0 to at least 2"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Shares of wrong pixels."""
    return {
        "triangles": result.triangles,
        "views": {
            name: {
                "pixels": view.num_valid,
                "caps": view.caps,
                "wrong": {
                    rule: {bits: view.wrong[rule, bits] / view.num_valid for bits in ARITHMETIC} for rule in RULES
                },
            }
            for name, view in result.views.items()
        },
    }


@styled
def draw(result: Result) -> Figure:
    """Pictures of both views above; the rules below."""
    figure = empty_figure(10.8, 8.2)
    above, below = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=[4.6, 3.6]))
    titles = {
        NONE: "no caps", WHOLE: "one correction for all", "caps": "cap polygons: grey 1, white 2",
        INCREMENT: "caps increment",
    }  # fmt: skip
    spots = above.subplots(2, len(titles), squeeze=False)
    figures = {INSIDE: "figure 5: near plane inside a volume", CUT: "figures 6 to 8: near plane cut by volumes"}
    for row, (view, told) in zip(spots, figures.items(), strict=True):
        for spot, (key, title) in zip(row, titles.items(), strict=True):
            show_image(spot, result.views[view].pictures[key], title if view == INSIDE else "")
        row[0].set_ylabel(told.replace(": ", ":\n"), fontsize=8.5)
    charts = below.subplots(1, 2, sharey=True)
    for spot, (name, view) in zip(charts, result.views.items(), strict=True):
        for index, bits in enumerate(ARITHMETIC):
            style = series_style(index)
            heights = np.arange(len(RULES)) + 0.22 * (index - 1)
            shares = [100 * view.wrong[rule, bits] / view.num_valid for rule in RULES]
            spot.plot(shares, heights, style["marker"], color=style["color"], label=bits, markersize=6)
        spot.set_yticks(np.arange(len(RULES)), RULES)
        spot.set_ylim(len(RULES) - 0.5, -0.5)
        label(spot, "pixels decided wrongly (%)", "", name.capitalize())
    charts[1].legend(loc="lower right", fontsize=8)
    return figure
