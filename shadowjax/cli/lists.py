"""Commands that list what there is by name: tokens of techniques, presets, scenes; and that start experiments."""

import importlib
import sys
import textwrap
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from shadowjax._checks import require
from shadowjax.cli import options
from shadowjax.cli.console import labelled, say, short, show_table, write_json


def techniques(chosen: options.Techniques) -> int:
    """List the tokens of names, or what names mean and cost."""
    from shadowjax.techniques.names import families, token_table

    if chosen.names:
        return _costs_of(chosen)
    rows = token_table()
    if write_json(chosen.json, [row._asdict() for row in rows]):
        return 0
    titles = {
        "technique": "whole techniques", "partition": "partitions", "warp": "warps", "depths": "depths of a texel",
        "filter": "filters", "option": "options",
    }  # fmt: skip
    for kind, title in titles.items():
        mine = [row for row in rows if row.kind == kind]
        counts = [name for name in ("planes", "fetches", "maps") if any(getattr(row, name) for row in mine)]
        cells = [(row.token, *(getattr(row, name) or "" for name in counts), row.summary) for row in mine]
        show_table(title, ("token", *counts, "what it is"), cells, numeric=range(1, 1 + len(counts)))
        say("")
    say("A name joins tokens by +, at most one of each kind, in any order, such as")
    say("z4+minimax+evsm4. What is left out is single, uniform and hard. Whole")
    say("techniques, and presets as preset:NAME, stand alone. Numbers of names:")
    numbers = "; ".join(f"{key} {low} to {high}" for key, (low, high) in families().items())
    for line in textwrap.wrap(numbers, 76, break_on_hyphens=False):
        say(line)
    return 0


def _costs_of(chosen: options.Techniques) -> int:
    """What names mean and cost."""
    from shadowjax.presets.names import costs

    found = {label: costs(name) for label, name in labelled(chosen.names).items()}
    if write_json(chosen.json, [{"technique": label, **cost._asdict()} for label, cost in found.items()]):
        return 0
    rows = [
        (label, c.planes, c.fetches, "by view" if c.maps is None else c.maps, "∞" if c.tones is None else c.tones,
         c.parts.replace("+", " + "))
        for label, c in found.items()
    ]  # fmt: skip
    columns = ("technique", "planes", "fetches", "maps", "tones", "made of")
    show_table("what names mean and cost", columns, rows, numeric=(1, 2, 3, 4))
    return 0


def experiments(chosen: options.Experiments) -> int:
    """Hand over to the experiments, which stand on top of the library and come with its source."""
    source = Path(__file__).resolve().parents[2]
    if find_spec("experiments") is None and (source / "experiments" / "__main__.py").is_file():
        sys.path.insert(0, str(source))
    try:
        run_experiments: Any = importlib.import_module("experiments.__main__")
    except ImportError:
        raise ValueError(
            "experiments come with the source of this package, not with what is installed from it: run "
            "`shadowjax experiments` in a copy of the source"
        ) from None
    if not chosen.name:
        told = importlib.import_module("experiments").summaries()
        if not write_json(chosen.json, [{"name": name, "shows": text} for name, text in told.items()]):
            show_table("experiments", ("name", "what it shows"), told.items())
            say("`shadowjax experiments NAME` runs one, `all` every one; --quick in seconds each.")
        return 0
    require(chosen.json is None, "--json is for the list; an experiment writes NAME.json into --out")
    words = [chosen.name, "--out", chosen.out, *(["--quick"] if chosen.quick else [])]
    return run_experiments.run([*words, *(["--config", chosen.config] if chosen.config is not None else [])])


def presets(chosen: options.Presets) -> int:
    """List the presets, or show one."""
    from shadowjax.presets.registry import PRESETS, preset

    if chosen.name is not None:
        one = preset(chosen.name)
        if write_json(chosen.json, one.to_json()):
            return 0
        rows = [
            (p.name, short(list(p.value) if isinstance(p.value, tuple) else p.value), p.unit,
             "" if p.verified else "unverified", p.here)
            for p in one.parameters
        ]  # fmt: skip
        show_table(f"{one.engine}: {one.description}", ("parameter", "value", "unit", "", "here"), rows)
        for missing in one.missing:
            say(f"no counterpart: {missing}")
        return 0
    if write_json(chosen.json, [one.to_json() for one in PRESETS.values()]):
        return 0
    rows = [(one.name, one.engine, f"{one.resolution}²", one.description) for one in PRESETS.values()]
    show_table("presets", ("name", "engine", "maps", "what it is"), rows, numeric=(2,))
    return 0


def scenes(chosen: options.Scenes) -> int:
    """List the scenes."""
    from shadowjax.scenes.registry import SCENES

    names = ("name", "description", "source", "default_triangles", "min_triangles", "max_triangles")
    if write_json(chosen.json, [{name: getattr(family, name) for name in names} for family in SCENES.values()]):
        return 0
    rows = [
        (
            family.name,
            f"{family.default_triangles:,}",
            f"{family.min_triangles:,} … {family.max_triangles:,}" if family.scales else "one size",
            family.description,
        )
        for family in SCENES.values()
    ]
    show_table("built-in scenes", ("name", "triangles", "adjustable", "what it is"), rows, numeric=(1, 2))
    return 0
