"""Nothing casts by brute force unless it is told to."""

import ast
import importlib
import inspect
from pathlib import Path

import shadowjax
from shadowjax.rays import BruteForceCaster
from shadowjax.rays.casters import default_caster

PACKAGE = Path(shadowjax.__file__).parent
MODULES = sorted(path.relative_to(PACKAGE.parent).with_suffix("") for path in PACKAGE.rglob("*.py"))


def test_no_public_signature_defaults_to_brute_force():
    assert not isinstance(default_caster(), BruteForceCaster)
    seen = 0
    for path in MODULES:
        if path.name.startswith("__") or "plotting" in path.parts:
            continue
        module = importlib.import_module(".".join(path.parts))
        for name, value in vars(module).items():
            if name.startswith("_") or not callable(value) or getattr(value, "__module__", "") != module.__name__:
                continue
            try:
                parameters = inspect.signature(value).parameters.values()
            except ValueError:  # classes of Python's own
                continue
            seen += sum(one.name == "caster" for one in parameters)
            assert not any(isinstance(one.default, BruteForceCaster) for one in parameters), f"{path}: {name}"
    assert seen > 20


def test_no_module_beyond_the_casters_knows_brute_force():
    """So none can take it where an argument is left out."""
    for path in MODULES:
        if "rays" in path.parts:
            continue
        tree = ast.parse((PACKAGE.parent / path).with_suffix(".py").read_text())
        names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert "BruteForceCaster" not in names, path
