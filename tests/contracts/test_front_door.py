"""The front door: every public name loads, none hides a module of its package, and pages need no deeper import."""

import ast
import importlib
import re
import subprocess
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest

import shadowjax

ROOT = Path(__file__).parents[2]
PACKAGES = ["shadowjax", *(f"shadowjax.{path.parent.name}" for path in (ROOT / "shadowjax").glob("*/__init__.pyi"))]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "_build" not in page.parts]


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_of_a_package_loads(name):
    package = importlib.import_module(name)
    modules = {path.stem for path in Path(package.__file__).parent.iterdir()}
    assert package.__all__ == sorted(set(package.__all__))
    for public in package.__all__:
        value = getattr(package, public)
        assert value is getattr(package, public)
        # A module of the same name would take the place of the value once it is imported.
        assert public not in modules or isinstance(value, types.ModuleType), public
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="nothing_of_that_name"):
        package.nothing_of_that_name  # noqa: B018


def test_public_modules_at_the_top_are_few():
    found = {path.stem for path in (ROOT / "shadowjax").glob("*.py") if not path.stem.startswith("_")}
    assert found <= {"functional", "io", "shading"}


def modules_of(name: str) -> set[str]:
    """Public modules of a package."""
    folder = ROOT / name.replace(".", "/")
    return {path.stem for path in folder.glob("*") if not path.stem.startswith("_")} if folder.is_dir() else set()


def imports_of(page: Path):
    """The imports that the code of a page makes, as (module, names)."""
    for block in re.findall(r"^```(?:python|\{code-cell\}[^\n]*)\n(.*?)^```", page.read_text(), re.M | re.S):
        code = re.sub(r"^(?::|%|---).*$", "", block, flags=re.M)
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom):
                yield node.module or "", [alias.name for alias in node.names]
            elif isinstance(node, ast.Import):
                yield from ((alias.name, []) for alias in node.names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pages_import_nothing_deeper_than_a_name_of_a_package(page):
    for module, names in imports_of(page):
        if module.split(".")[0] == "shadowjax":
            assert module.count(".") <= 1, f"{page.name} imports {module}; use a name of its package"
            offered = {*dir(importlib.import_module(module)), *modules_of(module)}
            assert set(names) <= offered, f"{module} does not offer {set(names) - offered}"


def _origin(trees: dict[str, ast.Module], module: str, name: str) -> str:
    """The module of ours, or the foreign one, that defines a name, with the name it has there."""
    for node in trees[module].body if module in trees else ():
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _origin(trees, _absolute(module, node), alias.name)
    return f"{module}.{name}"


def _absolute(module: str, node: ast.ImportFrom) -> str:
    parts = module.split(".")
    return ".".join([*parts[: len(parts) + 1 - node.level], node.module or ""]) if node.level else node.module or ""


def _listed(tree: ast.Module) -> Iterator[str]:
    """What the `__all__` of a module names."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            yield from (one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant))


def test_every_exported_name_has_one_meaning():
    """Of functions, classes and values; a package or module may be named as what a function of it answers."""
    trees = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): ast.parse(path.read_text())
        for path in (ROOT / "shadowjax").rglob("*.py")
    }
    origins: dict[str, set[str]] = {}
    for module, tree in trees.items():
        for name in _listed(tree):
            origins.setdefault(name, set()).add(_origin(trees, module, name))
    for package in PACKAGES:
        stub = ast.parse((ROOT / package.replace(".", "/") / "__init__.pyi").read_text())
        for node in stub.body:
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    source = _origin(trees, _absolute(package, node), alias.name)
                    origins.setdefault(alias.asname or alias.name, set()).add(source)
    assert len(origins) > 700
    several = {name: {one for one in found if one not in trees} for name, found in origins.items()}
    assert not {name: found for name, found in several.items() if len(found) > 1}


def test_importing_the_package_does_not_import_jax():
    code = "import sys, shadowjax; sys.exit('jax' in sys.modules or 'matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_package_says_that_it_is_typed():
    assert (Path(shadowjax.__file__).parent / "py.typed").exists()
