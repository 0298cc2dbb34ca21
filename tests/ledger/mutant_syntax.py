"""Mutants: functions of the package with one small mistake each, made in their syntax trees."""

import ast
import copy
import functools
import importlib
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shadowjax.ledger import equation as equation_module

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
EXCHANGED = {
    "near": "far", "far": "near", "low_near": "low_far", "low_far": "low_near",
    "minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "argmin": "argmax", "argmax": "argmin",
}  # fmt: skip
ENDS = {"near", "far", "low_near", "low_far"}
CHECKS = {"require", "require_int", "require_choice", "require_value", "require_finite", "Unavailable", "ValueError"}
NOT_NUMBERS = {"axis", "dtype", "keepdims", "maxiter", "method", "default", "gamma_deg", "xtol", "rtol", "limit"}


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


def source(module: str) -> tuple[ast.Module, str]:
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


def places(tree: ast.Module, module: str) -> Iterator[tuple[str, ast.AST]]:
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
    tree, file = source(module)
    seen: set[str] = set()
    for place, node in places(tree, module):
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
