"""Docstrings and messages name what exists: names in backticks, and in messages whatever reads like a call."""

import ast
import builtins
import keyword
import re
from collections.abc import Iterator
from pathlib import Path

import jax

ROOT = Path(__file__).parents[2] / "shadowjax"
TREES = {path: ast.parse(path.read_text()) for path in ROOT.rglob("*.py")}
# Names that are not ours: packages, what they offer, an extra of this one, and ends of names.
FOREIGN = {"Figure", "RESULTS", "_deg", "class_", "dataclasses", "eqx", "flip_evaluator", "jax", "np", "optimistix"}
FOREIGN |= {"NAME", "stop_gradient", "tables", "tree_map"}


def _strings(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def _defined(tree: ast.AST) -> Iterator[str]:
    """Every name that a file gives to something."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.id if isinstance(node, ast.Name) else node.attr
        elif isinstance(node, ast.alias):
            yield node.asname or node.name


DEFINED = {name for tree in TREES.values() for name in _defined(tree)}
DEFINED |= {part for path in TREES for part in path.relative_to(ROOT.parent).with_suffix("").parts}
CLASSES = {node.name: node for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
VALUES = {text for tree in TREES.values() for text in _strings(tree) if text.isidentifier()}


def _members(name: str) -> set[str] | None:
    """What a class of ours and its bases define; None where a base is not ours."""
    if name not in CLASSES:
        return None
    found = set(_defined(CLASSES[name]))
    for base in CLASSES[name].bases:
        text = ast.unparse(base).split("[")[0].split(".")[-1]
        more = set[str]() if text in ("Generic", "NamedTuple", "Checked", "Module") else _members(text)
        if more is None:
            return None
        found |= more
    return found


def missing(dotted: str) -> bool:
    """Whether a name, or a member of what it names, exists nowhere."""
    first, *rest = dotted.split(".")
    if first in FOREIGN:
        return False
    known = first in DEFINED or hasattr(builtins, first) or hasattr(jax, first)
    for owner, member in zip([first, *rest], rest, strict=False):
        members = _members(owner)
        known &= member in (DEFINED if members is None else members)
    return not known


def _messages(tree: ast.AST) -> Iterator[str]:
    """Strings of what is raised, required or warned of."""
    for node in ast.walk(tree):
        asked = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if isinstance(node, ast.Raise) or (asked and node.func.id.startswith(("require", "warn"))):
            yield from _strings(node)


def test_names_in_backticks_exist():
    seen, wrong = 0, []
    for path, tree in TREES.items():
        for text in _strings(tree):
            for quoted in re.findall(r"`([A-Za-z_][\w.]*)(?:\([^`]*\))?`", text):
                seen += 1
                if missing(quoted) and not (quoted in VALUES or keyword.iskeyword(quoted)):
                    wrong.append(f"{path.relative_to(ROOT)}: {quoted}")
    assert seen > 500
    assert not wrong, wrong


def test_names_in_messages_exist():
    seen, wrong = 0, []
    for path, tree in TREES.items():
        for text in _messages(tree):
            # `Name(`, `name(` and `Class.member`; a class is spelled with a capital, so "it is no file.Next" is none.
            for name in re.findall(r"(?<![\w.])([A-Za-z_][\w.]*)\(|(?<![\w.])([A-Z]\w*\.[a-z_]+)(?!\w)", text):
                seen += 1
                if missing(name[0] or name[1]):
                    wrong.append(f"{path.relative_to(ROOT)}: {name[0] or name[1]}")
    assert seen > 10
    assert not wrong, wrong


def test_a_name_that_does_not_exist_is_found():
    assert not missing("Cascades.at")
    assert not missing("make_technique")
    assert missing("Cascades.reaching_over")
    assert missing("named_technique")
