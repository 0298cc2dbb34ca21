"""`{command-options} Report`: the flags of one command, read off its dataclass and the docstrings of its fields."""

import ast
import dataclasses
import inspect
from typing import Any

from docutils import nodes
from ledger_tables import codes, table, text
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from shadowjax.cli import options


def field_docs(command: type) -> dict[str, str]:
    """The docstring under each field of a dataclass."""
    (definition,) = ast.parse(inspect.getsource(command)).body
    assert isinstance(definition, ast.ClassDef)
    docs, name = {}, ""
    for statement in definition.body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            name = statement.target.id
        elif isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant) and name:
            docs[name], name = " ".join(str(statement.value.value).split()), ""
    return docs


def default_text(value: Any) -> str:
    """A default as it would be typed; empty where there is none."""
    if value is None or value in ((), ""):
        return ""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


class CommandOptions(SphinxDirective):
    """A table of flags, meanings and defaults."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """One row a field; groups of fields have tables of their own."""
        command = getattr(options, self.arguments[0], None)
        if not (isinstance(command, type) and dataclasses.is_dataclass(command)):
            raise self.error(f"{self.arguments[0]} is not a set of options of shadowjax.cli.options")
        docs, limits, default, rows = field_docs(command), options.limits_of(command), command(), []
        for field in dataclasses.fields(command):
            value = getattr(default, field.name)
            if dataclasses.is_dataclass(value):
                continue
            flag = "SCENE" if field.name == "scene" else f"--{field.name.replace('_', '-')}"
            given = default_text(value)
            allowed = f" Limits: {limits[field.name]}." if field.name in limits else ""
            meaning = text(docs.get(field.name, "") + allowed)
            rows.append([codes([flag]), meaning, codes([given]) if given else text("")])
        return [
            text(inspect.cleandoc(command.__doc__ or "")),
            table(["flag", "meaning", "default"], [24, 56, 20], rows, "options"),
        ]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("command-options", CommandOptions)
    return {"parallel_read_safe": True}
