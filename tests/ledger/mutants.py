"""Mutants of the closed forms, and the rows of the ledger that notice them.

    python -m tests.ledger.mutants [--only MODULE …] [--write]

A mutant is one function with one small mistake: a constant 1 % off, a sign swapped, a term or factor dropped, near and
far exchanged, minimum for maximum. It is compiled from the changed syntax tree and put in the place of the function's
code, in this process; rows that run the function are then checked until one fails. Compiled functions and caches that
hold the old code are cleared. What no row notices is either equivalent, for a reason that `REASONS` gives, or a gap.
"""

import argparse
import ast
import builtins
import contextlib
import copy
import functools
import gc
import importlib
import json
import random
import re
import signal
import sys
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shadowjax.ledger import equation as equation_module

RECORD = Path(__file__).with_name("mutants.json")
# Modules whose functions the ledger checks; `True` where numbers are whole, so that constants change by 1, not by 1 %.
LIBRARY = {
    "theory.aliasing.overhead": False, "theory.cost": True, "theory.limits": False, "theory.memory": True,
    "theory.aliasing.storage": False, "theory.tones": True, "theory.windows": True, "filters.hard": False,
    "filters.multi_depth": True, "filters.variance": False, "filters.convolution": False,
    "filters.exponential": False, "geometry.adjacent_edges": True, "partitions.adaptive.refinement": False,
    "theory.aliasing.split_rules": False, "theory.aliasing.near_distances": False,
    "theory.aliasing.light_frustum": False, "theory.aliasing.optimal": False,
    "theory.aliasing.error": False, "warps.logarithmic": False,
}  # fmt: skip
_LEDGER = Path(equation_module.__file__).parent
LEDGER = tuple(
    sorted(
        ".".join(("ledger", *path.relative_to(_LEDGER).with_suffix("").parts))
        for path in _LEDGER.rglob("*.py")
        if path.stem not in ("__init__", "equation", "inputs", "reference")
    )
)
MOST_ROWS = 40  # that a mutant is tried against, the cheapest first
# What these modules hold next to closed forms: measurements, searches and sorts, a constructor, and what puts closed
# forms together for filters.
OTHERS = {
    "theory.cost.dependence", "theory.cost.count_build_fetches", "theory.cost.count_lookup_fetches",
    "theory.limits.measured_deviation", "theory.limits.measured_exponent", "theory.tones.tones",
    "theory.tones.count_tones", "theory.tones.tone_count", "filters.variance.encode_variance",
    "filters.variance.decode_variance", "filters.exponential.encode_exponential",
    "filters.exponential.decode_exponential", "filters.exponential._limited_test",
    "filters.convolution.encode_convolution", "filters.convolution.decode_convolution",
    "filters.convolution.encode_mean_depth", "filters.convolution.decode_mean_depth",
    "filters.convolution.depth_squeeze", "filters.convolution._series_depth", "filters.convolution._finished",
    "theory.windows.enumerated_histogram",
    "theory.aliasing.light_frustum.LightFrustum.create",
    "partitions.adaptive.refinement.wishes",
}  # fmt: skip
# Beginning of a pattern of names → why no row can notice.
REASONS: tuple[tuple[str, str], ...] = (
    (
        r"aliasing\.(literal_error_z|least_error_depth).*tiny",
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
    (r"lispsm\.(psm|wimmer): .*jnp\.zeros_like", "a zero that only gives the answer the shape of γ"),
    (r"near_distance_from_eta: constant: 0 → 0\.01  in  negative", "a branch that is not taken for η > 0"),
    (
        r"LightFrustum\.(uniform_near_distance|ratio|bounded): .*(eps|uniform_near_distance)",
        "the finite number that stands for n' = ∞: any so large gives the uniform map to rounding",
    ),
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
        r"multi_depth\.(ring_offsets|_ring_cells)",
        "gap of the record: it was made before a row asked where the depths of a ring lie",
    ),
    (r"minimax\.(balanced|least_storage)", "gap: a branch that the views of the row do not take"),
    (r"prediction\.error_z: factor: resolution_ratio \* texel → texel", "gap: rows set the ratio of the maxima only"),
    (r"split_rules\.adaptive_splits: ends: near → far  in  right_angle", "two numbers of one dtype"),
    (
        r"half_plane_windows: (constant: 2 → 3  in  reach|sign: -turned)",
        "directions more, or another last one: the row still counts every window, since complements hold them twice",
    ),
    (r"half_plane_windows: sign: \(ax \+ bx\) \* x \+", "windows mirrored at an axis, which are the same windows"),
    (r"windows\.diagonal_step_windows: constant: 2 → 3", "more windows that are dark all over"),
    (r"windows\.window_histogram: constant: 1 → 2$", "a turn of the loop for a number of lit tests that never comes"),
)
EXCHANGED = {
    "near": "far", "far": "near", "low_near": "low_far", "low_far": "low_near",
    "minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "argmin": "argmax", "argmax": "argmin",
}  # fmt: skip
ENDS = {"near", "far", "low_near", "low_far"}
CHECKS = {"require", "require_int", "require_choice", "require_value", "require_finite", "Unavailable", "ValueError"}
NOT_NUMBERS = {"axis", "dtype", "keepdims", "maxiter", "method", "default", "gamma_deg", "xtol", "rtol", "limit"}
SECONDS = 10  # of processor time that a row may take under a mutant, which may make a loop endless


@dataclass(frozen=True)
class Mutant:
    """One mistake.

    Attributes:
        id: Function, kind and change: a name that a change of other lines leaves as it is.
        module: Without the package's name.
        place: Module and function; lambdas outside functions are numbered.
        kind: "constant", "sign", "term", "factor", "ends" or "extreme".
        code: Compiles the changed module.
    """

    id: str
    module: str
    place: str
    kind: str
    code: Callable[[], types.CodeType]


# --- syntax trees ---------------------------------------------------------------------------------------------------


def _source(module: str) -> tuple[ast.Module, str]:
    file = importlib.import_module(f"shadowjax.{module}").__file__
    assert file is not None
    return ast.parse(Path(file).read_text(encoding="utf-8")), file


def _functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, ast.AST]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            yield f"{prefix}{child.name}", child
        elif isinstance(child, ast.ClassDef):
            yield from _functions(child, f"{prefix}{child.name}.")
        elif isinstance(child, ast.Lambda):
            yield f"{prefix}<lambda>", child
        else:
            yield from _functions(child, prefix)


def _places(tree: ast.Module, module: str) -> Iterator[tuple[str, ast.AST]]:
    """Functions of a module by qualified name, and its lambdas outside functions, numbered."""
    for number, (name, node) in enumerate(_functions(tree, f"{module}.")):
        yield (f"{name}#{number}" if name.endswith("<lambda>") else name), node


def _either(first: ast.expr, second: ast.expr, index: int) -> ast.expr:
    """One of two expressions; the other is still evaluated, so that closures keep their variables."""
    pair = ast.Tuple([copy.deepcopy(first), copy.deepcopy(second)], ast.Load())
    return ast.Subscript(pair, ast.Constant(index), ast.Load())


def _negative(value: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.USub(), value)


Change = tuple[str, str, ast.AST]  # kind, what it reads, the new node


def _dropped(node: ast.BinOp) -> Iterator[Change]:
    left, right = ast.unparse(node.left), ast.unparse(node.right)
    text = ast.unparse(node)
    if isinstance(node.op, ast.Add | ast.Sub):
        last = _either(node.left, node.right, 1)
        yield "term", f"{text} → {left}", _either(node.left, node.right, 0)
        minus = isinstance(node.op, ast.Sub)
        yield "term", f"{text} → {'-' if minus else ''}{right}", _negative(last) if minus else last
    elif isinstance(node.op, ast.Mult):
        yield "factor", f"{text} → {left}", _either(node.left, node.right, 0)
        yield "factor", f"{text} → {right}", _either(node.left, node.right, 1)
    elif isinstance(node.op, ast.Div):
        yield "factor", f"{text} → {left}", _either(node.left, node.right, 0)
        one = ast.BinOp(_either(node.left, ast.Constant(1), 1), ast.Div(), copy.deepcopy(node.right))
        if left != "1":
            yield "factor", f"{text} → 1 / {right}", one
    elif isinstance(node.op, ast.Pow):
        yield "factor", f"{text} → {left}", _either(node.left, node.right, 0)


def _constant(node: ast.Constant, whole: bool) -> Iterator[Change]:
    value = node.value
    if isinstance(value, bool) or not isinstance(value, int | float):
        return
    changed = value + 1 if whole and isinstance(value, int) else value * 1.01 if value else 0.01
    yield "constant", f"{value!r} → {changed!r}", ast.Constant(changed)


def _changes(node: ast.AST, whole: bool, names: set[str]) -> Iterator[Change]:
    """Every mistake that this node alone can have."""
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Add | ast.Sub):
            other = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
            swapped = ast.BinOp(node.left, other, node.right)
            yield "sign", f"{ast.unparse(node)} → {ast.unparse(swapped)}", swapped
        yield from _dropped(node)
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub):
        other = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
        swapped = ast.AugAssign(node.target, other, node.value)
        yield "sign", f"{ast.unparse(node)} → {ast.unparse(swapped)}", swapped
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "sign", f"{ast.unparse(node)} → {ast.unparse(node.operand)}", node.operand
    elif isinstance(node, ast.Constant):
        yield from _constant(node, whole)
    elif isinstance(node, ast.Attribute) and node.attr in EXCHANGED and isinstance(node.ctx, ast.Load):
        kind = "ends" if node.attr in ENDS else "extreme"
        changed = ast.Attribute(node.value, EXCHANGED[node.attr], node.ctx)
        yield kind, f"{ast.unparse(node)} → {ast.unparse(changed)}", changed
    elif isinstance(node, ast.Name) and node.id in EXCHANGED and isinstance(node.ctx, ast.Load):
        other = EXCHANGED[node.id]
        if node.id not in ENDS or other in names:
            yield "ends" if node.id in ENDS else "extreme", f"{node.id} → {other}", ast.Name(other, node.ctx)


def _walk(node: ast.AST, text: str = "") -> Iterator[tuple[ast.AST, str, Any, str]]:
    """Nodes that may change, with where each hangs (parent, field, place in a list) and the statement around it.

    Checks of arguments, text, annotations, places in arrays and options that are no numbers of a formula are left out.
    """
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr):
        return
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "args") and isinstance(node, ast.FunctionDef | ast.arg):
            continue
        if isinstance(node, ast.arguments) or (isinstance(node, ast.Subscript) and name == "slice"):
            continue
        for place, child in enumerate(value) if isinstance(value, list) else ((None, value),):
            if not isinstance(child, ast.AST):
                continue
            if isinstance(child, ast.Call) and getattr(child.func, "id", "") in CHECKS:
                continue
            if isinstance(child, ast.keyword) and (child.arg in NOT_NUMBERS):
                continue
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
                continue
            inner = text
            if isinstance(child, ast.stmt) and not isinstance(child, ast.FunctionDef | ast.For | ast.While | ast.If):
                inner = ast.unparse(child).splitlines()[0]
            yield node, name, place, inner
            yield from _walk(child, inner)


def mutants(module: str, whole: bool = False) -> Iterator[Mutant]:
    """Every mutant of one module, in the order of its lines."""
    tree, file = _source(module)
    seen: set[str] = set()
    for place, node in _places(tree, module):
        names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
        names |= {one.arg for one in ast.walk(node) if isinstance(one, ast.arg)}
        for parent, name, index, text in list(_walk(node)):
            old = getattr(parent, name) if index is None else getattr(parent, name)[index]
            where = parent, name, index
            for kind, change, new in _changes(old, whole, names):
                shown = change if len(text) > 100 or text in ("", change.split(" → ")[0]) else f"{change}  in  {text}"
                label, number = f"{place.split('#')[0]}: {kind}: {shown}", 2
                while label in seen:
                    label, number = f"{place.split('#')[0]}: {kind}: {shown} ({number})", number + 1
                seen.add(label)
                yield Mutant(label, module, place, kind, functools.partial(_compiled, tree, file, where, old, new))


Where = tuple[ast.AST, str, int | None]  # parent, field, place in a list


def _compiled(tree: ast.Module, file: str, where: Where, old: ast.AST, new: ast.AST) -> types.CodeType:
    """The module with a node in the place of another, which is put back."""
    ast.copy_location(new, old)
    ast.fix_missing_locations(new)
    _put(*where, new)
    try:
        return compile(tree, file, "exec", dont_inherit=True)
    finally:
        _put(*where, old)


def _put(parent: ast.AST, name: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[index] = node


# --- code in place of code ------------------------------------------------------------------------------------------


def _pairs(old: types.CodeType, new: types.CodeType) -> Iterator[tuple[types.CodeType, types.CodeType]]:
    """Code objects of two compiled modules that stand in one place and differ."""
    inner_old = [one for one in old.co_consts if isinstance(one, types.CodeType)]
    inner_new = [one for one in new.co_consts if isinstance(one, types.CodeType)]
    for first, second in zip(inner_old, inner_new, strict=True):
        if first != second:
            yield first, second
            yield from _pairs(first, second)


class Patcher:
    """Puts code in the place of code, in every function that runs it, and clears what was compiled from the old."""

    def __init__(self, modules: tuple[str, ...]) -> None:
        self.original: dict[str, types.CodeType] = {}
        for module in modules:
            tree, file = _source(module)
            self.original[module] = compile(tree, file, "exec", dont_inherit=True)
        self.functions: dict[types.CodeType, list[types.FunctionType]] = {}
        files = {code.co_filename for code in self.original.values()}
        for one in gc.get_objects():
            if isinstance(one, types.FunctionType) and one.__code__.co_filename in files:
                self.functions.setdefault(one.__code__, []).append(one)
        self.caches = list(_caches())

    @contextlib.contextmanager
    def patched(self, module: str, code: types.CodeType) -> Iterator[None]:
        """Run with a changed module."""
        pairs = list(_pairs(self.original[module], code))
        swapped: list[tuple[types.FunctionType, types.CodeType]] = []
        changed = [function for old, _ in pairs for function in self.functions.get(old, [])]
        names = {function.__name__ for function in changed}
        stale = [clear for clear, reached in self.caches if names & reached]
        try:
            for old, new in pairs:
                for function in self.functions.get(old, []):
                    function.__code__ = new
                    swapped.append((function, old))
            for clear in stale:
                clear()
            yield
        finally:
            for function, old in swapped:
                function.__code__ = old
            for clear in stale:
                clear()


def _names(code: types.CodeType) -> set[str]:
    found = set(code.co_names) | set(code.co_freevars)
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            found |= _names(one)
    return found


@functools.cache
def _called() -> dict[str, set[str]]:
    """Name of a function or property of the package → names that its code holds."""
    found: dict[str, set[str]] = {}
    for one in gc.get_objects():
        if isinstance(one, types.FunctionType) and (one.__module__ or "").startswith("shadowjax."):
            found.setdefault(one.__name__, set()).update(_names(one.__code__))
    return found


def _reached(name: str) -> set[str]:
    """Names of all functions that a function may reach, by names alone: more than it does, never less."""
    called, found, waiting = _called(), {name}, [name]
    while waiting:
        for other in called.get(waiting.pop(), ()):
            if other in called and other not in found:
                found.add(other)
                waiting.append(other)
    return found


def _caches() -> Iterator[tuple[Callable[[], Any], set[str]]]:
    """Compiled functions and caches of the package's modules: how to clear each, and what it reaches."""
    known: set[int] = set()
    for name, module in list(sys.modules.items()):
        if not name.startswith("shadowjax.") or module is None:
            continue
        for one in list(vars(module).values()):
            clear = getattr(one, "clear_cache", None) or getattr(one, "cache_clear", None)
            if clear is None or id(one) in known or one is equation_module.ledger or isinstance(one, type):
                continue
            known.add(id(one))
            inner = one
            while hasattr(inner, "__wrapped__"):
                inner = inner.__wrapped__
            yield clear, _reached(inner.__name__)


# --- which rows run which functions ---------------------------------------------------------------------------------


def _instrumented(module: str) -> types.CodeType:
    """A module whose functions say that they run, those inside functions under the name of the outermost."""
    tree, file = _source(module)
    for place, outermost in _places(tree, module):
        call = ast.Call(ast.Name("_mutants_seen", ast.Load()), [ast.Constant(place)], [])
        for node in list(ast.walk(outermost)):
            if isinstance(node, ast.Lambda):
                node.body = ast.Subscript(ast.Tuple([call, node.body], ast.Load()), ast.Constant(1), ast.Load())
            elif isinstance(node, ast.FunctionDef):
                node.body.insert(1 if ast.get_docstring(node) is not None else 0, ast.Expr(call))
    return compile(ast.fix_missing_locations(tree), file, "exec", dont_inherit=True)


@dataclass
class Row:
    """A row of the ledger with its cost in seconds and the functions that it runs."""

    equation: equation_module.Equation
    seconds: float
    runs: set[str]


def _fails(equation: equation_module.Equation) -> str:
    """Why a row fails: the first check that does, or an exception; empty if it passes."""

    def late(*_: Any) -> None:
        raise TimeoutError(f"more than {SECONDS} s")

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        for one in equation_module.checks(equation):
            if not one.passed:
                return one.name
    except Exception as error:
        return f"raises {type(error).__name__}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return ""


def trace(patcher: Patcher, prefixes: tuple[str, ...], say: Callable[[str], None], file: Path | None) -> list[Row]:
    """Check every row as it is, and find which functions it runs; cheapest first.

    Args:
        patcher: Of all modules that matter.
        prefixes: Beginnings of the ids of the rows to look at.
        say: Called with a line for each row.
        file: Keeps what was found; rows that it knows are not checked again.
    """
    kept = json.loads(file.read_text(encoding="utf-8")) if file and file.exists() else {}
    seen: set[str] = set()
    builtins._mutants_seen = seen.add  # type: ignore[attr-defined]
    rows = []
    with contextlib.ExitStack() as stack:
        for module in patcher.original:
            stack.enter_context(patcher.patched(module, _instrumented(module)))
        for equation in equation_module.ledger().values():
            if not equation.id.startswith(prefixes):
                continue
            if equation.id in kept:
                rows.append(Row(equation, kept[equation.id][0], set(kept[equation.id][1])))
                continue
            for clear, _ in patcher.caches:
                clear()
            seen.clear()
            start = time.process_time()
            reason = _fails(equation)
            if reason:
                raise RuntimeError(f"{equation.id} fails as it is: {reason}")
            rows.append(Row(equation, time.process_time() - start, set(seen)))
            say(f"{rows[-1].seconds:6.2f} s  {equation.id}")
    if file:
        kept |= {row.equation.id: (row.seconds, sorted(row.runs)) for row in rows}
        file.write_text(json.dumps(kept), encoding="utf-8")
    return sorted(rows, key=lambda row: row.seconds)


# --- the run --------------------------------------------------------------------------------------------------------


def _test(mutant: Mutant, rows: list[Row], patcher: Patcher) -> tuple[str, str]:
    """The first row that fails for a mutant, and why; empty if none does."""
    with patcher.patched(mutant.module, mutant.code()):
        for row in rows:
            if reason := _fails(row.equation):
                return row.equation.id, reason
    return "", ""


def run(
    modules: dict[str, bool],
    prefixes: tuple[str, ...],
    say: Callable[[str], None],
    save: Callable[[dict[str, Any]], None],
    kept: Path | None = None,
    old: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Every mutant of some modules against the rows that run its function.

    Args:
        modules: As in LIBRARY.
        prefixes: Beginnings of the ids of the rows to look at.
        say: Called with a line for each thing done.
        save: Called with what is known, now and then.
        kept: File of what each row runs, for the next time.
        old: An earlier record: mutants that it knows to be noticed are not tried again, nor rows that notice one.

    Returns:
        For each mutant the row that noticed it, or an empty name; for each row a mutant that it fails for, likewise;
        and the functions that no row runs.
    """
    old = old or {"mutants": {}, "rows": {}, "unused": []}
    patcher = Patcher((*LIBRARY, *LEDGER))
    rows = trace(patcher, prefixes, say, kept)
    ran: set[str] = set().union(*(row.runs for row in rows))
    ledger = equation_module.ledger()
    noticed: dict[str, str] = {row.equation.id: old["rows"].get(row.equation.id, "") for row in rows}
    every = [
        mutant
        for module, whole in modules.items()
        for mutant in mutants(module, whole)
        if mutant.place in ran and mutant.place not in OTHERS
    ]
    found = {one.id: old["mutants"][one.id] for one in every if old["mutants"].get(one.id) in ledger}
    places = {place for module in modules for place, _ in _places(_source(module)[0], module)}
    unused = sorted(one for one in places - ran - OTHERS if "#" not in one)
    todo = [one for one in every if one.id not in found]
    say(f"{len(every)} mutants, {len(todo)} of them not known to be noticed")
    for number, mutant in enumerate(todo):
        chosen = [row for row in rows if mutant.place in row.runs]
        # among rows of like cost, those that have noticed nothing yet come first
        chosen.sort(key=lambda row: row.seconds + 0.2 * bool(noticed[row.equation.id]))
        name, reason = _test(mutant, chosen[:MOST_ROWS], patcher)
        found[mutant.id] = name
        if name:
            noticed[name] = noticed[name] or mutant.id
        say(f"{number:5d}  {mutant.id}  |  {name or f'SURVIVES {len(chosen)} rows'}  {reason}")
        if number % 50 == 0:
            save({"mutants": found, "rows": noticed, "unused": unused})
    wanted = [row for row in rows if not noticed[row.equation.id]]
    inner = [mutant for module in LEDGER for mutant in mutants(module)] if wanted else []
    for number, row in enumerate(wanted):
        at = next((one for one in (*every, *inner) if one.place in row.runs and _test(one, [row], patcher)[0]), None)
        noticed[row.equation.id] = at.id if at else ""
        say(f"{row.equation.id}  fails for  {noticed[row.equation.id] or 'NOTHING'}")
        if number % 10 == 0:
            save({"mutants": found, "rows": noticed, "unused": unused})
    return {"mutants": found, "rows": noticed, "unused": unused}


def _added(old: dict[str, Any], new: dict[str, Any], modules: tuple[str, ...]) -> dict[str, Any]:
    """A record with some of its modules made anew."""
    begins = tuple(f"{module}." for module in modules)
    kept = {name: row for name, row in old["mutants"].items() if not name.startswith(begins)}
    rows = {name: new["rows"].get(name) or old["rows"].get(name, "") for name in {**old["rows"], **new["rows"]}}
    known = equation_module.ledger()
    return {
        "mutants": dict(sorted({**kept, **new["mutants"]}.items())),
        "rows": {name: rows[name] for name in known if name in rows},
        "unused": sorted({one for one in old["unused"] if not one.startswith(begins)} | set(new["unused"])),
    }


def table(result: dict[str, Any]) -> str:
    """What a run found, module by module, then what survives with its reason."""
    lines, counts = [], {}
    for name, row in result["mutants"].items():
        module = next(one for one in (*LIBRARY, *LEDGER) if name.startswith(one + "."))
        made, noticed = counts.get(module, (0, 0))
        counts[module] = made + 1, noticed + bool(row)
    for module, (made, noticed) in counts.items():
        lines.append(f"{module:28} {made:5d} mutants, {noticed:5d} noticed")
    survivors = [name for name, row in result["mutants"].items() if not row]
    without = [name for name in survivors if not reason_of(name)]
    lines += ["", "Survivors:", *(f"- {name}\n    {reason_of(name) or 'NO REASON'}" for name in survivors)]
    silent = [name for name, mutant in result["rows"].items() if not mutant]
    lines += ["", f"rows that fail for no mutant: {', '.join(silent) or 'none'}"]
    lines += [f"functions that no row runs: {', '.join(result['unused']) or 'none'}"]
    total = len(result["mutants"])
    share = 100 * (total - len(survivors)) / max(total, 1)
    lines += [
        f"{total - len(survivors)} of {total} mutants noticed ({share:.1f} %), {len(survivors)} survive, "
        f"{len(without)} of them without a reason; {len(result['rows']) - len(silent)} of {len(result['rows'])} rows "
        "fail for some mutant"
    ]
    return "\n".join(lines)


def reason_of(name: str) -> str:
    """Why a mutant changes nothing, or nothing that a row could see."""
    return next((reason for pattern, reason in REASONS if re.search(pattern, name)), "")


def sample(count: int, seed: int, say: Callable[[str], None]) -> list[str]:
    """Mutants that the record says a row notices, drawn at random, against that row alone.

    Returns:
        Those that their row does not notice any more.
    """
    record = {name: row for name, row in json.loads(RECORD.read_text(encoding="utf-8"))["mutants"].items() if row}
    known = equation_module.ledger()
    patcher = Patcher((*LIBRARY, *LEDGER))
    every = [
        mutant
        for module, whole in LIBRARY.items()
        for mutant in mutants(module, whole)
        if record.get(mutant.id) in known
    ]
    missed = []
    for mutant in random.Random(seed).sample(every, min(count, len(every))):
        row = known[record[mutant.id]]
        with patcher.patched(mutant.module, mutant.code()):
            reason = _fails(row)
        say(f"{mutant.id}  |  {row.id}  {reason or 'SURVIVES'}")
        if not reason:
            missed.append(mutant.id)
    return missed


def main() -> int:
    """Run all of it, or some modules and rows, and print what survives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[*LIBRARY], help="modules to change")
    parser.add_argument("--rows", nargs="+", default=[""], help="beginnings of the ids of rows to check")
    parser.add_argument("--write", type=Path, default=None, help="where to write what was found, as JSON")
    parser.add_argument("--trace", type=Path, default=None, help="file that keeps what rows run")
    parser.add_argument("--add", action="store_true", help="keep what the file says, and try what it does not know")
    parser.add_argument("--sample", type=int, help="draw so many mutants of the record, each against its row")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    modules = {name: LIBRARY.get(name, False) for name in chosen.only}
    start = time.process_time()

    def say(line: str) -> None:
        print(f"{time.process_time() - start:7.1f}  {line}", file=sys.stderr, flush=True)

    if chosen.sample:
        missed = sample(chosen.sample, chosen.seed, say)
        print("\n".join(missed) or f"{chosen.sample} mutants, each noticed by its row")
        return 1 if missed else 0
    old = json.loads(chosen.write.read_text(encoding="utf-8")) if chosen.add else None

    def save(found: dict[str, Any]) -> None:
        if chosen.write:
            record = found if old is None else _added(old, found, tuple(modules))
            chosen.write.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")

    result = run(modules, tuple(chosen.rows), say, save, chosen.trace, old)
    save(result)
    print(table(result if old is None else _added(old, result, tuple(modules))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
