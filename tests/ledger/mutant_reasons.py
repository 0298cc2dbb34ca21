"""Why mutants survive that no row of the ledger notices: what they change cannot be seen, or a gap."""

import re

# Beginning of a pattern of names → why no row can notice.
REASONS: tuple[tuple[str, str], ...] = (
    (
        r"overhead\.(literal_error_z|least_error_depth).*tiny",
        "a guard of γ = 0: the value there is only kept finite, and no larger γ comes near it",
    ),
    (
        r"limits\.gibbs_peak: .*(constant: 0 → 0\.01$|t = np\.linspace)",
        "the grid of a search: any that brackets the highest maximum finds it, and without damping it lies at 1/(2M)",
    ),
    (r"limits\._step64: sign: -1 → 1", "an axis: the array has two, so that 1 and −1 are one"),
    (
        r"exponential_variance_bleed: constant: (1e-06|1\.0) →",
        "where the limit c → 0 is taken, and what stands in for c there, unused",
    ),
    (r"memory\.wrong_cells: constant: 0\.0005", "half a unit of the printed digit; no cell lies within 1 % of it"),
    (r"storage\.partitions_needed: constant: 65 →", "an end of whole numbers, which lies between the same two of them"),
    (
        r"tones\.count_sums: (constant: 1 → 2  in  factors|constant: 0 → 1  in  sums|sign: total)",
        "one scale, offset or sign for all sums leaves their number as it is",
    ),
    (
        r"tones\.edge_shift: constant: (4 → 5|2 → 3)",
        "length of the step's row and place of its edge: any that holds it",
    ),
    (
        r"windows\.lit_numerators: term: windows\.shape",
        "a slice that ends 2·margin from its start's far side is the same",
    ),
    (r"windows\.lit_numerators: constant: 1 → 2  in  keep", "neighbourhoods of one or two texels, which no policy has"),
    (r"near_distances\.(psm|wimmer): .*jnp\.zeros_like", "a zero that only gives the answer the shape of γ"),
    (r"near_distance_from_eta: constant: 0 → 0\.01  in  negative", "a branch that is not taken for η > 0"),
    (
        r"LightFrustum\.(uniform_near_distance|ratio|bounded): .*(eps|uniform_near_distance|tiny)",
        "the finite number that stands for n' = ∞: any so large gives the uniform map to rounding",
    ),
    (
        r"LogarithmicWarp\.forward: .*CLOSEST - 1",
        "places behind the centre of projection, where there is no map and numbers are only kept finite",
    ),
    (
        r"logarithmic\.(_log_ratio: constant: 5 →|_exp_ratio: (constant: 120 →|(sign|term): 1 / 24))",
        "the last term of a series, no larger than what a row allows",
    ),
    (
        r"logarithmic\.log_distance: constant: (0\.01 → 0\.0101|30 → )",
        "where a series takes over, which is right on both sides, and its last term, below what a row allows",
    ),
    (
        r"surface_slopes: (constant: 0 → 0\.01$|term: step\.shape|constant: 1 → 1\.01  in  return)",
        "an index that becomes a whole number, the last one counted from the end, and sizes, which are whole",
    ),
    (r"variance\.depth_moments: constant: 0 →", "whether to leave out slopes that count nothing"),
    (
        r"Exponential\.visibility: constant: 0\.0 →",
        "receivers no farther than the nearest depth of the map, which are lit either way",
    ),
    (
        r"Exponential\.visibility: .*fails = mean > 1",
        "gap: a mean between 1 and 1.02 over a texel that is in shadow itself",
    ),
    (
        r"multi_depth\._ring_cells",
        "cells beyond the ring are left out, and any turn beyond 2π keeps the order of angles",
    ),
    (r"multi_depth\._beside: ", "rings of more than one sample lie evenly across columns: their middle column is 0"),
    (r"Ring\.__check_init__", "a check of an argument"),
    (r"LightFrustum\.slack: constant: 0", "gap: views whose lower edge rises by less than 1 % of depth"),
    (r"optimal\.balanced: constant: 0 → .*safe_sqrt", "a guard of a number that is not negative there"),
    (r"optimal\.balanced: constant: (0|4) →", "gap: views at which the quadratic's last term or first is near 0"),
    (r"optimal\.balanced: .*lowest = larger", "the lower end of a search, below the root that it brackets"),
    (
        r"half_width: .*low_near",
        "low_near is not 0 for γ < φ alone, where the far corners are the wider whatever the near ones are",
    ),
    (r"variance\._chebyshev: constant: 0 → 0\.01  in  lost", "a guard of 0/0, taken where both are 0"),
    (r"AdjacentEdges\.lists: constant: 0 → 1", "the polygon that hides an entry comes later, so it is never the first"),
    (
        r"find_adjacent_edges: constant: 1 → 2",
        "any negative number marks an entry as visible, and leaves the length of an array to NumPy",
    ),
    (r"split_rules\.iterate_adaptive: constant: 0 → 0\.01", "whether to clamp at all, for shares from 0 to 1 %"),
    (
        r"optimal\.storage_(minimum|strength): constant: 0 → 0\.01  in  (away|return)",
        "a guard of a number that is not negative, and where two forms of one root change over",
    ),
    (r"split_rules\.adaptive_splits: ends: near → far  in  right_angle", "two numbers of one dtype"),
    (
        r"half_plane_windows: (constant: 2 → 3  in  reach|sign: -turned)",
        "directions more, or another last one: the row still counts every window, since complements hold them twice",
    ),
    (r"half_plane_windows: sign: \(ax \+ bx\) \* x \+", "windows mirrored at an axis, which are the same windows"),
    (r"windows\.diagonal_step_windows: constant: 2 → 3", "more windows that are dark all over"),
    (r"windows\.window_histogram: constant: 1 → 2$", "a turn of the loop for a number of lit tests that never comes"),
)


def reason_of(name: str) -> str:
    """Why a mutant changes nothing, or nothing that a row could see."""
    return next((reason for pattern, reason in REASONS if re.search(pattern, name)), "")
