"""Tables made from the package's registries at build time: equations, errata, techniques, scenes, experiments."""

import dis
import inspect
import itertools
import json
import re
import types
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import shadowjax as sj
from shadowjax.ledger.equation import KINDS, SOURCES, Equation, Inputs, ledger

CODE = re.compile(r"(`[^`]+`|(?<!\S)--\w[\w-]*)")
GALLERY = Path(__file__).parents[1] / "_static" / "gallery"


def text(words: str) -> nodes.paragraph:
    """A plain paragraph; nothing in it is markup, but `code` in backticks and --flags become code."""
    paragraph = nodes.paragraph()
    for index, part in enumerate(CODE.split(words)):
        paragraph += nodes.literal(text=part.strip("`")) if index % 2 else nodes.Text(part)
    return paragraph


def table(head: Sequence[str], widths: Sequence[int], rows: Sequence[Sequence[nodes.Node]], kind: str) -> nodes.table:
    """A table of ready nodes."""
    group = nodes.tgroup(cols=len(head))
    for width in widths:
        group += nodes.colspec(colwidth=width)

    def row(cells: Sequence[nodes.Node]) -> nodes.row:
        return nodes.row("", *(nodes.entry("", cell) for cell in cells))

    group += nodes.thead("", row([text(title) for title in head]))
    group += nodes.tbody("", *(row(cells) for cells in rows))
    result = nodes.table("", group, classes=[kind])
    return result


def codes(names: Sequence[str]) -> nodes.paragraph:
    """Names as code, one after another."""
    paragraph = nodes.paragraph()
    for index, name in enumerate(names):
        paragraph += nodes.Text(" " if index else "")
        paragraph += nodes.literal(text=name)
    return paragraph


def links(names: Sequence[str]) -> nodes.paragraph:
    """Names of the package as small links to where they are documented."""
    paragraph = nodes.paragraph(classes=["functions"])
    for name in names:
        target = {"refdomain": "py", "reftype": "obj", "reftarget": f"shadowjax.{name}", "refexplicit": True}
        paragraph += addnodes.pending_xref("", nodes.literal(text=name), refwarn=False, **target)
        paragraph += nodes.Text(" ")
    return paragraph


def all_code(code: types.CodeType) -> Iterator[types.CodeType]:
    """A code object and those of the functions written inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from all_code(constant)


def called(route: Callable) -> Iterator[Any]:
    """What a function's byte code names: globals, closed-over values, and attributes of modules."""
    names = dict(route.__globals__)
    for name, cell in zip(route.__code__.co_freevars, route.__closure__ or (), strict=True):
        names[name] = cell.cell_contents
    for code in all_code(route.__code__):
        last: Any = None
        for step in dis.get_instructions(code):
            if step.opname in ("LOAD_GLOBAL", "LOAD_DEREF"):
                last = names.get(step.argval)
                yield last
            elif step.opname in ("LOAD_ATTR", "LOAD_METHOD") and inspect.ismodule(last):
                last = getattr(last, step.argval, None)
                yield last


def package_functions(route: Any, depth: int = 4) -> Iterator[str]:
    """Public functions and classes of the package that a ledger's route calls, through the ledger's own helpers."""
    if not inspect.isfunction(inspect.unwrap(route)) or depth == 0:
        return
    for thing in called(inspect.unwrap(route)):
        home = getattr(thing, "__module__", None) or ""
        if not (inspect.isfunction(inspect.unwrap(thing)) or inspect.isclass(thing)) or not home.startswith(
            "shadowjax."
        ):
            continue
        if ".ledger." in home:
            yield from package_functions(thing, depth - 1)
        elif not thing.__name__.startswith("_") and "._" not in home and home not in IGNORED:
            yield f"{home.removeprefix('shadowjax.')}.{thing.__name__}"


IGNORED = ("shadowjax.ledger.inputs", "shadowjax.ledger.equation")


def functions_of(equation: Equation) -> list[str]:
    """Functions of the package that an equation's closed form and its other routes call."""
    routes = (equation.closed_form, *equation.routes().values())
    return list(dict.fromkeys(itertools.chain.from_iterable(package_functions(route) for route in routes)))


class EquationTable(SphinxDirective):
    """`{equation-table} SOURCE`: every equation of one source."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Rows with one statement share a row."""
        source = self.arguments[0]
        if source not in SOURCES:
            raise self.error(f"unknown source {source!r}; use one of {', '.join(SOURCES)}")
        chosen = [equation for equation in ledger().values() if equation.id.split(".")[0] == source]
        rows = []
        for (place, statement, verdict, condition), group in itertools.groupby(
            chosen, key=lambda one: (one.source, one.statement, one.verdict, one.condition)
        ):
            equations = list(group)
            cell = nodes.container("", text(statement))
            if condition:
                cell += text(f"Condition: {condition}")
            if found := list(dict.fromkeys(itertools.chain.from_iterable(map(functions_of, equations)))):
                cell += links(found)
            kinds = [kind for kind in reversed(KINDS) if any(kind in one.routes() for one in equations)]
            ids = nodes.container("", codes([one.id for one in equations]), text(place.removeprefix(f"{source}, ")))
            mark = nodes.paragraph("", "", nodes.inline(text=verdict, classes=["verdict", verdict]))
            rows.append([ids, cell, nodes.container("", mark, text(", ".join(kinds)))])
        counts = {
            verdict: sum(one.verdict == verdict for one in chosen) for verdict in ("holds", "conditional", "erratum")
        }
        head = ["id and place", "statement, and the functions that compute it", "verdict, checks"]
        summary = text(
            f"{len(chosen)} entries: {counts['holds']} true, {counts['conditional']} true under a condition, "
            f"{counts['erratum']} errata."
        )
        return [summary, table(head, [28, 54, 18], rows, "equations")]


def shown(value: Any) -> str:
    """A value of the ledger as short text."""
    if isinstance(value, bool | str):
        return str(value)
    try:
        return f"{float(value):.10g}"
    except (TypeError, ValueError):
        return "[" + ", ".join(shown(one) for one in value) + "]"


class ErrataList(SphinxDirective):
    """`{errata-list} SOURCE`: what is printed, what is true, and inputs at which the two differ."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """A definition list; the numbers are computed here."""
        import jax

        items = []
        with jax.enable_x64(True):
            for equation in ledger().values():
                if equation.correction is None or equation.id.split(".")[0] != self.arguments[0]:
                    continue
                fix = equation.correction
                inputs = Inputs(fix.counterexample, fix.label).merged(equation.matches(equation.id) or {})
                printed, truth = fix.printed_form(inputs), (fix.corrected_form or equation.closed_form)(inputs)
                given = ", ".join(f"{name} = {shown(value)}" for name, value in inputs.items())
                body = nodes.definition(
                    "",
                    text(f"Printed: {fix.printed}"),
                    text(f"True: {fix.corrected}"),
                    text(f"Numbers{' at ' + given if given else ''}: printed {shown(printed)}, true {shown(truth)}."),
                )
                term = nodes.term("", "", nodes.literal(text=equation.id), nodes.Text(f"  {equation.source}"))
                items.append(nodes.definition_list_item("", term, body))
        if not items:
            return [text("No errata are known.")]
        return [nodes.definition_list("", *items, classes=["errata"])]


class TechniqueTable(SphinxDirective):
    """Every registered technique with what it stores, reads and can answer."""

    def run(self) -> list[nodes.Node]:
        """One row a technique, from its own filter."""
        rows = []
        for name in sj.TECHNIQUES:
            technique = sj.make_technique(name)
            tones = "a continuum" if technique.num_tones is None else str(technique.num_tones)
            filter_ = getattr(technique, "filter", None)
            stored, read, reach = (
                (f"{filter_.num_planes}", f"{filter_.num_fetches}", f"{filter_.reach:g}")
                if filter_
                else ("no map", "", "")
            )
            rows.append([codes([name]), text(stored), text(read), text(tones), text(reach)])
        head = ["name", "numbers stored a texel", "numbers read a point", "tones, at most", "reach, texels"]
        return [table(head, [28, 18, 18, 18, 18], rows, "techniques")]


class SceneTable(SphinxDirective):
    """Every built-in scene."""

    def run(self) -> list[nodes.Node]:
        """One row a family."""
        rows = []
        for family in sj.SCENES.values():
            size = f"{family.default_triangles}"
            if family.scales:
                size += f" ({family.min_triangles} to {family.max_triangles})"
            rows.append([codes([family.name]), text(family.description), text(size)])
        return [table(["name", "what it shows", "triangles"], [20, 60, 20], rows, "scenes")]


class Gallery(SphinxDirective):
    """Every experiment: its docstring, its figure and its claims, from the records in `_static/gallery`."""

    def run(self) -> list[nodes.Node]:
        """One section an experiment; a missing record is an error, so that no figure is forgotten."""
        import experiments

        found: list[nodes.Node] = []
        for name, module in experiments.EXPERIMENTS.items():
            record_file, picture = GALLERY / f"{name}.json", GALLERY / f"{name}.png"
            if not (record_file.exists() and picture.exists()):
                raise self.error(f"no figure of {name}; run: python docs/pictures.py gallery")
            self.env.note_dependency(str(record_file))
            title, _, rest = inspect.cleandoc(module.__doc__ or name).partition("\n")
            section = nodes.section(ids=[name.replace("_", "-")], names=[name])
            section += nodes.title("", title.rstrip("."))
            section += [text(" ".join(part.split())) for part in rest.strip().split("\n\n") if part.strip()]
            section += nodes.image(uri=f"/_static/gallery/{name}.png", alt=title, classes=["gallery"])
            if (GALLERY / f"{name}.gif").exists():
                section += nodes.image(
                    uri=f"/_static/gallery/{name}.gif", alt=f"{title} in motion", classes=["gallery"]
                )
            claims = json.loads(record_file.read_text())["claims"]
            rows = [[text(c["name"]), text(c["value"]), text("holds" if c["holds"] else "fails")] for c in claims]
            section += table(["claim", "found", ""], [60, 30, 10], rows, "claims")
            command = nodes.paragraph("", "", nodes.Text("Command: "))
            command += nodes.literal(text=f"python -m experiments {name}")
            section += command
            found.append(section)
        return found


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("equation-table", EquationTable)
    app.add_directive("errata-list", ErrataList)
    app.add_directive("technique-table", TechniqueTable)
    app.add_directive("scene-table", SceneTable)
    app.add_directive("experiment-gallery", Gallery)
    return {"parallel_read_safe": True}
