"""What a report reports: pictures, records, tones, costs, equations and advice about one scene."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shadowjax._checks import require_choice, require_int
from shadowjax._types import Float
from shadowjax.evaluate.compare import Comparison, View, measure, reference_view
from shadowjax.evaluate.records import Record
from shadowjax.evaluate.shadow_distance import texel_advice
from shadowjax.filters.base import Filter
from shadowjax.filters.hard import Hard
from shadowjax.filters.multi_depth import DepthPolicy, MultiDepth, Neighbourhood
from shadowjax.filters.pcf import PercentageCloser
from shadowjax.ledger.equation import SOURCES, Result, ledger, verify
from shadowjax.maps.shadow_map import ShadowMap
from shadowjax.partitions.by_light import ByLight
from shadowjax.partitions.cascades import Cascades
from shadowjax.presets.names import Techniques, as_techniques
from shadowjax.rays.caster import Caster
from shadowjax.rays.casters import default_caster
from shadowjax.report.advisor import Advice, Choice, advise
from shadowjax.report.machine import machine
from shadowjax.scenes.base import Scene
from shadowjax.shading import shade, visibility_on
from shadowjax.techniques.base import Technique
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.theory import cost, tones

Pixels = Float[np.ndarray, "height width 3"]
Grey = Float[np.ndarray, "height width"]

# A choice that shows each idea once: the test alone, filters of growing size, more depths, and both together; and one
# of each family that averages codes of depth; and the exact answer without a map.
DEFAULT_TECHNIQUES = (
    "hard", "pcf-3x3", "pcf-4x4", "pcf-bilinear-3x3", "2sm-max", "3sm", "2sm-max+pcf-3x3", "3sm+pcf-2x2",
    "3sm+pcf-3x3", "vsm", "esm", "evsm4", "msm-hamburger",
    "shadow-volumes",
)  # fmt: skip
# The sources whose techniques a report shows; the command `verify` checks all.
DEFAULT_EQUATIONS = ("mdsm", "filtering", "stencil", "asm")


@dataclass(frozen=True)
class ReportSettings:
    """How a report is made.

    Args:
        techniques: Names, objects, or a mapping from names of one's own to either.
        width: Pixels across.
        height: Pixels down.
        resolution: Texels along each side of a map.
        samples: K; each pixel gets K² samples.
        equations: Sources whose equations are verified; none skips the section.
        sweep: Whether the advisor also measures half and double the resolution.
    """

    techniques: Techniques = DEFAULT_TECHNIQUES
    width: int = 480
    height: int = 360
    resolution: int = 256
    samples: int = 1
    equations: tuple[str, ...] = DEFAULT_EQUATIONS
    sweep: bool = True

    def __post_init__(self) -> None:
        for name in ("width", "height", "resolution", "samples"):
            require_int(getattr(self, name), name, 1)
        for source in self.equations:
            require_choice(source, "source of equations", SOURCES)


@dataclass(frozen=True)
class ToneRow:
    """Tones of one technique: most possible, along straight edges (predicted by enumeration), and counted here."""

    technique: str
    bound: int | None
    straight_edge: int | None
    along_axis: int | None
    counted: int


@dataclass(frozen=True)
class CostRow:
    """Fetches of one technique for this picture: h·w·q to build, f·k to look up (mdsm, eqs 5.3 to 5.5)."""

    technique: str
    build_per_texel: int
    taps: int
    build_fetches: int
    lookup_fetches: int


@dataclass(frozen=True)
class Crossover:
    """A multi-depth technique against a larger plain filter: fetches cross at `fragments` (mdsm, eq. 5.6)."""

    multi_depth: str
    plain: str
    fragments: float
    size_ratio: float
    here: str


@dataclass(frozen=True)
class Findings:
    """Everything that the page and the results file are made of."""

    scene: Scene
    settings: ReportSettings
    comparison: Comparison
    exact_picture: Pixels
    pictures: tuple[Pixels, ...]
    light_map: ShadowMap
    tones: tuple[ToneRow, ...]
    receivers: int
    costs: tuple[CostRow, ...]
    crossovers: tuple[Crossover, ...]
    choices: tuple[Choice, ...]
    advice: Advice | None
    equations: tuple[Result, ...]
    machine: dict[str, str]
    command: str

    def pixel_values(self, index: int) -> Grey:
        """Visibility of every pixel by one technique, background lit."""
        return pixel_visibility(self.comparison.view, self.comparison.visibilities[index])

    @property
    def exact_values(self) -> Grey:
        """Exact visibility of every pixel, background lit."""
        return pixel_visibility(self.comparison.view, self.comparison.view.exact)

    @property
    def passed(self) -> bool:
        """Whether all equations that were checked hold as the ledger says."""
        return all(result.passed for result in self.equations)


def pixel_visibility(view: View, visibility: Any) -> Grey:
    """Mean visibility of the valid samples of every pixel; 1 where no sample counts."""
    return np.asarray(jnp.where(view.pixel_mask, view.per_pixel(visibility), 1.0))


def collect(
    scene: Scene,
    settings: ReportSettings,
    command: str = "",
    caster: Caster | None = None,
    progress: Callable[[str], None] | None = None,
) -> Findings:
    """Run everything that a report shows.

    Args:
        scene: Mesh, camera and lights; shadows of the first light are compared.
        settings: Sizes and techniques.
        command: How to make this report again, for people.
        caster: Traces all rays; the default caster if None.
        progress: Called with the name of each step as it starts.

    Raises:
        ValueError: If a technique is unknown or nothing in view faces the light.
    """
    caster = default_caster() if caster is None else caster
    announce = progress or (lambda step: None)
    techniques = as_techniques(settings.techniques, settings.resolution, caster)
    announce("exact shadow by a ray for every pixel")
    view = reference_view(scene, settings.width, settings.height, caster, settings.samples)

    def run(resolution: int, names: Iterable[str]) -> tuple[Comparison, list[Choice]]:
        """Some of the techniques at a resolution; objects, which have their own, as much finer or coarser."""
        sized = as_techniques(settings.techniques, resolution, caster)
        factor = resolution / settings.resolution
        made = {
            name: techniques[name].resized(factor) if sized[name] is techniques[name] else sized[name] for name in names
        }
        sizes = [one.map_resolution or resolution for one in made.values()]

        def step(name: str) -> None:
            announce(f"{name} at {resolution}²")

        found = measure(
            scene, made, resolution=resolution, samples_per_axis=settings.samples, caster=caster, progress=step,
            view=view,
        )  # fmt: skip
        return found, [Choice(size, record) for size, record in zip(sizes, found.records, strict=True)]

    comparison, choices = run(settings.resolution, techniques)
    if settings.sweep:
        names = _worth_sweeping(comparison.records)
        for resolution in (max(1, settings.resolution // 2), 2 * settings.resolution) if names else ():
            choices += run(resolution, names)[1]
    announce("pictures")
    exact_picture = _picture(scene, view, view.exact, caster)
    pictures = tuple(_picture(scene, view, visibility, caster) for visibility in comparison.visibilities)
    receivers = int(jnp.sum(view.valid))
    costs = tuple(
        _cost(name, one.map_filter, one.map_resolution or settings.resolution, receivers)
        for name, one in techniques.items()
        if one.map_filter is not None and one.map_filter.compares
    )
    announce("tones predicted along straight edges")
    tone_rows = tuple(
        _tones(name, technique, record)
        for (name, technique), record in zip(techniques.items(), comparison.records, strict=True)
    )
    wanted = [equation for equation in ledger().values() if equation.id.split(".")[0] in settings.equations]

    def checked(result: Result) -> None:
        announce(f"equation {result.id}")

    results = tuple(verify(wanted, checked)) if wanted else ()
    return Findings(
        scene=scene,
        settings=settings,
        comparison=comparison,
        exact_picture=exact_picture,
        pictures=pictures,
        light_map=_light_map(scene, comparison, settings.resolution, caster),
        tones=tone_rows,
        receivers=receivers,
        costs=costs,
        crossovers=_crossovers(costs, settings.resolution, receivers),
        choices=tuple(choices),
        advice=_with_texels(advise(choices), scene, techniques.items()),
        equations=results,
        machine=machine(),
        command=command,
    )


def _with_texels(advice: Advice | None, scene: Scene, techniques: Iterable[tuple[str, Technique]]) -> Advice | None:
    """The advice with a sentence for every technique with slices whose texels are too long for the objects in view."""
    told = []
    for name, technique in techniques:
        if isinstance(technique.map_partition, Cascades | ByLight):
            found = texel_advice(technique, scene.mesh, scene.lights[0], scene.camera)
            told += [] if found is None else [f"{name}: {found}."]
    return None if advice is None else dataclasses.replace(advice, reasons=(*advice.reasons, *told))


def _worth_sweeping(records: Sequence[Record]) -> tuple[str, ...]:
    """The recommended techniques and the best of the lightest: at most three names."""
    mapped = [record for record in records if record.map_bytes > 0]
    advice = advise([Choice(0, record) for record in mapped])
    if advice is None:
        return ()
    lightest = min(mapped, key=lambda record: (record.map_bytes, record.light_rmse))
    chosen = (advice.recommended, advice.smooth or advice.most_accurate)
    return tuple(dict.fromkeys([*(choice.record.technique for choice in chosen), lightest.technique]))


def _picture(scene: Scene, view: View, visibility: Any, caster: Caster) -> Pixels:
    """The shaded picture with one light's shadows as given; further lights cast exact ones."""
    others = tuple(
        visibility_on(view.surface, Exact(caster).build(scene.mesh, light, scene.camera)) for light in scene.lights[1:]
    )
    image = shade(view.surface, scene.lights, (visibility, *others), samples_per_axis=view.samples_per_axis)
    return np.asarray(image, np.float64)


def _light_map(scene: Scene, comparison: Comparison, resolution: int, caster: Caster) -> ShadowMap:
    """The first map that a technique built, or a plain one."""
    for shadows in comparison.shadows:
        if shadows.cast_maps:
            return shadows.cast_maps[0]
    built = ShadowMapping(Hard(), resolution, caster=caster).build(scene.mesh, scene.lights[0], scene.camera)
    return built.maps[0]


def window_filter(filter_: Filter) -> tuple[int, str] | None:
    """Taps and policy of a filter as the analysis of binary windows names them; None if it does not treat it."""
    if isinstance(filter_, Hard):
        return 1, "1-SM"
    if isinstance(filter_, PercentageCloser) and filter_.width_world is None:
        return filter_.kernel_size**2, "1-SM"
    if isinstance(filter_, MultiDepth) and isinstance(filter_.policy, Neighbourhood):
        policy = filter_.policy
        names = {"max": "2-SM max", "min": "2-SM min", "min-max": "3-SM min/max"}
        return (filter_.kernel_size**2, names[policy.keep]) if policy.size == 3 and policy.include_centre else None
    return None


def _tones(name: str, technique: Technique, record: Record) -> ToneRow:
    known = None if technique.map_filter is None else window_filter(technique.map_filter)
    straight = None if known is None else len(tones.straight_edge_tones(*known))
    along_axis = None if known is None else len(tones.axis_step_tones(*known))
    return ToneRow(name, record.tones_bound, straight, along_axis, record.tones)


def _cost(name: str, chosen: Filter, size: int, receivers: int) -> CostRow:
    """Fetches of a technique, the depths that its policy reads counted on a real map."""
    taps = chosen.num_fetches // chosen.num_planes
    per_texel = _counted_reads(chosen.policy) if isinstance(chosen, MultiDepth) and chosen.num_planes > 1 else 0
    build = cost.build_fetches(size, size, per_texel) if per_texel else 0
    return CostRow(name, per_texel, taps, build, int(cost.lookup_fetches(receivers, taps)))


@functools.cache
def _counted_reads(policy: DepthPolicy) -> int:
    """Depths that a policy reads for one texel, found by moving every depth of a small map in turn."""
    side = 2 * math.ceil(policy.radius) + 3
    depth = jax.random.permutation(jax.random.key(0), jnp.arange(side * side, dtype=jnp.int32)).astype(jnp.float32)
    return cost.count_build_fetches(policy.planes, depth.reshape(side, side))


def _crossovers(costs: Sequence[CostRow], resolution: int, receivers: int) -> tuple[Crossover, ...]:
    """Every multi-depth technique against every plain filter with more taps."""
    result = []
    for multi in costs:
        for plain in costs:
            saved = plain.taps - multi.taps
            if multi.build_per_texel > 0 and plain.build_per_texel == 0 and saved > 0:
                fragments = cost.crossover_fragments(resolution, resolution, multi.build_per_texel, saved)
                ratio = cost.size_ratio_threshold(multi.build_per_texel, saved)
                cheaper = multi.technique if receivers > fragments else plain.technique
                result.append(Crossover(multi.technique, plain.technique, float(fragments), float(ratio), cheaper))
    return tuple(result)


def results_json(findings: Findings) -> dict[str, Any]:
    """The findings as plain values: what `results.json` holds."""
    scene, advice = findings.scene, findings.advice
    return {
        "scene": {
            "name": scene.name,
            "description": scene.description,
            "triangles": scene.mesh.num_faces,
            "light": type(scene.lights[0]).__name__,
        },
        "settings": {**vars(findings.settings), "techniques": findings.comparison.names},
        "records": [record.to_json() for record in findings.comparison.records],
        "tones": [dataclasses.asdict(row) for row in findings.tones],
        "cost": {
            "receivers": findings.receivers,
            "fetches": [dataclasses.asdict(row) for row in findings.costs],
            "crossovers": [dataclasses.asdict(row) for row in findings.crossovers],
        },
        "choices": [{"resolution": choice.resolution, **choice.record.to_json()} for choice in findings.choices],
        "recommendation": None
        if advice is None
        else {
            "technique": advice.recommended.record.technique,
            "resolution": advice.recommended.resolution,
            "smooth": None if advice.smooth is None else advice.smooth.name,
            "most_accurate": advice.most_accurate.name,
            "fastest": advice.fastest.name,
            "pareto_front": list(advice.front),
            "reasons": list(advice.reasons),
        },
        "equations": [
            {"id": one.id, "source": one.source, "verdict": one.verdict, "passed": one.passed}
            for one in findings.equations
        ],
        "machine": findings.machine,
        "command": findings.command,
    }
