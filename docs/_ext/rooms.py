"""API pages: `.. room:: PACKAGE` documents every public module of a package, `.. public-names::` the front door."""

import importlib
import inspect
import pkgutil

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def modules_of(name: str) -> list[str]:
    """Names of a module and of all public modules below it, sorted."""
    module = importlib.import_module(name)
    found = [name]
    for info in pkgutil.iter_modules(getattr(module, "__path__", []), name + "."):
        if not info.name.rsplit(".", 1)[-1].startswith("_"):
            found += modules_of(info.name) if info.ispkg else [info.name]
    return found


def first_line(text: str | None) -> str:
    """The one line that says what something is."""
    return (text or "").strip().split("\n")[0]


def has_public_names(name: str) -> bool:
    """Whether a module defines, rather than re-exports, something public."""
    module = importlib.import_module(name)
    return any(
        getattr(value, "__module__", None) == name and not key.startswith("_") for key, value in vars(module).items()
    )


class Room(SphinxDirective):
    """Every public module of a package, one section each."""

    required_arguments = 1
    option_spec = {"only": directives.unchanged}  # noqa: RUF012 (the form docutils asks for)

    def run(self) -> list[nodes.Node]:
        """Sections made of automodule directives."""
        lines = []
        for name in modules_of(self.arguments[0]):
            importable = importlib.import_module(name)
            self.env.note_dependency(inspect.getsourcefile(importable) or "")
            if not has_public_names(name):
                continue
            title = name.removeprefix("shadowjax.")
            lines += [
                title,
                "-" * len(title),
                "",
                f".. automodule:: {name}",
                "   :members:",
                "   :ignore-module-all:",
                "   :show-inheritance:",
                "",
            ]
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


class PublicNames(SphinxDirective):
    """What `import shadowjax` offers, with a link to where each name lives."""

    def run(self) -> list[nodes.Node]:
        """One list item a name."""
        package = importlib.import_module("shadowjax")
        lines = []
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.ismodule(value):
                lines.append(f"- :py:mod:`{name} <{value.__name__}>`: {first_line(value.__doc__)}")
                continue
            home = getattr(value, "__module__", "")
            if inspect.isclass(value) or inspect.isfunction(inspect.unwrap(value)):
                real = getattr(value, "__name__", name)
                target = f":py:obj:`{name} <{home}.{real}>`"
                lines.append(f"- {target}: {first_line(value.__doc__)}")
            else:
                lines.append(f"- ``{name}``: registry of {', '.join(f'``{key}``' for key in value)}")
        return self.parse_text_to_nodes("\n".join(lines))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both directives."""
    app.add_directive("room", Room)
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True}
