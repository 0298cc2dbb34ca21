"""`{capability-table}`: what the gradient of every technique sees, from the package's own table."""

from docutils import nodes
from ledger_tables import codes, table, text
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from shadowjax.evaluate.capability import GRADES, PARAMETERS, capability_table


class CapabilityTable(SphinxDirective):
    """One row for each group of techniques with the same grades, then what grades mean."""

    def run(self) -> list[nodes.Node]:
        """Techniques that agree in every column share a row."""
        groups: dict[tuple[str, ...], list[str]] = {}
        for name, row in capability_table().items():
            groups.setdefault(tuple(row.values()), []).append(name)
        rows = [
            [codes(names), *(text("" if grade == "none" else grade) for grade in grades)]
            for grades, names in groups.items()
        ]
        meanings = nodes.definition_list(
            "",
            *(
                nodes.definition_list_item(
                    "",
                    nodes.term("", nodes.Text("(empty)" if grade == "none" else grade)),
                    nodes.definition("", text(said)),
                )
                for grade, said in GRADES.items()
            ),
        )
        return [
            table(["technique or function", *PARAMETERS], [28, *[9] * len(PARAMETERS)], rows, "grades"),
            meanings,
        ]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("capability-table", CapabilityTable)
    return {"parallel_read_safe": True}
