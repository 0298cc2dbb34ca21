"""Docstrings are plain text with `code` in single backticks: make them safe for reStructuredText before Napoleon."""

import re
from typing import Any

from sphinx.application import Sphinx

CODE = re.compile(r"(``[^`]+``|`[^`]+`|(?<![\w*\"'])\*[A-Za-z][^*]*[A-Za-z]\*(?![\w*]))")
# What a signature shows of the package's ArrayLike, with or without the modules of its parts.
PARTS = ("Array", "ndarray", "bool", "number", "bool", "int", "float", "complex", r"Sequence\[[\w.~]*Any\]")
ARRAY_LIKE = re.compile(r" \| ".join(rf"[\w.~]*{part}" for part in PARTS))


def to_rst(line: str) -> str:
    """One line with code in double backticks, *emphasis* kept, and all else that would be read as markup escaped."""
    parts = CODE.split(line)
    for index, part in enumerate(parts):
        if index % 2:
            parts[index] = part if part.startswith("*") else f"``{part.strip('`')}``"
        else:
            escaped = re.sub(r"([*|`])", r"\\\1", part)
            parts[index] = re.sub(r"(?<=\w)_(?!\w)", r"\\_", escaped)
    return "".join(parts)


def _process(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [to_rst(line) for line in lines]


def _escape_types(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Types of attributes, which Napoleon reads off annotations, hold shapes such as "*points 3"."""
    lines[:] = [short_types(line).replace("*", r"\*") if line.startswith(":vartype") else line for line in lines]


def short_types(words: str) -> str:
    """Annotations as they are written in the code: Float[Array, "*points 3"]."""
    words = words.replace("jaxtyping.", "").replace("jaxlib._jax.", "").replace("jax.Array", "Array")
    return ARRAY_LIKE.sub("ArrayLike", words)


def _shorten_signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    return signature and short_types(signature), returns and short_types(returns)


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen before and after Napoleon, whose priority is 500."""
    app.connect("autodoc-process-docstring", _process, priority=400)
    app.connect("autodoc-process-docstring", _escape_types, priority=600)
    app.connect("autodoc-process-signature", _shorten_signature)
    return {"parallel_read_safe": True}
