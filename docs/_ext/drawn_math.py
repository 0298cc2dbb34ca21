"""Formulas as inline SVG drawn by matplotlib's mathtext: no script, no font and no server when a page is read."""

import html
import re

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath
from sphinx.application import Sphinx

POINTS = 12.0  # size at which outlines are made; the page scales them with its own text
FONT = FontProperties(family="serif", math_fontfamily="cm")
COMMANDS = {Outline.MOVETO: "M", Outline.LINETO: "L", Outline.CURVE3: "Q", Outline.CURVE4: "C"}
# Words of LaTeX that mathtext spells differently, or that it does not know.
SPELLINGS = {
    r"\text": r"\mathrm",
    r"\operatorname": r"\mathrm",
    r"\le ": r"\leq ",
    r"\ge ": r"\geq ",
    r"\iff": r"\Leftrightarrow",
    # The font has no sign of degrees: its place holds a gamma.
    "°": r"^{\circ}",
    r"\lvert": "|",
    r"\rvert": "|",
}


def svg(latex: str, display: bool) -> str:
    """One formula as an SVG element whose height and baseline are in units of the surrounding text."""
    for word, spelling in SPELLINGS.items():
        latex = latex.replace(word, spelling)
    if display:
        latex = re.sub(r"\\frac\b", r"\\dfrac", latex)
    outline = TextPath((0, 0), f"${' '.join(latex.split())}$", size=POINTS, prop=FONT)
    box = outline.get_extents()
    pad = 0.06 * POINTS
    left, width = box.x0 - pad, box.width + 2 * pad
    top, height, depth = box.y1 + pad, box.height + 2 * pad, pad - box.y0
    commands = []
    for points, code in outline.iter_segments(curves=True, simplify=False):
        if code == Outline.CLOSEPOLY:
            commands.append("Z")
        else:
            pairs = points.reshape(-1, 2) * (1, -1)
            commands.append(COMMANDS[code] + " ".join(f"{x:.2f},{y:.2f}" for x, y in pairs))
    em = 1.08 / POINTS
    return (
        f'<svg class="formula" role="img" aria-label="{html.escape(latex)}" viewBox="{left:.2f} {-top:.2f} {width:.2f} '
        f'{height:.2f}" style="height:{height * em:.3f}em;vertical-align:{-depth * em:.3f}em">'
        f'<path fill="currentColor" d="{" ".join(commands)}"/></svg>'
    )


def _inline(translator, node: nodes.math) -> None:
    translator.body.append(svg(node.astext(), display=False))
    raise nodes.SkipNode


def _display(translator, node: nodes.math_block) -> None:
    label = node.get("label")
    anchor = f' id="equation-{html.escape(label)}"' if label else ""
    translator.body.append(f'<div class="formula-display"{anchor}>{svg(node.astext(), display=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer as `html_math_renderer = "drawn"`."""
    app.add_html_math_renderer("drawn", (_inline, None), (_display, None))
    return {"parallel_read_safe": True}
