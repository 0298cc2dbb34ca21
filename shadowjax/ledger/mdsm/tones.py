"""Multi-depth source, chapter 4: how many tones a filter can give, and where a policy moves an edge."""

import itertools
import math
from collections.abc import Callable
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shadowjax._types import default_dtype
from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.mdsm import measured as real
from shadowjax.theory import cost, tones, windows
from shadowjax.theory.windows import POLICIES, kernel_width

NAMED_FILTERS = ((1, 1), (4, 1), (9, 1), (16, 1), (1, 2), (4, 2), (9, 2), (1, 3), (4, 3), (9, 3))
DISK_CENTRE = 0.2  # texels off the middle of the map, along both axes


def _policy(inputs: Inputs) -> str:
    name = inputs.text("policy")
    if name not in POLICIES:
        raise Unavailable(f"unknown policy {name!r}; known: {', '.join(POLICIES)}")
    if not inputs.text("neigh", inputs.text("neighbourhood", "3x3")).startswith("3x3"):
        raise Unavailable("only 3 × 3 neighbourhoods are enumerated")
    return name


def _centre(inputs: Inputs) -> bool:
    return bool(inputs.get("centre_included", True))


def _combinations_tones(inputs: Inputs) -> int | None:
    """Tones of n samples through the package's composite test of w − 1 depths, over all combinations."""
    n, w = inputs.integer("n"), inputs.integer("w", default=2)
    if w**n > 4096 or w < 2:
        return None
    passed = np.array(list(itertools.product(range(w), repeat=n)))  # depths behind the receiver, per sample
    behind = np.arange(w - 1)[:, None, None] < passed
    return tones.count_tones(np.asarray(real.attenuation(real.depths(behind))).mean(axis=-1))


def _multisets(inputs: Inputs) -> int:
    levels = [Fraction(str(level)) for level in inputs["levels"]]
    return len({sum(choice) for choice in itertools.combinations_with_replacement(levels, inputs.integer("n"))})


def _fractions(inputs: Inputs, name: str) -> list[Fraction]:
    return [Fraction(str(value)) for value in inputs[name]]


def _weighted_sums(inputs: Inputs) -> int:
    """Different sums of all choices, each made on its own, in thousandths."""
    levels, weights = inputs.numbers("levels"), inputs.numbers("weights")
    choices = itertools.product(levels, repeat=len(weights))
    return len({round(1000 * sum(w * level for w, level in zip(weights, one, strict=True))) for one in choices})


def _most_sums(inputs: Inputs) -> int:
    """Different sums of levels that no other sum can make: powers of a large number, weighted by larger ones."""
    n, w = inputs.integer("n"), inputs.integer("w")
    levels = [0, *(100**power for power in range(w - 1))]
    weights = [1 if inputs["equal"] else 100 ** (w * place) for place in range(n)]
    choices = itertools.product(levels, repeat=n)
    return len({sum(a * b for a, b in zip(weights, one, strict=True)) for one in choices})


def _histogram_measured(inputs: Inputs) -> list[int] | None:
    """How often the package's filter gives each tone over all windows, for a plain and a multi-depth map."""
    k, policy = inputs.integer("k"), _policy(inputs)
    if k != 4 or not _centre(inputs) or policy not in ("1-SM", "2-SM max"):
        return None
    seen = np.asarray(real.window_visibility(real.depths(real.all_windows(4)), policy, 2, True))
    scale = k * windows.num_depths(policy)
    return np.bincount(np.round(seen * scale).astype(int), minlength=scale + 1).tolist()


def _exhaustive_measured(inputs: Inputs) -> int | None:
    """Tones of the package's filter over all windows of four taps; without the centre for one policy."""
    k, policy, centre = inputs.integer("k"), _policy(inputs), _centre(inputs)
    if k != 4 or (k, policy) not in _MEASURED or not (centre or policy == "2-SM max"):
        return None
    return real.count_window_tones(real.all_windows(4), k, policy, centre)


def _pcf_windows(inputs: Inputs) -> int:
    """Tones over all binary windows where a policy of n depths is enumerated, else over all sums of levels."""
    k, n = inputs.integer("k"), inputs.integer("n")
    policy = {1: "1-SM", 2: "2-SM max", 3: "3-SM min/max"}.get(n)
    if policy is not None and k in (1, 4, 9):
        return len(tones.exhaustive_tones(k, policy))
    return tones.count_sums([Fraction(level, n) for level in range(n + 1)], k)


def _pcf_measured(inputs: Inputs) -> int | None:
    k, n = inputs.integer("k"), inputs.integer("n")
    policy = {1: "1-SM", 2: "2-SM max", 3: "3-SM min/max"}.get(n)
    return (
        None
        if policy is None or k not in (1, 4)
        else real.count_window_tones(real.all_windows(kernel_width(k) + 2), k, policy)
    )


def _axis_step(inputs: Inputs) -> int:
    """K + n: each of the n tests flips once, all K rows together, and their flips fall on K + n − 1 columns."""
    return kernel_width(inputs.integer("k")) + windows.num_depths(_policy(inputs))


def _diagonal_step(inputs: Inputs) -> int:
    """2(K + n − 1), as the neighbourhood's extremes reach two diagonals further each; n + 1 for one tap."""
    width, n = kernel_width(inputs.integer("k")), windows.num_depths(_policy(inputs))
    return n + 1 if width == 1 else 2 * (width + n - 1)


def _random_lines(inputs: Inputs) -> int:
    """Tones over windows cut by random straight lines, independent of the enumeration of directions."""
    side = kernel_width(inputs.integer("k")) + 2
    generator = np.random.default_rng(7)
    angle = generator.uniform(0, 2 * np.pi, 15_000)
    offset = generator.uniform(-0.75 * side, 0.75 * side, angle.size)
    across = np.arange(side) - (side - 1) / 2
    lit = np.cos(angle)[:, None, None] * across + np.sin(angle)[:, None, None] * across[:, None] > offset[:, None, None]
    return np.unique(windows.lit_numerators(lit, _policy(inputs))).size


def _separable(inputs: Inputs) -> int:
    """Two for all and none, and one for each pair of neighbours on a line, in either order: what the edge divides."""
    side = inputs.integer("side")
    steps = itertools.product(range(1 - side, side), repeat=2)
    return 2 + sum((side - abs(i)) * (side - abs(j)) for i, j in steps if math.gcd(i, j) == 1)


def _some_depths() -> Float[np.ndarray, "rows cols"]:
    return np.random.default_rng(8).permutation(49).reshape(7, 7).astype(float)


def _extremes(inputs: Inputs) -> list[float]:
    """Of the middle texel of a map of whole numbers, by looking at them one by one."""
    size, depth = inputs.integer("size"), _some_depths()
    reach = range(-((size - 1) // 2), size // 2 + 1)
    cells = [(i, j) for i in reach for j in reach if _centre(inputs) or (i, j) != (0, 0)]
    seen = [float(depth[3 + i, 3 + j]) for i, j in cells]
    return [float(depth[3, 3]), max(seen), min(seen)]


def _extremes_measured(inputs: Inputs) -> list[float]:
    depth = jnp.asarray(_some_depths(), default_dtype())
    return np.asarray(
        real.multi_depth.min_max_neighbours(depth, inputs.integer("size"), _centre(inputs))[:, 3, 3]
    ).tolist()


def _size(inputs: Inputs) -> int:
    return inputs.integer("size", default=3)


def _shift_measured(inputs: Inputs) -> float | None:
    """Sum of visibility along a row across a step, less that of the plain map, in texels; the package's own policy."""
    if _size(inputs) != 3:
        return None
    lit = np.broadcast_to(np.arange(16) >= 8, (5, 16))

    def total(policy: str) -> float:
        attenuation = real.attenuation(real.policy_planes(real.depths(lit), policy))
        return float(np.sum(1 - np.asarray(attenuation)[2]))

    return total(_policy(inputs)) - total("1-SM")


def _image(inputs: Inputs, measured: bool = False) -> int:
    """Tones over a binary map: a disk whose radius the label gives, or a random map where the count is certain."""
    size, k, policy = inputs.integer("N"), inputs.integer("k"), _policy(inputs)
    case = inputs.label.rsplit(",", 1)[-1].strip()
    if case == "random":
        if policy != "1-SM" or k > 9:
            raise Unavailable("the tones of a random map depend on its seed, which the inputs do not give")
        return tones.predicted_tones(k)  # each tap pattern has chance 2^−k, so thousands of windows show every tone
    if not case.startswith("disk r="):
        raise Unavailable(f"no such map: {case!r}")
    middle = size / 2 + DISK_CENTRE
    lit = windows.disk_map(size, float(case.removeprefix("disk r=")), (middle, middle))
    if measured:
        return tones.count_tones(real.map_visibility(lit, k, policy))
    side = kernel_width(k) + 2
    cut = np.lib.stride_tricks.sliding_window_view(lit, (side, side))
    return np.unique(windows.lit_numerators(cut, policy)).size


def _chords(inputs: Inputs) -> list[int]:
    """Whole numbers on the chord that each row cuts from the disk, within the map."""
    size, radius, y, x = inputs.integer("N"), *(inputs.number(name) for name in ("r", "y", "x"))
    counts = []
    for row in range(size):
        half = math.sqrt(max(radius * radius - (row - y) * (row - y), 0.0))
        inside = abs(row - y) <= radius
        counts.append(max(min(math.floor(x + half), size - 1) - max(math.ceil(x - half), 0) + 1, 0) if inside else 0)
    return counts


# Filters that are measured on arrays: each is a program to compile, and others would repeat these.
_MEASURED = {(4, "1-SM"), (4, "2-SM max"), (4, "3-SM min/max"), (9, "2-SM min"), (9, "3-SM min/max")}


def _measure_on(make: Callable[[int], Bool[np.ndarray, "patterns rows cols"]]) -> Callable[[Inputs], int | None]:
    """Tones of the package's filter over the windows that `make` gives for a window width."""

    def measure(inputs: Inputs) -> int | None:
        k, policy = inputs.integer("k"), _policy(inputs)
        return real.count_window_tones(make(kernel_width(k) + 2), k, policy) if (k, policy) in _MEASURED else None

    return measure


def _depths_in_map(inputs: Inputs) -> int:
    """Depths of the map, its own among them, that one texel of the package's n-SM holds, counted by what moves it."""
    depth = jnp.asarray(np.random.default_rng(6).permutation(36).reshape(6, 6), default_dtype())
    return cost.count_build_fetches(lambda one: real.multi_depth.ring(one, inputs.integer("n")), depth)


def _samples(policies: tuple[str, ...], taps: tuple[int, ...]) -> tuple[dict[str, object], ...]:
    return tuple({"k": k, "policy": policy} for k in taps for policy in policies)


_ALL = tuple(POLICIES)

EQUATIONS: tuple[Equation, ...] = (
    Equation(
        id="mdsm.Eq4.1.k",
        source="mdsm, eq. 4.1",
        statement="A filter of n equally weighted shadow tests gives n + 1 tones.",
        verdict="holds",
        closed_form=lambda i: tones.nominal_tones(i.integer("n"), 2),
        independent=lambda i: tones.count_sums([Fraction(0), Fraction(1)], i.integer("n")),
        measured=_combinations_tones,
        samples=({"n": 4}, {"n": 6}),
    ),
    Equation(
        id="mdsm.Eq4.2.k",
        source="mdsm, eq. 4.2",
        statement="A filter of n elements with w values each gives (w − 1)·n + 1 tones.",
        verdict="conditional",
        condition="The values are equally spaced and equally weighted; otherwise up to C(n+w−1, w−1).",
        closed_form=lambda i: tones.nominal_tones(i.integer("n"), i.integer("w")),
        independent=lambda i: tones.count_sums([Fraction(level) for level in range(i.integer("w"))], i.integer("n")),
        measured=_combinations_tones,
        samples=({"n": 4, "w": 2}, {"n": 6, "w": 2}, {"n": 4, "w": 4}),
    ),
    Equation(
        id="mdsm.Eq4.2.counterexample",
        source="mdsm, eq. 4.2",
        statement="Levels that are not equally spaced give more tones than (w − 1)·n + 1.",
        verdict="erratum",
        closed_form=lambda i: tones.count_sums([Fraction(str(level)) for level in i["levels"]], i.integer("n")),
        independent=_multisets,
        correction=Correction(
            printed="w values an element give (w − 1)·n + 1 tones, whatever the values",
            corrected="at most C(n+w−1, w−1); (w − 1)·n + 1 for equally spaced values",
            printed_form=lambda i: tones.nominal_tones(i.integer("n"), len(i["levels"])),
            counterexample={"levels": [0, 0.3, 1], "n": 2},
        ),
        samples=({"levels": [0, 0.3, 1], "n": 2}, {"levels": [0, 0.5, 1], "n": 3}, {"levels": [0, 0.1, 1], "n": 4}),
    ),
    Equation(
        id="mdsm.Eq4.2.bound",
        source="mdsm, eq. 4.2",
        statement="Most tones of n samples of w levels: C(n+w−1, w−1), or wⁿ if samples have weights of their own.",
        verdict="holds",
        closed_form=lambda i: tones.max_tones(i.integer("n"), i.integer("w"), i["equal"]),
        independent=_most_sums,
        samples=({"n": 3, "w": 3, "equal": True}, {"n": 5, "w": 2, "equal": True}, {"n": 3, "w": 3, "equal": False}),
    ),
    Equation(
        id="mdsm.Eq4.2.weighted",
        source="mdsm, eq. 4.2",
        statement="Tones of samples that are weighted, by all sums.",
        verdict="holds",
        closed_form=lambda i: tones.count_sums(_fractions(i, "levels"), len(i["weights"]), _fractions(i, "weights")),
        independent=_weighted_sums,
        samples=(
            {"levels": [0, 1], "weights": [1, 2, 4]},
            {"levels": [0, 0.5, 1], "weights": [1, 2, 1]},
            {"levels": [0, 0.3, 1], "weights": [1, 1, 3]},
        ),
    ),
    *(
        Equation(
            id=f"mdsm.PCF({k},{n}).tones",
            pattern=r"mdsm\.PCF\((?P<k>\d+),(?P<n>\d+)\)\.tones",
            source="mdsm, section 4.4",
            statement="PCF(k, n) gives n·k + 1 tones; binary windows attain them all.",
            verdict="holds",
            closed_form=lambda i: tones.predicted_tones(i.integer("k"), i.integer("n")),
            independent=_pcf_windows,
            measured=_pcf_measured,
            samples=({},),
        )
        for k, n in NAMED_FILTERS
    ),
    Equation(
        id="mdsm.tones.exhaustive",
        source="mdsm, section 4.4",
        statement="Tones that some binary window gives, over all 2^((K+2)²) of them.",
        verdict="holds",
        closed_form=lambda i: len(tones.exhaustive_tones(i.integer("k"), _policy(i), _centre(i))),
        independent=lambda i: (
            int(np.count_nonzero(windows.enumerated_histogram(i.integer("k"), _policy(i), _centre(i))))
            if i.integer("k") <= 4
            else tones.predicted_tones(i.integer("k"), windows.num_depths(_policy(i)))
        ),
        measured=_exhaustive_measured,
        samples=(
            *({"k": k, "policy": p, "centre_included": c} for k in (1, 4) for p in _ALL for c in (True, False)),
            {"k": 9, "policy": "3-SM min/max", "centre_included": True},
        ),
    ),
    Equation(
        id="mdsm.tones.histogram",
        source="mdsm, section 4.4",
        statement="How many of all binary windows give each tone.",
        verdict="holds",
        closed_form=lambda i: list(windows.window_histogram(i.integer("k"), _policy(i), _centre(i))),
        independent=lambda i: windows.enumerated_histogram(i.integer("k"), _policy(i), _centre(i)),
        measured=_histogram_measured,
        samples=tuple({"k": k, "policy": p, "centre_included": c} for k in (1, 4) for p in _ALL for c in (True, False)),
    ),
    Equation(
        id="mdsm.tones.straight_edge",
        source="mdsm, section 4.4",
        statement="Tones along straight shadow edges: n·k + 1 is attained by the plain map alone.",
        verdict="conditional",
        condition="A straight edge gives n·k + 1 tones only for n = 1; multi-depth filters lose the tones that need a "
        "mixed core without a mixed neighbourhood.",
        closed_form=lambda i: len(tones.straight_edge_tones(i.integer("k"), _policy(i))),
        independent=_random_lines,
        measured=_measure_on(windows.half_plane_windows),
        samples=_samples(_ALL, (1, 4, 9)),
    ),
    Equation(
        id="mdsm.tones.half_planes",
        source="mdsm, section 4.4",
        statement="Windows of s × s texels that a straight edge can make: 2 + Σ (s − |i|)(s − |j|) over coprime i, j.",
        verdict="holds",
        closed_form=_separable,
        independent=lambda i: len(windows.half_plane_windows(i.integer("side"))),
        samples=tuple({"side": side} for side in (1, 2, 3, 4, 5, 6)),
    ),
    Equation(
        id="mdsm.neighbourhood",
        source="mdsm, section 4.5",
        statement="Largest and smallest depth of s × s texels, with or without the middle one.",
        verdict="holds",
        closed_form=_extremes,
        measured=_extremes_measured,
        samples=tuple({"size": size, "centre_included": centre} for size in (2, 3, 5) for centre in (True, False)),
    ),
    Equation(
        id="mdsm.tones.axis_step",
        source="mdsm, section 4.4",
        statement="An edge along an axis of the map gives K + n tones.",
        verdict="holds",
        closed_form=_axis_step,
        independent=lambda i: len(tones.axis_step_tones(i.integer("k"), _policy(i))),
        measured=_measure_on(windows.axis_step_windows),
        samples=_samples(_ALL, (1, 4, 9, 16)),
    ),
    Equation(
        id="mdsm.tones.diag45_step",
        source="mdsm, section 4.4",
        statement="An edge at 45° to the map gives 2(K + n − 1) tones for K ≥ 2.",
        verdict="holds",
        closed_form=_diagonal_step,
        independent=lambda i: len(tones.diagonal_step_tones(i.integer("k"), _policy(i))),
        measured=_measure_on(windows.diagonal_step_windows),
        samples=_samples(_ALL, (1, 4, 9, 16)),
    ),
    Equation(
        id="mdsm.tones.image",
        source="mdsm, section 4.4",
        statement="Tones over a whole binary map with a disk as occluder.",
        verdict="conditional",
        condition="The disk's centre decides which windows occur (8–9 and 11–12 tones for 2 × 2, 17–19 and 24–27 for "
        f"3 × 3); it is taken {DISK_CENTRE} texels off the middle of the map, where both larger 3 × 3 counts occur.",
        closed_form=_image,
        measured=lambda i: _image(i, measured=True),
        samples=(
            ({"k": 4, "policy": "2-SM max", "N": 96}, "2-SM max,k=4,disk r=30"),
            ({"k": 9, "policy": "3-SM min/max", "N": 96}, "3-SM min/max,k=9,disk r=30"),
        ),
    ),
    Equation(
        id="mdsm.tones.disk",
        source="mdsm, section 4.4",
        statement="Dark texels of a map whose occluder is a disk, row by row.",
        verdict="holds",
        closed_form=lambda i: (~windows.disk_map(i.integer("N"), i.number("r"), (i.number("y"), i.number("x")))).sum(1),
        independent=_chords,
        samples=({"N": 12, "r": 4.3, "y": 5.2, "x": 6.1}, {"N": 9, "r": 3, "y": 2.5, "x": 7.25}),
    ),
    Equation(
        id="mdsm.edge_shift",
        source="mdsm, section 4.5",
        statement="Texels by which a policy moves the mean edge into the shadow: ½ (maximum), −½ (minimum), 0; with "
        "neighbourhoods of s × s texels (s − 1)/2 times as much.",
        verdict="holds",
        closed_form=lambda i: (
            Fraction({"1-SM": 0, "2-SM max": 1, "2-SM min": -1, "3-SM min/max": 0}[_policy(i)] * (_size(i) - 1), 2)
            / windows.num_depths(_policy(i))
        ),
        independent=lambda i: tones.edge_shift(_policy(i), _size(i)),
        measured=_shift_measured,
        measured_tolerance=1e-6,
        samples=tuple({"policy": policy} for policy in _ALL)
        + tuple({"policy": policy, "size": 5} for policy in _ALL[1:]),
    ),
    Equation(
        id="mdsm.text.tones_10_13",
        source="mdsm, section 5.2.1",
        statement="A plain map with 9 taps gives at most 10 tones, a 3-SM with 4 taps at most 13.",
        verdict="holds",
        closed_form=lambda i: [tones.predicted_tones(9), tones.predicted_tones(4, 3)],
        recomputed=lambda i: [10, 13],  # as the text says
        measured=lambda i: [
            real.count_window_tones(windows.half_plane_windows(5), 9, "1-SM"),
            real.count_window_tones(real.all_windows(4), 4, "3-SM min/max"),
        ],
        samples=({},),
    ),
    Equation(
        id="mdsm.notation.C_z",
        source="mdsm, sections 4.2 and 4.4",
        statement="An n-SM holds n depths a texel, the texel's own among them.",
        verdict="erratum",
        closed_form=lambda i: i.integer("n"),
        measured=_depths_in_map,
        correction=Correction(
            printed="C_z = {z_c, z_1, ..., z_n} has n + 1 members (section 4.2), while an n-SM stores n (section 4.4)",
            corrected="C_z = {z_c, z_1, ..., z_(n−1)}",
            printed_form=lambda i: i.integer("n") + 1,
            counterexample={"n": 4},
        ),
        samples=({"n": 4}, {"n": 5}, {"n": 6}),
    ),
)
