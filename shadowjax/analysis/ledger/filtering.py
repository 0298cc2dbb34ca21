"""Ledger of the filtering source: percentage-closer, variance, convolution and exponential shadow maps, its tables."""

import math

from shadowjax.analysis.equations import Correction, Equation, Inputs, Unavailable
from shadowjax.analysis.ledger import _filtering_bases, _filtering_exponential, _filtering_moments

# Technique of Table 4.2 -> (bytes a texel with mip levels, bytes a texel without).
_FORMATS = {
    "PCF": (4, 0), "VSM": (8, 0), "CSM": (8 * 8, 4), "XCSM": (4, 0), "ESM": (4, 0),
    "VSM_C": (0, 8), "CSM_C": (0, 4), "XCSM_C": (0, 4), "ESM_C": (0, 4),
}  # fmt: skip
# Frames a second at 2048², 1024² ... of Tables 4.1 (plain) and 4.3 (with blur): screen -> technique -> sizes ascending.
_PLAIN = {
    "640x480": {"VSM": (62, 59, 55, 53), "CSM": (21, 19, 16, 15), "XCSM": (60, 58, 55, 53), "ESM": (62, 60, 56, 53)},
    "800x600": {"VSM": (60, 57, 54, 52), "CSM": (20, 18, 16, 15), "XCSM": (59, 57, 53, 52), "ESM": (60, 58, 54, 52)},
    "1024x768": {"VSM": (57, 53, 52, 50), "CSM": (20, 18, 17, 15), "XCSM": (57, 53, 51, 48), "ESM": (58, 53, 52, 50)},
}
_BLURRED = {
    "640x480": {"VSM": (50, 49, 46, 30), "CSM": (19, 18, 15, 14), "XCSM": (48, 48, 44, 38), "ESM": (50, 47, 45, 40)},
    "800x600": {"VSM": (48, 46, 46, 30), "CSM": (19, 17, 15, 13), "XCSM": (47, 48, 46, 38), "ESM": (48, 47, 46, 40)},
    "1024x768": {"VSM": (46, 44, 41, 29), "CSM": (19, 16, 14, 12), "XCSM": (44, 43, 42, 35), "ESM": (46, 44, 42, 37)},
}


def _formats(inputs: Inputs) -> tuple[int, int]:
    name = inputs.text("technique", inputs.label.split(",")[0].strip())
    if name not in _FORMATS:
        raise Unavailable(f"no technique {name!r} in Table 4.2; known: {', '.join(_FORMATS)}")
    return _FORMATS[name]


def _bytes(inputs: Inputs) -> int:
    """(4·res² − 1)/3 texels in a full chain of mip levels of a power-of-two map; level by level for other sizes."""
    size, (chained, single) = inputs.integer("res"), _formats(inputs)
    chain = (4 * size * size - 1) // 3 if size & (size - 1) == 0 else _chain(size)
    return chained * chain + single * size * size


def _chain(size: int) -> int:
    """Texels of all mip levels, added up."""
    total = 0
    while size:
        total += size * size
        size //= 2
    return total


def _bytes_summed(inputs: Inputs) -> int:
    size, (chained, single) = inputs.integer("res"), _formats(inputs)
    return chained * _chain(size) + single * size * size


def _printed_megabytes(inputs: Inputs) -> float:
    """As the table counts: each texture rounded up to KiB, thousands of them, three decimals."""
    size, (chained, single) = inputs.integer("res"), _formats(inputs)
    each = [chained] if chained <= 8 else [8] * (chained // 8)
    kib = sum(math.ceil(one * _chain(size) / 1024) for one in each) + math.ceil(single * size * size / 1024)
    return kib / 1000


def _printed_from_bytes(inputs: Inputs) -> float:
    """Bytes over 1 024 000, each texture's last KiB filled: within one KiB a texture of the exact size."""
    return _bytes(inputs) / 1_024_000


def _outside(inputs: Inputs) -> int:
    """Cells whose loss of frames by blurring lies outside 10 to 20 %."""
    low, high = inputs.fraction("low"), inputs.fraction("high")
    losses = [
        1 - inputs.fraction("one") * after / before
        for screen, techniques in _PLAIN.items()
        for name, frames in techniques.items()
        for before, after in zip(frames, _BLURRED[screen][name], strict=True)
    ]
    return sum(not low <= loss <= high for loss in losses)


def _outside_counted(inputs: Inputs) -> int:
    """The same with frames compared in whole numbers, cell by cell."""
    low, high, count = inputs.fraction("low"), inputs.fraction("high"), 0
    for screen, techniques in _PLAIN.items():
        for name, frames in techniques.items():
            for before, after in zip(frames, _BLURRED[screen][name], strict=True):
                count += before - after < low * before or before - after > high * before
    return count


EQUATIONS: tuple[Equation, ...] = (
    *_filtering_moments.EQUATIONS,
    *_filtering_bases.EQUATIONS,
    *_filtering_exponential.EQUATIONS,
    Equation(
        id="filtering.Tab4.2.bytes",
        source="filtering, Table 4.2",
        statement="Bytes of a technique's maps: mip chains of its formats, an auxiliary map without mips.",
        verdict="holds",
        closed_form=_bytes,
        derived=_bytes_summed,
        samples=tuple(({"res": size}, f"{name},{size}") for name in _FORMATS for size in (256, 2048)),
    ),
    Equation(
        id="filtering.Tab4.2.megabytes",
        source="filtering, Table 4.2",
        statement="The table's numbers are thousands of KiB, each texture rounded up to a KiB.",
        verdict="erratum",
        closed_form=_printed_megabytes,
        derived=_printed_from_bytes,
        tolerance=5e-3,  # at most one KiB for each of nine textures
        correction=Correction(
            printed="the auxiliary map of CSM at 256² takes 0.512",
            corrected="0.256; the printed cell is that of VSM",
            printed_form=lambda i: 0.512,
            counterexample={"res": 256},
            label="CSM_C,256",
        ),
        samples=tuple(({"res": size}, f"{name},{size}") for name in _FORMATS for size in (256, 2048)),
    ),
    Equation(
        id="filtering.Tab4.3.outside",
        source="filtering, Tables 4.1 and 4.3",
        statement="Cells in which blurring costs less than 10 % or more than 20 % of the frames.",
        verdict="erratum",
        closed_form=_outside,
        derived=_outside_counted,
        correction=Correction(
            printed="blurring costs about 10 to 20 % of the frames",
            corrected="22 of 48 cells lie outside; up to 43 %",
            printed_form=lambda i: 0,
            counterexample={"low": "0.1", "high": "0.2", "one": 1},
        ),
        samples=({"low": "0.1", "high": "0.2", "one": 1},),
    ),
)
