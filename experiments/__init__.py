"""Figures and tables of the sources as programs: each runs, states claims about its result, and draws it."""

# Light imports only: the command line answers bad input and signals before an experiment is loaded.

import ast
import difflib
import importlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.base import Claim, Experiment, Outcome, Unsuitable, perform
    from experiments.settings import default_path, read_config

_NAMES = (
    "mdsm_fig_4_1",
    "mdsm_figs_4_7_to_4_11",
    "mdsm_fig_5_2",
    "mdsm_fig_5_3",
    "mdsm_fig_5_4",
    "mdsm_cost_5_6_to_5_8",
    "warping_fig_18",
    "warping_fig_19",
    "warping_fig_20",
    "warping_fig_22",
    "warping_fig_23",
    "warping_fig_26",
    "warping_fig_27",
    "warping_partitions_needed",
    "warping_published_and_optimal",
    "warping_when_a_warp_hurts",
    "warping_errata",
    "warping_aliasing_maps",
    "filtering_figs_2_5_and_2_6",
    "filtering_fig_2_7",
    "filtering_figs_2_8_and_2_9",
    "filtering_xcsm_is_not_csm",
    "filtering_table_4_2",
    "bias_acne_and_gap",
    "filtering_tables_4_1_and_4_3",
    "filtering_fig_4_3",
    "stencil_figs_5_to_8",
    "stencil_tables",
    "stencil_bsp_balance",
    "gradients_shadow_edges",
    "inverse_light_and_pose",
    "inverse_shadow_art",
    "inverse_vertices",
    "inverse_map_settings",
    "inverse_light_placement",
    "asm_error_against_memory",
    "asm_tests",
    "asm_walkthrough",
)


class _Registry(Mapping[str, "Experiment"]):
    """Experiments by name, each loaded when it is asked for."""

    def __getitem__(self, name: str) -> "Experiment":
        if name not in _NAMES:
            raise KeyError(name)
        module: Any = importlib.import_module(f"experiments.{name}")
        return module

    def __contains__(self, name: object) -> bool:
        return name in _NAMES

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)


EXPERIMENTS: Mapping[str, "Experiment"] = _Registry()


def find(name: str) -> "Experiment":
    """The experiment of that name.

    Raises:
        ValueError: If there is none; the message names the nearest ones.
    """
    if name not in EXPERIMENTS:
        near = difflib.get_close_matches(name, EXPERIMENTS, n=3, cutoff=0.4) or list(EXPERIMENTS)
        raise ValueError(f"no experiment is called {name!r}; did you mean {', '.join(near)}? `all` runs every one")
    return EXPERIMENTS[name]


def summaries() -> dict[str, str]:
    """What each experiment shows: the first sentence of its file, which is read but not run."""
    folder = Path(__file__).parent
    said = {}
    for name in _NAMES:
        text = ast.get_docstring(ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))) or ""
        said[name] = " ".join(text.split("\n\n")[0].split()).removesuffix(".")
    return said


def __getattr__(name: str) -> Any:
    """What an experiment is made of, loaded when it is asked for."""
    for home in ("base", "settings"):
        if name in __all__:
            module = importlib.import_module(f"experiments.{home}")
            if hasattr(module, name):
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "EXPERIMENTS",
    "Claim",
    "Experiment",
    "Outcome",
    "Unsuitable",
    "default_path",
    "find",
    "perform",
    "read_config",
    "summaries",
]
