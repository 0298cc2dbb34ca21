"""Options of every command: frozen dataclasses that map one to one to flags and to TOML."""

# Light imports only: help must not wait for JAX.

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, get_type_hints

from tyro.conf import OmitArgPrefixes, Positional, arg

DEFAULT_SCENE = "smooth-and-abrupt"


@dataclass(frozen=True)
class Limits:
    """What a number may be: at least `low` and at most `high`, or strictly between them."""

    low: float
    high: float
    strictly: bool = False

    def __contains__(self, value: Any) -> bool:
        """Whether a number is within; NaN is not."""
        return self.low < value < self.high if self.strictly else self.low <= value <= self.high

    def __str__(self) -> str:
        """The interval in the notation of mathematics."""
        low, high = (
            f"{end:.0f}" if end == round(end) and abs(end) < 1e9 else f"{end:g}" for end in (self.low, self.high)
        )
        return f"({low}, {high})" if self.strictly else f"[{low}, {high}]"


_NUMBER = arg(metavar="FLOAT")
_WHOLE = arg(metavar="INT")
_XYZ = arg(metavar="X Y Z")
_FILE = arg(metavar="FILE")

Side = Annotated[int, _WHOLE, Limits(1, 16384)]
Samples = Annotated[int, _WHOLE, Limits(1, 64)]
Triangles = Annotated[int, _WHOLE, Limits(1, 10_000_000)]
Partitions = Annotated[int, _WHOLE, Limits(1, 64)]
Taps = Annotated[int, _WHOLE, Limits(1, 255)]
Depths = Annotated[int, _WHOLE, Limits(2, 5)]
Trials = Annotated[int, _WHOLE, Limits(2, 10_000)]
Distance = Annotated[float, _NUMBER, Limits(1e-12, 1e12)]
Point = Annotated[tuple[float, float, float], _XYZ, Limits(-1e12, 1e12)]
Turn = Annotated[float, _NUMBER, Limits(-360, 360)]
Elevation = Annotated[float, _NUMBER, Limits(-90, 90)]
HalfAngle = Annotated[float, _NUMBER, Limits(0, 90, strictly=True)]
RightAngle = Annotated[float, _NUMBER, Limits(0, 90)]
Factor = Annotated[float, _NUMBER, Limits(1, 1e9, strictly=True)]


def limits_of(command: type) -> dict[str, Limits]:
    """The limits of each numeric option of a command, by the name of its field; groups of options left out."""
    hints = get_type_hints(command, include_extras=True)
    found = {name: [one for one in _metadata(hint) if isinstance(one, Limits)] for name, hint in hints.items()}
    return {name: limits[0] for name, limits in found.items() if limits}


def _metadata(hint: Any) -> Iterator[Any]:
    """What annotates a type or a part of it."""
    yield from getattr(hint, "__metadata__", ())
    for part in getattr(hint, "__args__", ()):
        yield from _metadata(part)


def check_limits(chosen: Any) -> None:
    """Complain about the first option whose number is outside its limits.

    Raises:
        ValueError: With the flag, the limits and the number.
    """
    limits = limits_of(type(chosen))
    for item in dataclasses.fields(chosen):
        value: Any = getattr(chosen, item.name)
        if dataclasses.is_dataclass(value):
            check_limits(value)
        for number in value if isinstance(value, tuple) else (value,):
            allowed = limits.get(item.name)
            if allowed is not None and number is not None and number not in allowed:
                raise ValueError(f"--{item.name.replace('_', '-')} must lie in {allowed}; got {number}")


@dataclass(frozen=True)
class SceneOptions:
    """Other light, camera and surroundings for any scene."""

    light: Annotated[str, arg(metavar="NAME")] = "directional"
    """Kind of light: directional, spot or point; the last two stand outside the scene without --light-position."""
    light_direction: Annotated[Point | None, _XYZ] = None
    """The way the light travels; its length does not matter."""
    light_azimuth_deg: Annotated[Turn | None, _NUMBER] = None
    """Where the light stands: degrees from the viewer's side (+z) to the right (+x)."""
    light_elevation_deg: Annotated[Elevation | None, _NUMBER] = None
    """How high the light stands: degrees above the horizon."""
    light_position: Annotated[Point | None, _XYZ] = None
    """Where a spot or point light stands."""
    camera_position: Annotated[Point | None, _XYZ] = None
    """Where the camera stands, world units."""
    camera_target: Annotated[Point | None, _XYZ] = None
    """What the camera looks at; the middle of the scene if only its position is given."""
    phi_deg: Annotated[HalfAngle | None, _NUMBER] = None
    """Half the vertical angle of view, degrees in (0, 90)."""
    near: Annotated[Distance | None, _NUMBER] = None
    """Near distance of the camera, world units."""
    far: Annotated[Distance | None, _NUMBER] = None
    """Far distance of the camera, world units."""
    num_triangles: Annotated[Triangles | None, _WHOLE] = None
    """About how many triangles a built-in scene gets."""
    up: Literal["auto", "y", "z"] = "auto"
    """Up axis of a mesh file; auto takes z for STL and y for the rest."""
    ground: bool = True
    """Whether a mesh file gets a ground plane."""


@dataclass(frozen=True)
class PictureOptions:
    """Size of the picture and of the maps."""

    width: Side = 480
    """Pixels across."""
    height: Side = 360
    """Pixels down."""
    samples: Samples = 1
    """K: every pixel is the mean of K × K camera samples."""
    resolution: Side = 512
    """Texels along each side of a shadow map."""
    caster: Annotated[str | None, arg(metavar="NAME")] = None
    """Ray caster, brute, grid or bvh; the fastest by default. All give the same pictures."""


TechniqueNames = Annotated[tuple[str, ...], arg(metavar="NAME ...")]


@dataclass(frozen=True)
class Report:
    """Render, compare, analyse, recommend and verify: writes DIR/index.html and DIR/results.json."""

    scene: Positional[Annotated[str, arg(metavar="SCENE")]] = DEFAULT_SCENE
    """Name of a built-in scene, or a mesh file (OBJ, PLY, STL, GLB, ...)."""
    out: Annotated[str, arg(metavar="DIR")] = "out"
    """Folder to write into; other files in it stay as they are."""
    techniques: TechniqueNames = ()
    """Techniques to show, as NAME or LABEL=NAME (`shadowjax techniques`); fourteen of every kind by default."""
    equations: Annotated[tuple[str, ...], arg(metavar="SOURCE ...")] = ("mdsm", "filtering", "stencil", "asm")
    """Sources whose equations the page verifies; `none` leaves the section out."""
    sweep: bool = True
    """Whether the recommendation also measures half and double the map's resolution."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""
    picture: OmitArgPrefixes[PictureOptions] = field(default_factory=lambda: PictureOptions(resolution=256))
    setting: OmitArgPrefixes[SceneOptions] = field(default_factory=SceneOptions)


@dataclass(frozen=True)
class Render:
    """Render one picture as PNG."""

    scene: Positional[Annotated[str, arg(metavar="SCENE")]] = DEFAULT_SCENE
    """Name of a built-in scene, or a mesh file."""
    output: Annotated[str, arg(aliases=["-o"], metavar="FILE")] = ""
    """PNG file to write, or to replace; must be given."""
    technique: Annotated[str, arg(metavar="NAME")] = "pcf-3x3"
    """Shadow technique, such as z4+minimax+evsm4; `exact` traces a shadow ray for every sample."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""
    picture: OmitArgPrefixes[PictureOptions] = field(
        default_factory=lambda: PictureOptions(width=640, height=480, samples=2, resolution=1024)
    )
    setting: OmitArgPrefixes[SceneOptions] = field(default_factory=SceneOptions)


@dataclass(frozen=True)
class Compare:
    """Every technique against the exact shadow: error, tones, memory and time."""

    scene: Positional[Annotated[str, arg(metavar="SCENE")]] = DEFAULT_SCENE
    """Name of a built-in scene, or a mesh file."""
    techniques: TechniqueNames = ()
    """Techniques to compare, as NAME or LABEL=NAME (`shadowjax techniques`); one of every kind by default."""
    presets: bool = False
    """Whether to compare every preset as well."""
    pareto: Annotated[str | None, _FILE] = None
    """PNG file to write, or to replace: error against memory and time, the best joined by a line."""
    json: Annotated[str | None, _FILE] = None
    """File for the records, one for each technique; `-` writes to standard output and nothing else there."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""
    picture: OmitArgPrefixes[PictureOptions] = field(default_factory=PictureOptions)
    setting: OmitArgPrefixes[SceneOptions] = field(default_factory=SceneOptions)


@dataclass(frozen=True)
class Verify:
    """Check every equation of the ledger; exit code 1 if one fails."""

    only: Annotated[tuple[str, ...], arg(metavar="ID ...")] = ()
    """Sources (such as mdsm), equations, or beginnings of their names; all by default."""
    json: Annotated[str | None, _FILE] = None
    """File for the results; `-` writes to standard output and nothing else there."""


@dataclass(frozen=True)
class Presets:
    """Parameter sets of engines: list them, or show one."""

    name: Positional[Annotated[str | None, arg(metavar="NAME")]] = None
    """One preset, with all its parameters; the list of all if left out."""
    json: Annotated[str | None, _FILE] = None
    """File for what is shown; `-` writes to standard output and nothing else there."""


@dataclass(frozen=True)
class Techniques:
    """Tokens that names of techniques are made of: list them, or what names mean and cost."""

    names: Positional[TechniqueNames] = ()
    """Names, or LABEL=NAME, such as z4+minimax+evsm4; all tokens if left out."""
    json: Annotated[str | None, _FILE] = None
    """File for what is shown; `-` writes to standard output and nothing else there."""


@dataclass(frozen=True)
class Experiments:
    """Figures and tables of the sources: list them, or run them and judge their claims."""

    name: Positional[Annotated[str, arg(metavar="NAME")]] = ""
    """An experiment, or `all`; writes NAME.png and NAME.json. The list of all if left out."""
    quick: bool = False
    """Whether to use the small settings of each: seconds instead of minutes."""
    config: Annotated[str | None, _FILE] = None
    """TOML file in place of configs/NAME.toml."""
    out: Annotated[str, arg(metavar="DIR")] = "out/experiments"
    """Folder to write into."""
    json: Annotated[str | None, _FILE] = None
    """File for the list; `-` writes to standard output and nothing else there."""


@dataclass(frozen=True)
class Scenes:
    """List the built-in scenes."""

    json: Annotated[str | None, _FILE] = None
    """File for the list; `-` writes to standard output and nothing else there."""


@dataclass(frozen=True)
class NearDistance:
    """The near distance n' of a warped shadow map with the least largest error, or the least storage."""

    near: Distance = 1.0
    """Near distance of the view, world units."""
    far: Distance = 100.0
    """Far distance of the view, world units."""
    phi_deg: HalfAngle = 30.0
    """Half the angle of view, degrees in (0, 90)."""
    gamma_deg: RightAngle = 90.0
    """Angle between light and view, degrees in [0, 90]."""
    section: Literal["axis", "whole"] = "axis"
    """Where the error counts: along the view axis, or over the whole section of the view."""
    objective: Annotated[str, arg(metavar="NAME")] = "z"
    """What is made small: z, the largest error along z; storage, M_x·M_z; both, the larger of M_x and M_z."""
    json: Annotated[str | None, _FILE] = None
    """File for the result; `-` writes to standard output and nothing else there."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""


@dataclass(frozen=True)
class Splits:
    """Where to cut the view in depth so that k maps waste the least storage."""

    near: Distance = 1.0
    """Near distance of the view, world units."""
    far: Distance = 100.0
    """Far distance of the view, world units."""
    phi_deg: HalfAngle = 30.0
    """Half the angle of view, degrees in (0, 90)."""
    gamma_deg: RightAngle = 90.0
    """Angle between light and view, degrees in [0, 90]."""
    num_partitions: Partitions = 4
    """k, number of maps."""
    objective: Literal["max", "sum"] = "max"
    """Whether the largest map or their sum is made small."""
    warp: Literal["uniform", "lispsm", "minimax", "least_storage", "free"] = "uniform"
    """Warp of each map; free chooses every n' together with the planes."""
    section: Literal["axis", "whole"] = "axis"
    """Where the error counts: along the view axis, or over the whole section of the view."""
    seam_limit: Annotated[Factor | None, _NUMBER] = None
    """Largest factor, above 1, by which the error may jump from one map to the next; none by default."""
    json: Annotated[str | None, _FILE] = None
    """File for the result; `-` writes to standard output and nothing else there."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""


SceneNames = Annotated[tuple[str, ...], arg(metavar="SCENE ...")]


@dataclass(frozen=True)
class SearchOptions:
    """The views that a search measures on."""

    scenes: SceneNames = (DEFAULT_SCENE,)
    """Built-in scenes or mesh files to search over."""
    width: Side = 160
    """Pixels across."""
    height: Side = 120
    """Pixels down."""
    resolution: Side = 256
    """Texels along each side of a shadow map."""
    objective: Annotated[str, arg(metavar="NAME")] = "light"
    """What the error is of: light, received light, where grazing incidence hardly counts, or visibility."""
    json: Annotated[str | None, _FILE] = None
    """File for the result; `-` writes to standard output and nothing else there."""
    config: Annotated[str | None, _FILE] = None
    """TOML file with any of these options (names with underscores); flags win over it."""


@dataclass(frozen=True)
class BiasSearch:
    """The bias of least error over scenes, next to the default that frees planes of acne."""

    technique: Annotated[str, arg(metavar="NAME")] = "pcf-3x3"
    """Technique that reads shadow maps, such as pcf-3x3 or z4+minimax+pcf-3x3."""
    unit: Literal["slope", "texel", "world", "normal"] = "slope"
    """Unit of the bias; normal is an offset along the normal, in texels."""
    search: OmitArgPrefixes[SearchOptions] = field(default_factory=SearchOptions)


@dataclass(frozen=True)
class ExponentSearch:
    """Exponents, damping, terms and bleed clamps of least error over scenes."""

    technique: Annotated[str, arg(metavar="NAME")] = "evsm4"
    """Technique whose filter has numbers, such as vsm, esm, evsm4, msm-hamburger, csm or z4+minimax+evsm4."""
    blur: Annotated[Taps | None, _WHOLE] = None
    """Taps of the Gaussian blur along an axis, odd; the filter's own by default."""
    evaluations: Trials = 24
    """Most settings that are measured."""
    test_scenes: SceneNames = ()
    """Scenes that are measured but not searched over."""
    search: OmitArgPrefixes[SearchOptions] = field(default_factory=SearchOptions)


@dataclass(frozen=True)
class TapsSearch:
    """Which extra depths a multi-depth map should keep, or where the taps of PCF should lie."""

    what: Literal["ranks", "cells", "offsets"] = "ranks"
    """Order statistics of the 3 × 3 neighbourhood or its cells, by exhaustive search; or tap offsets, by gradient."""
    num_depths: Depths = 2
    """n, depths of a texel, 2 to 5; for ranks and cells."""
    technique: Annotated[str, arg(metavar="NAME")] = "pcf-2x2"
    """Technique whose depths or taps are searched, with hard or pcf-KxK for the number of taps."""
    steps: Trials = 24
    """Most steps of the minimiser; for offsets."""
    test_scenes: SceneNames = ("fence", "solids")
    """Scenes that the choice is tested on."""
    search: OmitArgPrefixes[SearchOptions] = field(
        default_factory=lambda: SearchOptions(scenes=(DEFAULT_SCENE, "plant"))
    )
