"""What each command does, once its options are read."""

import math
import os
import shlex
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from shadowjax import io
from shadowjax._checks import require, require_choice
from shadowjax._process import complain
from shadowjax.cli import options
from shadowjax.cli.console import Steps, labelled, say, short, show_table, write_json
from shadowjax.cli.lists import experiments, presets, scenes, techniques
from shadowjax.cli.scene_choice import open_scene


def run(chosen: Any) -> int:
    """Run the command whose options these are; the exit code."""
    # The ledger runs thousands of small programs once each: kept, its second run takes a fraction of the first.
    _keep_compiled(least_seconds=0.0 if isinstance(chosen, options.Verify) else 0.2)
    target = getattr(getattr(chosen, "search", chosen), "json", None)
    if target not in (None, "-"):
        io.check_output(target)  # complain before the work, not after it
    return _RUN[type(chosen)](chosen)


def _keep_compiled(least_seconds: float) -> None:
    """Keep compiled programs in the user's cache, so that the second run starts at once; leave a user's own choice.

    Args:
        least_seconds: Time of compilation from which a program is kept.
    """
    chosen: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if chosen is not None:
        try:
            if "://" not in chosen:
                io.output_folder(chosen)
        except ValueError as error:
            warnings.warn(f"compiled programs are not kept: {error}", stacklevel=2)
            jax.config.update("jax_compilation_cache_dir", None)
        return
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    try:
        folder = io.output_folder(Path(base) / "shadowjax" / "compiled")
    except (ValueError, RuntimeError):
        return  # no home, or a read-only one: compile every time
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", least_seconds)


def _caster(picture: options.PictureOptions) -> Any:
    """The caster asked for."""
    from shadowjax.rays.casters import default_caster, make_caster

    return default_caster() if picture.caster is None else make_caster(picture.caster)


def report(chosen: options.Report) -> int:
    """Make the page; 1 if an equation on it failed."""
    from shadowjax.report import DEFAULT_TECHNIQUES, ReportSettings, check_report, collect, write_report

    check_report(chosen.out)  # complain before the work, not after it
    picture = chosen.picture
    equation = () if chosen.equations == ("none",) else chosen.equations
    settings = ReportSettings(
        labelled(chosen.techniques) or DEFAULT_TECHNIQUES, picture.width, picture.height, picture.resolution,
        picture.samples, equation, chosen.sweep,
    )  # fmt: skip
    caster = _caster(picture)
    scene = open_scene(chosen.scene, chosen.setting, picture)
    with Steps("report") as steps:
        command = shlex.join(["shadowjax", "report", chosen.scene, *_changed(chosen)])
        findings = collect(scene, settings, command, caster, steps)
        steps("writing the page")
        path = write_report(findings, chosen.out)
    say(f"{path}")
    return 0 if findings.passed else 1


def _changed(chosen: options.Report) -> list[str]:
    """The flags of a report that differ from their defaults: what makes it again."""
    words: list[str] = []
    usual_report = options.Report()
    groups = [(chosen, usual_report), (chosen.picture, usual_report.picture), (chosen.setting, usual_report.setting)]
    for group, usual in groups:
        for name, value in vars(group).items():
            if name in ("scene", "picture", "setting", "config") or value == getattr(usual, name):
                continue
            flag = "--" + name.replace("_", "-")
            if isinstance(value, bool):
                words.append(flag if value else flag.replace("--", "--no-", 1))
            else:
                words += [flag, *map(str, value if isinstance(value, tuple) else (value,))]
    return words


def render(chosen: options.Render) -> int:
    """Write one picture."""
    from shadowjax.evaluate.picture import render as draw
    from shadowjax.presets.names import make_technique

    require(bool(chosen.output), "say where to write the picture: -o image.png")
    require(
        chosen.output.lower().endswith(".png"), f"pictures are written as PNG: -o must end in .png, not {chosen.output}"
    )
    io.check_output(chosen.output)
    picture, caster = chosen.picture, _caster(chosen.picture)
    make_technique(chosen.technique, picture.resolution, caster)  # complain before the scene is made
    scene = open_scene(chosen.scene, chosen.setting, picture)
    with Steps("render") as steps:
        image = draw(
            scene, chosen.technique, picture.width, picture.height, picture.resolution, picture.samples, caster,
            progress=steps,
        )  # fmt: skip
        path = io.write_png(chosen.output, np.asarray(image))
    say(f"{path}: {picture.width} × {picture.height}, {scene.name}, {chosen.technique}")
    return 0


def compare(chosen: options.Compare) -> int:
    """Measure techniques and show or write their records."""
    from shadowjax.evaluate.compare import compare as run_compare
    from shadowjax.report.advisor import bytes_text
    from shadowjax.techniques.registry import TECHNIQUES

    asked = labelled(chosen.techniques) or {name: name for name in TECHNIQUES}
    if chosen.presets:
        from shadowjax.presets.names import PREFIX
        from shadowjax.presets.registry import PRESETS

        asked |= {PREFIX + name: PREFIX + name for name in PRESETS}
    if chosen.pareto is not None:
        require(chosen.pareto.lower().endswith(".png"), f"--pareto writes a PNG: {chosen.pareto} must end in .png")
        io.check_output(chosen.pareto)
    picture, caster = chosen.picture, _caster(chosen.picture)
    scene = open_scene(chosen.scene, chosen.setting, picture)
    with Steps("compare") as steps:
        records = run_compare(
            scene, asked, width=picture.width, height=picture.height,
            resolution=picture.resolution, samples_per_axis=picture.samples, caster=caster, progress=steps,
        )  # fmt: skip
    if chosen.pareto is not None:
        from shadowjax.plotting import figure_png, pareto

        io.write_bytes(chosen.pareto, figure_png(pareto(records, f"{scene.name}, maps of {picture.resolution}²")))
    if write_json(chosen.json, [record.to_json() for record in records]):
        return 0
    columns = (
        "technique", "light error", "RMS error", "false light", "false shadow", "bleed", "edges off", "tones", "of",
        "memory", "build ms", "lookup ms",
    )  # fmt: skip
    rows = [
        (r.technique, f"{100 * r.light_rmse:.2f} %", f"{r.rmse:.4f}", f"{100 * r.false_lit:.2f} %",
         f"{100 * r.false_shadow:.2f} %", f"{100 * r.bleed:.2f} %", f"{r.edge_distance:.2f} px",
         r.tones, "∞" if r.tones_bound is None else r.tones_bound,
         bytes_text(r.stored_bytes), f"{r.build_ms:.1f}", f"{r.visibility_ms:.1f}")
        for r in sorted(records, key=lambda record: record.light_rmse)
    ]  # fmt: skip
    title = (
        f"{scene.name}: {picture.width} × {picture.height} pixels, maps of {picture.resolution}², against shadow rays"
    )
    show_table(title, columns, rows, numeric=range(1, len(columns)))
    return 0


def verify(chosen: options.Verify) -> int:
    """Check equations; 1 if one fails."""
    from shadowjax.ledger import equation

    known = equation.ledger()
    wanted = list(known.values())
    for prefix in chosen.only:
        require(
            any(one.id.startswith(prefix) for one in known.values()),
            f"no equation is called {prefix!r}; names begin with one of {', '.join(equation.SOURCES)}",
        )
    if chosen.only:
        wanted = [one for one in wanted if one.id.startswith(chosen.only)]
    with Steps(f"verify {len(wanted)} equations") as steps:
        results = equation.verify(wanted, lambda result: steps(f"{result.id} {'' if result.passed else 'FAILED'}"))
    failed = [result for result in results if not result.passed]
    if not write_json(chosen.json, equation.to_json(results)):
        rows = [
            (r.id, r.source, r.verdict, r.kind, len(r.checks), "passed" if r.passed else "FAILED") for r in results
        ]  # fmt: skip
        show_table("equations", ("id", "source", "verdict", "kind", "checks", "result"), rows, numeric=(4,))
        say(f"{len(results) - len(failed)} of {len(results)} passed")
    for result in failed:
        complain("shadowjax", f"{result.id} ({result.source}) failed")
    return 1 if failed else 0


def _optimized(path: str | None, content: dict[str, Any]) -> int:
    """Write an optimiser's answer, or show its numbers."""
    if not write_json(path, content):
        rows = [(name, short(value)) for name, value in content.items() if not isinstance(value, dict)]
        for name in ("baselines", "test_baselines"):
            rows += [
                (f"{name.replace('_', ' ')[:-1]} {key}", short(value)) for key, value in content.get(name, {}).items()
            ]
        show_table("", ("quantity", "value"), rows)
    return 0


def near_distance(chosen: options.NearDistance) -> int:
    """Find n'; in float64, as the optimum is flat."""
    from shadowjax.optimize.analytic.near_distance import WARP_OBJECTIVES
    from shadowjax.optimize.analytic.near_distance import near_distance as find

    phi, gamma = _angles(chosen)
    require_choice(chosen.objective, "--objective", WARP_OBJECTIVES)
    with jax.enable_x64(True):
        content = find(chosen.near, chosen.far, phi, gamma, chosen.section, chosen.objective).to_dict()
    return _optimized(chosen.json, content)


def splits(chosen: options.Splits) -> int:
    """Find splits, in float64; together with every n', or under a limit on seams, where that is asked for."""
    from shadowjax.optimize.analytic.splits import splits as find

    phi, gamma = _angles(chosen)
    view = (chosen.near, chosen.far, phi, gamma, chosen.num_partitions, chosen.objective, chosen.warp)
    with jax.enable_x64(True):
        content = find(*view, chosen.section, chosen.seam_limit).to_dict()
    return _optimized(chosen.json, content)


def bias_search(chosen: options.BiasSearch) -> int:
    """Search the bias of a technique's filter."""
    from shadowjax.optimize.viewed.bias import bias
    from shadowjax.presets.names import make_technique

    technique = make_technique(chosen.technique, chosen.search.resolution)
    technique.as_shadow_mapping("a search of the bias needs")  # complain before the work, not after it
    with Steps("optimize bias") as steps:
        views = _views(chosen.search, chosen.search.scenes, steps)
        steps(f"biases of {chosen.technique} in {chosen.unit} units")
        content = bias(views, technique, chosen.unit).to_dict()
    return _optimized(chosen.search.json, content)


def exponent_search(chosen: options.ExponentSearch) -> int:
    """Search the numbers of an averaging filter."""
    from shadowjax.optimize.viewed.filter_numbers import exponent
    from shadowjax.presets.names import make_technique

    technique = make_technique(chosen.technique, chosen.search.resolution)
    technique.as_shadow_mapping("a search of numbers needs")  # complain before the work, not after it
    with Steps("optimize exponent") as steps:
        views = _views(chosen.search, chosen.search.scenes, steps)
        test_views = _views(chosen.search, chosen.test_scenes, steps)
        steps(f"numbers of {chosen.technique}")
        found = exponent(views, technique, chosen.blur, chosen.evaluations, test_views)
    content = found.to_dict()
    if chosen.search.json is None:  # a table has no room for all that was tried
        content = {**content, **content["numbers"]}
        del content["tried"]
    return _optimized(chosen.search.json, content)


def taps_search(chosen: options.TapsSearch) -> int:
    """Search extra depths, or learn offsets of taps."""
    from shadowjax.optimize.viewed.taps import depths, taps
    from shadowjax.presets.names import make_technique

    technique = make_technique(chosen.technique, chosen.search.resolution)
    technique.as_shadow_mapping("a search of taps needs")  # complain before the work, not after it
    shared = sorted(set(chosen.search.scenes) & set(chosen.test_scenes))
    require(not shared, f"--test-scenes must differ from --scenes; both have {', '.join(shared)}")
    with Steps("optimize taps") as steps:
        views = _views(chosen.search, chosen.search.scenes, steps)
        test_views = _views(chosen.search, chosen.test_scenes, steps)
        steps(f"search of {chosen.what}")
        if chosen.what == "offsets":
            found = taps(views, test_views, technique, chosen.steps)
        else:
            found = depths(views, test_views, chosen.num_depths, technique, chosen.what)
    return _optimized(chosen.search.json, found.to_dict())


def _views(search: options.SearchOptions, names: Sequence[str], steps: Steps) -> tuple[Any, ...]:
    """Scenes looked at, each with its map."""
    from shadowjax.optimize.viewed.views import PICTURE_OBJECTIVES, view_scene

    require_choice(search.objective, "--objective", PICTURE_OBJECTIVES)
    picture = options.PictureOptions(search.width, search.height, 1, search.resolution)
    scenes = [open_scene(name, options.SceneOptions(), picture) for name in names]
    made = []
    for scene in scenes:
        steps(f"view of {scene.name}")
        made.append(view_scene(scene, search.width, search.height, search.resolution, search.objective))
    return tuple(made)


def _angles(chosen: Any) -> tuple[float, float]:
    """φ and γ in radians, once near and far are in order."""
    require(0 < chosen.near < chosen.far, f"--near and --far need near < far; got {chosen.near} and {chosen.far}")
    return math.radians(chosen.phi_deg), math.radians(chosen.gamma_deg)


_RUN = {
    options.Report: report,
    options.Render: render,
    options.Compare: compare,
    options.Verify: verify,
    options.Scenes: scenes,
    options.Presets: presets,
    options.Techniques: techniques,
    options.Experiments: experiments,
    options.NearDistance: near_distance,
    options.Splits: splits,
    options.BiasSearch: bias_search,
    options.ExponentSearch: exponent_search,
    options.TapsSearch: taps_search,
}
