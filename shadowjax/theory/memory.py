"""Memory of shadow maps from texture formats: channels, bits, mip chains and temporary textures; the source's table."""

from dataclasses import dataclass

from shadowjax._checked import checked
from shadowjax._checks import require, require_choice, require_int

CHANNELS = {"R": 1, "RG": 2, "RGBA": 4}
BITS = (8, 16, 32)


@checked
@dataclass(frozen=True)
class Texture:
    """One texture of a technique.

    Attributes:
        channels: "R", "RG" or "RGBA".
        bits: Of a channel: 8, 16 or 32.
        mips: Whether it has all smaller levels, down to 1 × 1.
        count: How many of them there are, ≥ 1.
    """

    channels: str
    bits: int
    mips: bool = True
    count: int = 1

    def __post_init__(self) -> None:
        require_choice(self.channels, "channels", CHANNELS)
        require_choice(self.bits, "bits", BITS)
        require_int(self.count, "count", 1)

    def num_bytes(self, resolution: int) -> int:
        """Bytes of all of them at a resolution × resolution base level."""
        side = require_int(resolution, "resolution", 1)
        texels = side**2
        while self.mips and side > 1:
            # Each mip level halves the side and rounds down, to 1 × 1.
            side //= 2
            texels += side**2
        return self.count * texels * CHANNELS[self.channels] * self.bits // 8


@checked
@dataclass(frozen=True)
class Storage:
    """Textures that a technique keeps, and the temporary ones of its blur.

    Attributes:
        textures: Kept.
        scratch: The temporary texture of a separable blur.
    """

    textures: tuple[Texture, ...]
    scratch: tuple[Texture, ...] = ()

    def num_bytes(self, resolution: int, blurred: bool = False) -> int:
        """Bytes kept, with those of the blur's temporary texture if it is blurred."""
        counted = self.textures + (self.scratch if blurred else ())
        return sum(texture.num_bytes(resolution) for texture in counted)


_DEPTH, _TWO = Texture("R", 32), Texture("RG", 32)
_DEPTH_ONCE, _TWO_ONCE = Texture("R", 32, mips=False), Texture("RG", 32, mips=False)

# The source's techniques in its formats; CSM with M = 16 keeps 32 basis images in eight textures of four channels and
# blurs the depth map before it makes them.
SOURCE_STORAGE: dict[str, Storage] = {
    "pcf": Storage((_DEPTH,)),
    "vsm": Storage((_TWO,), (_TWO_ONCE,)),
    "csm": Storage((Texture("RGBA", 16, count=8), _DEPTH_ONCE), (_DEPTH_ONCE,)),
    "xcsm": Storage((_DEPTH,), (_DEPTH_ONCE,)),
    "esm": Storage((_DEPTH,), (_DEPTH_ONCE,)),
}


@checked
def convolution_textures(num_terms: int) -> int:
    """Textures of four channels that hold the 2M basis images of a convolution shadow map. Source: filtering, 2.4.1."""
    return -(-2 * require_int(num_terms, "the number of terms M", 1) // 4)


@checked
def source_megabytes(textures: tuple[Texture, ...], resolution: int) -> float:
    """Memory as the source counts it: every texture rounded up to whole KiB, in units of 1024 · 1000 bytes.

    Source: filtering, table 4.2. Its unit is neither a megabyte (10⁶) nor a mebibyte (2²⁰).
    """
    kibibytes = 0
    for texture in textures:
        each = Texture(texture.channels, texture.bits, texture.mips).num_bytes(resolution)
        # Ceiling division by negation; each texture of a group begins pages of its own.
        kibibytes += texture.count * -(-each // 1024)
    return kibibytes / 1000


# Table 4.2 of the source as printed: rows 256² to 2048²; PCF, then each technique and its temporary texture "C".
TABLE_SIZES = (256, 512, 1024, 2048)
TABLE_COLUMNS = ("pcf", "vsm", "vsm C", "csm", "csm C", "xcsm", "xcsm C", "esm", "esm C")
PRINTED_TABLE: dict[int, tuple[float, ...]] = {
    256: (0.342, 0.683, 0.512, 5.720, 0.512, 0.342, 0.256, 0.342, 0.256),
    512: (1.366, 2.731, 2.048, 22.872, 1.024, 1.366, 1.024, 1.366, 1.024),
    1024: (5.462, 10.923, 8.192, 91.480, 4.096, 5.462, 4.096, 5.462, 4.096),
    2048: (21.846, 43.691, 32.768, 365.912, 16.384, 21.846, 16.384, 21.846, 16.384),
}


def source_table() -> dict[int, tuple[float, ...]]:
    """Table 4.2 computed from formats; it differs from the printed one in "csm C" at 256², where 0.256 is right."""
    rows = {}
    for resolution in TABLE_SIZES:
        cells = []
        for column in TABLE_COLUMNS:
            name, _, scratch = column.partition(" ")
            storage = SOURCE_STORAGE[name]
            cells.append(source_megabytes(storage.scratch if scratch else storage.textures, resolution))
        rows[resolution] = tuple(cells)
    return rows


def wrong_cells() -> list[tuple[int, str, float, float]]:
    """Cells of the printed table that formats do not give: (resolution, column, printed, computed)."""
    computed = source_table()
    return [
        (resolution, column, printed, value)
        for resolution, row in PRINTED_TABLE.items()
        for column, printed, value in zip(TABLE_COLUMNS, row, computed[resolution], strict=True)
        if abs(printed - value) > 5e-4
    ]


@checked
def planes_in_formats(num_planes: int, bits: int = 32, mips: bool = False) -> tuple[Texture, ...]:
    """Textures that hold a number of planes: four channels each, and one of one, two or four for the rest.

    Args:
        num_planes: Numbers stored for each texel, ≥ 0.
        bits: Of a channel: 8, 16 or 32.
        mips: Whether each has a mip chain.
    """
    require(num_planes >= 0, f"the number of planes must not be negative; got {num_planes}")
    full, rest = divmod(num_planes, 4)
    textures = (Texture("RGBA", bits, mips, full),) if full else ()
    if rest:
        textures += (Texture({1: "R", 2: "RG", 3: "RGBA"}[rest], bits, mips),)
    return textures


__all__ = [
    "PRINTED_TABLE", "SOURCE_STORAGE", "TABLE_COLUMNS", "TABLE_SIZES", "Storage", "Texture", "convolution_textures",
    "planes_in_formats", "source_megabytes", "source_table", "wrong_cells",
]  # fmt: skip
