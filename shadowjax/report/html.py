"""Small pieces of HTML: escaped text, elements, tables, pictures as data inside the page."""

import base64
import html
from collections.abc import Iterable, Sequence

from shadowjax._printable import printable
from shadowjax.io import Pixels, png_bytes
from shadowjax.plotting import Figure, figure_png


def text(value: object) -> str:
    """Any value as text that cannot break out of an element or an attribute, nor steer what shows it."""
    return html.escape(printable(str(value), keep="\n\t"), quote=True)


def element(name: str, *children: str, **attributes: object) -> str:
    """An element whose children are HTML already; attribute values are escaped, `class_` is `class`."""
    given = "".join(f' {key.rstrip("_").replace("_", "-")}="{text(value)}"' for key, value in attributes.items())
    return f"<{name}{given}>{''.join(children)}</{name}>"


def data_uri(png: bytes) -> str:
    """The bytes of a PNG file as an address that holds them."""
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def picture(png: bytes, alternative: str, **attributes: object) -> str:
    """A PNG file inside the page.

    Args:
        png: Its bytes.
        alternative: What it shows, for those who cannot see it.
        attributes: Further attributes.
    """
    given = "".join(f' {key.rstrip("_").replace("_", "-")}="{text(value)}"' for key, value in attributes.items())
    return f'<img src="{data_uri(png)}" alt="{text(alternative)}"{given}>'


def pixels(array: Pixels, alternative: str, **attributes: object) -> str:
    """An array of pixels as a picture inside the page."""
    return picture(png_bytes(array), alternative, **attributes)


def chart(drawn: Figure, alternative: str) -> str:
    """A chart as a picture inside the page."""
    return picture(figure_png(drawn), alternative)


def figure(content: str, title: str, caption: str = "", **attributes: object) -> str:
    """A picture with its title and a caption that says what to look at; title and caption are plain text."""
    body = element("strong", text(title)) + (f" {text(caption)}" if caption else "")
    return element("figure", content, element("figcaption", body), **attributes)


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    numeric: Iterable[int] = (),
    strong: Iterable[int] = (),
    caption: str = "",
) -> str:
    """A table of plain values.

    Args:
        columns: Heads.
        rows: Values, as many as columns; a value of type `Markup` is HTML already.
        numeric: Columns to align right.
        strong: Rows to set off.
        caption: Under the table.
    """
    right, set_off = set(numeric), set(strong)

    def cell(tag: str, index: int, value: object) -> str:
        content = value.html if isinstance(value, Markup) else text(value)
        return element(tag, content, **({"class_": "number"} if index in right else {}))

    head = element("tr", *(cell("th", i, name) for i, name in enumerate(columns)))
    body = "".join(
        element(
            "tr",
            *(cell("td", i, value) for i, value in enumerate(row)),
            **({"class_": "chosen"} if n in set_off else {}),
        )
        for n, row in enumerate(rows)
    )
    under = element("p", text(caption), class_="note") if caption else ""
    return element("div", element("table", element("thead", head), element("tbody", body)), class_="scroll") + under


class Markup:
    """HTML that is to be taken as it is."""

    def __init__(self, content: str):
        self.html = content


def badge(word: str, kind: str) -> Markup:
    """A short word in a coloured pill; `kind` is good, note or bad."""
    return Markup(element("span", text(word), class_=f"badge {kind}"))


def section(identifier: str, title: str, lead: str, *children: str) -> str:
    """A part of the page with a heading and a sentence in plain text that says what it is about."""
    start = [element("h2", text(title)), element("p", text(lead), class_="lead")]
    return element("section", *start, *children, id=identifier)
