"""Ledger of the filtering source: percentage-closer, variance, convolution and exponential shadow maps, its tables."""

import math
from fractions import Fraction

from shadowjax.ledger.equation import Correction, Equation, Inputs, Unavailable
from shadowjax.ledger.filtering import applied, bases, exponential, limits, moments
from shadowjax.theory import memory

# Technique of Table 4.2 -> (bytes a texel with mip levels, bytes a texel without), as its text says.
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


def _name(inputs: Inputs) -> str:
    name = inputs.text("technique", inputs.label.split(",")[0].strip())
    if name not in _FORMATS:
        raise Unavailable(f"no technique {name!r} in Table 4.2; known: {', '.join(_FORMATS)}")
    return name


def _textures(inputs: Inputs) -> tuple[memory.Texture, ...]:
    """Textures of a technique, or of its temporary map "C"."""
    technique, _, scratch = _name(inputs).partition("_")
    storage = memory.SOURCE_STORAGE[technique.lower()]
    return storage.scratch if scratch else storage.textures


def _bytes(inputs: Inputs) -> int:
    return memory.Storage(_textures(inputs)).num_bytes(inputs.integer("res"))


def _bytes_closed(inputs: Inputs) -> int | None:
    """(4·res² − 1)/3 texels in a full chain of mip levels of a power-of-two map."""
    size, (chained, single) = inputs.integer("res"), _FORMATS[_name(inputs)]
    return None if size & (size - 1) else chained * (4 * size * size - 1) // 3 + single * size * size


def _planes_counted(inputs: Inputs) -> int:
    """Bytes of every texel of every level, channels without a plane included where three are left over."""
    planes, size = inputs.integer("planes"), inputs.integer("res")
    channels = planes + (planes % 4 == 3)
    levels = range(size.bit_length()) if inputs["mips"] else (0,)
    return sum(channels * inputs.integer("bits") // 8 * (size >> level) ** 2 for level in levels)


def _megabytes(inputs: Inputs) -> float:
    return memory.source_megabytes(_textures(inputs), inputs.integer("res"))


def _pages(inputs: Inputs) -> Fraction:
    """Thousands of pages of a KiB that the textures of a technique begin, texture by texture and level by level."""
    size, (chained, single) = inputs.integer("res"), _FORMATS[_name(inputs)]
    levels = [size >> level for level in range(size.bit_length())]
    # Textures of at most 8 bytes a texel, as the source keeps them, each rounded up alone.
    each = [chained] if chained <= 8 else [8] * (chained // 8)
    sizes = [sum(one * level * level for level in levels) for one in each] + [single * size * size]
    return Fraction(sum(len(range(0, count, 1024)) for count in sizes), 1000)


def _wrong_cells(inputs: Inputs) -> list[str]:
    return [f"{column} {resolution}" for resolution, column, *_ in memory.wrong_cells()]


def _wrong_pages(inputs: Inputs) -> list[str]:
    """Cells of the printed table that are not the pages counted, to three decimals."""
    wrong = []
    for resolution, row in memory.PRINTED_TABLE.items():
        for column, printed in zip(memory.TABLE_COLUMNS, row, strict=True):
            technique, _, scratch = column.partition(" ")
            counted = _pages(Inputs({"res": resolution, "technique": technique.upper() + ("_C" if scratch else "")}))
            if round(counted * 1000) != round(Fraction(str(printed)) * 1000):
                wrong.append(f"{column} {resolution}")
    return wrong


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


def _outside_ranges(inputs: Inputs) -> int:
    """All cells less those whose blurred frames are a whole number in the range that the plain frames allow."""
    low, high, one = (inputs.fraction(name) for name in ("low", "high", "one"))
    cells = [
        (before, after)
        for screen, techniques in _PLAIN.items()
        for name, frames in techniques.items()
        for before, after in zip(frames, _BLURRED[screen][name], strict=True)
    ]
    allowed = {
        before: range(math.ceil((one - high) * before), math.floor((one - low) * before) + 1) for before, _ in cells
    }
    return len(cells) - sum(after in allowed[before] for before, after in cells)


EQUATIONS: tuple[Equation, ...] = (
    *moments.EQUATIONS,
    *bases.EQUATIONS,
    *exponential.EQUATIONS,
    *limits.EQUATIONS,
    *applied.EQUATIONS,
    Equation(
        id="filtering.Tab4.2.bytes",
        source="filtering, Table 4.2",
        statement="Bytes of a technique's maps: mip chains of its formats, an auxiliary map without mips.",
        verdict="holds",
        closed_form=_bytes,
        independent=_bytes_closed,
        samples=tuple(({"res": size}, f"{name},{size}") for name in _FORMATS for size in (256, 2048)),
    ),
    Equation(
        id="filtering.Tab4.2.blurred",
        source="filtering, Table 4.2",
        statement="Bytes of a technique with the temporary map of its blur.",
        verdict="holds",
        closed_form=lambda i: memory.SOURCE_STORAGE[_name(i).lower()].num_bytes(i.integer("res"), blurred=True),
        independent=lambda i: sum(_bytes_closed(Inputs(i, _name(i) + end)) or 0 for end in ("", "_C")),
        samples=tuple(({"res": 512}, f"{name},512") for name in ("VSM", "CSM", "ESM")),
    ),
    Equation(
        id="filtering.Tab4.2.planes",
        source="filtering, Table 4.2",
        statement="Bytes of planes in textures of four channels, the rest in one of one, two or four.",
        verdict="holds",
        closed_form=lambda i: memory.Storage(
            memory.planes_in_formats(i.integer("planes"), i.integer("bits"), i["mips"])
        ).num_bytes(i.integer("res")),
        independent=_planes_counted,
        samples=tuple(
            {"planes": planes, "bits": bits, "mips": mips, "res": 64}
            for planes, bits, mips in ((1, 32, False), (3, 16, True), (6, 8, True), (7, 32, False), (8, 16, True))
        ),
    ),
    Equation(
        id="filtering.Tab4.2.megabytes",
        source="filtering, Table 4.2",
        statement="The table's numbers are thousands of KiB, each texture rounded up to a KiB.",
        verdict="erratum",
        closed_form=_megabytes,
        independent=_pages,
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
        id="filtering.Tab4.2.wrong_cells",
        source="filtering, Table 4.2",
        statement="Cells of the printed table that its formats do not give.",
        verdict="holds",
        closed_form=_wrong_cells,
        independent=_wrong_pages,
        samples=({},),
    ),
    Equation(
        id="filtering.Tab4.3.outside",
        source="filtering, Tables 4.1 and 4.3",
        statement="Cells in which blurring costs less than 10 % or more than 20 % of the frames.",
        verdict="erratum",
        closed_form=_outside,
        independent=_outside_ranges,
        correction=Correction(
            printed="blurring costs about 10 to 20 % of the frames",
            corrected="22 of 48 cells lie outside; up to 43 %",
            printed_form=lambda i: 0,
            counterexample={"low": "0.1", "high": "0.2", "one": 1},
        ),
        samples=({"low": "0.1", "high": "0.2", "one": 1},),
    ),
)
