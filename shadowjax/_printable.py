"""Text as a screen can show it: no control characters of a stranger's file name, and words for signs it lacks."""

import codecs
import json

APPROXIMATE = "shadowjax.approximate"  # an error handler for encodings, as in `text.encode("ascii", APPROXIMATE)`

_IN_ASCII = {
    "×": "x", "·": "-", "…": "...", "–": "-", "—": "-", "−": "-", "→": "->", "≤": "<=", "≥": ">=", "≈": "~", "²": "^2",
    "³": "^3", "½": "1/2", "°": " deg", "∞": "inf", "√": "sqrt", "φ": "phi", "γ": "gamma", "α": "alpha", "β": "beta",
    "θ": "theta", "π": "pi", "│": "|", "─": "-", "╭": "+", "╮": "+", "╰": "+", "╯": "+",
}  # fmt: skip


def _approximation(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_IN_ASCII.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


codecs.register_error(APPROXIMATE, _approximation)


def approximate(text: str, encoding: str) -> str:
    """The text in the signs of an encoding: `512²` is `512^2` in ASCII, and `?` stands for what has no likeness."""
    return text.encode(encoding, APPROXIMATE).decode(encoding)


def printable(text: str, keep: str = "") -> str:
    r"""The text with every control, format and stray character spelled out, as `\x1b` or `\u202e`.

    A file name may hold anything: sequences that move the cursor, new lines, marks that turn the direction of reading,
    bytes that are no text.

    Args:
        text: Anything.
        keep: Characters that stay as they are, such as new lines.
    """
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign in keep else _escape(sign) for sign in text)


def one_line(text: str) -> str:
    """The text on one line, in printable characters."""
    return printable(" ".join(text.split()))


def _escape(sign: str) -> str:
    code = ord(sign)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def printable_json(content: str) -> str:
    r"""JSON whose strings spell such characters out, as `\u001b`: every reader gets the same value."""
    if content.replace("\n", "").isprintable():
        return content
    return "".join(sign if sign.isprintable() or sign == "\n" else json.dumps(sign)[1:-1] for sign in content)
