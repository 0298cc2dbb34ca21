"""Figures and tables of the sources as programs: each runs, states claims about its result, and draws it."""

import difflib

from experiments import (
    asm_error_against_memory,
    asm_tests,
    asm_walkthrough,
    bias_acne_and_gap,
    filtering_fig_2_7,
    filtering_fig_4_3,
    filtering_figs_2_5_and_2_6,
    filtering_figs_2_8_and_2_9,
    filtering_table_4_2,
    filtering_tables_4_1_and_4_3,
    filtering_xcsm_is_not_csm,
    gradients_shadow_edges,
    inverse_light_and_pose,
    inverse_light_placement,
    inverse_map_settings,
    inverse_shadow_art,
    inverse_vertices,
    mdsm_cost_5_6_to_5_8,
    mdsm_fig_4_1,
    mdsm_fig_5_2,
    mdsm_fig_5_3,
    mdsm_fig_5_4,
    mdsm_figs_4_7_to_4_11,
    stencil_bsp_balance,
    stencil_figs_5_to_8,
    stencil_tables,
    warping_aliasing_maps,
    warping_errata,
    warping_fig_18,
    warping_fig_19,
    warping_fig_20,
    warping_fig_22,
    warping_fig_23,
    warping_fig_26,
    warping_fig_27,
    warping_partitions_needed,
    warping_published_and_optimal,
    warping_when_a_warp_hurts,
)
from experiments.base import Claim, Experiment, Outcome, Unsuitable, perform
from experiments.settings import default_path, read_config

EXPERIMENTS: dict[str, Experiment] = {
    "mdsm_fig_4_1": mdsm_fig_4_1,
    "mdsm_figs_4_7_to_4_11": mdsm_figs_4_7_to_4_11,
    "mdsm_fig_5_2": mdsm_fig_5_2,
    "mdsm_fig_5_3": mdsm_fig_5_3,
    "mdsm_fig_5_4": mdsm_fig_5_4,
    "mdsm_cost_5_6_to_5_8": mdsm_cost_5_6_to_5_8,
    "warping_fig_18": warping_fig_18,
    "warping_fig_19": warping_fig_19,
    "warping_fig_20": warping_fig_20,
    "warping_fig_22": warping_fig_22,
    "warping_fig_23": warping_fig_23,
    "warping_fig_26": warping_fig_26,
    "warping_fig_27": warping_fig_27,
    "warping_partitions_needed": warping_partitions_needed,
    "warping_published_and_optimal": warping_published_and_optimal,
    "warping_when_a_warp_hurts": warping_when_a_warp_hurts,
    "warping_errata": warping_errata,
    "warping_aliasing_maps": warping_aliasing_maps,
    "filtering_figs_2_5_and_2_6": filtering_figs_2_5_and_2_6,
    "filtering_fig_2_7": filtering_fig_2_7,
    "filtering_figs_2_8_and_2_9": filtering_figs_2_8_and_2_9,
    "filtering_xcsm_is_not_csm": filtering_xcsm_is_not_csm,
    "filtering_table_4_2": filtering_table_4_2,
    "bias_acne_and_gap": bias_acne_and_gap,
    "filtering_tables_4_1_and_4_3": filtering_tables_4_1_and_4_3,
    "filtering_fig_4_3": filtering_fig_4_3,
    "stencil_figs_5_to_8": stencil_figs_5_to_8,
    "stencil_tables": stencil_tables,
    "stencil_bsp_balance": stencil_bsp_balance,
    "gradients_shadow_edges": gradients_shadow_edges,
    "inverse_light_and_pose": inverse_light_and_pose,
    "inverse_shadow_art": inverse_shadow_art,
    "inverse_vertices": inverse_vertices,
    "inverse_map_settings": inverse_map_settings,
    "inverse_light_placement": inverse_light_placement,
    "asm_error_against_memory": asm_error_against_memory,
    "asm_tests": asm_tests,
    "asm_walkthrough": asm_walkthrough,
}


def find(name: str) -> Experiment:
    """The experiment of that name.

    Raises:
        ValueError: If there is none; the message names the nearest ones.
    """
    if name not in EXPERIMENTS:
        near = difflib.get_close_matches(name, EXPERIMENTS, n=3, cutoff=0.4) or list(EXPERIMENTS)
        raise ValueError(f"no experiment is called {name!r}; did you mean {', '.join(near)}? `all` runs every one")
    return EXPERIMENTS[name]


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
]
