"""What a comparison says: one record for each technique, and the table of all of them."""

import dataclasses
import importlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shadowjax import io
from shadowjax._checked import checked
from shadowjax._checks import require
from shadowjax.evaluate.slope_limits import SlopeLimit


@checked
@dataclass(frozen=True)
class Record:
    """How one technique did on one view.

    Args:
        technique: Its name: registered, composed, or of one's own.
        rmse: Root mean squared error of visibility over valid receivers.
        mean_abs_error: Mean absolute error; the sum of the next two.
        false_lit: Area fraction of valid receivers that is lit and should not be; partly lit pixels count in part.
        false_shadow: Area fraction that is in shadow and should not be.
        tones: Distinct visibilities counted among valid samples.
        tones_bound: Most that the technique can give; None for a continuum.
        map_bytes: Bytes of all stored planes.
        build_ms: Time to build the maps, milliseconds: warm median.
        visibility_ms: Time to look up every sample of the picture, milliseconds: warm median.
        psnr: Peak signal-to-noise ratio of visibility, dB; the dtype's ceiling for a perfect picture.
        ssim: Structural similarity of visibility; None for pictures smaller than its window.
        edge_distance: Mean distance between the technique's shadow edges and the exact ones, pixels.
        light_rmse: Root mean squared error of the light that a surface receives, relative to the mean of its square
            without shadows: visibility weighted by the cosine of incidence. Errors at grazing light hardly show.
        bleed: Mean light in the umbra, where the exact shadow is full and no edge of it is near: light that leaks.
        acne: Mean lack of light where the exact picture is fully lit and no shadow edge is near.
        flip: FLIP error of visibility; None where the package `flip_evaluator` is missing.
        texture_bytes: Bytes of textures of four channels or fewer that would hold the planes; three take four.
        slope_limit: Acne that the limit of the slope bias leaves at grazing light; None where there is none.
        volume_bytes: Bytes of what shadow volumes keep in place of a map: quads, and a stencil buffer of every sample.
    """

    technique: str
    rmse: float
    mean_abs_error: float
    false_lit: float
    false_shadow: float
    tones: int
    tones_bound: int | None
    map_bytes: int
    build_ms: float
    visibility_ms: float
    psnr: float
    ssim: float | None
    edge_distance: float
    light_rmse: float
    bleed: float = 0.0
    acne: float = 0.0
    flip: float | None = None
    texture_bytes: int = 0
    volume_bytes: int = 0
    slope_limit: SlopeLimit | None = None

    @property
    def stored_bytes(self) -> int:
        """Bytes of maps and volumes."""
        return self.map_bytes + self.volume_bytes

    def to_json(self) -> dict[str, Any]:
        """The record as plain values."""
        return dataclasses.asdict(self)


@checked
@dataclass(frozen=True)
class Table:
    """Records of several techniques on one view; prints as a table.

    Args:
        records: One for each technique, in the order asked for.
        scene: Name of the scene.
    """

    records: tuple[Record, ...]
    scene: str = ""

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, which: int | str) -> Record:
        """A record by its place or by the name of its technique.

        Raises:
            ValueError: If no technique has that name.
        """
        if isinstance(which, int):
            return self.records[which]
        found = [record for record in self.records if record.technique == which]
        names = ", ".join(record.technique for record in self.records)
        require(bool(found), f"no technique of this table is called {which!r}; it has {names}")
        return found[0]

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Every record as plain values, by the name of its technique."""
        return {record.technique: record.to_json() for record in self.records}

    def to_json(self, path: str | Path) -> Path:
        """Write a list of one record a technique, as `shadowjax compare --json` does.

        Args:
            path: File to write, or to replace.

        Raises:
            ValueError: If it cannot be written.
        """
        return io.write_json(path, [record.to_json() for record in self.records])

    def to_pandas(self) -> Any:
        """A pandas DataFrame with a row for each technique.

        Raises:
            ValueError: If pandas is not installed: it comes with the extra `tables`.
        """
        try:
            pandas: Any = importlib.import_module("pandas")
        except ImportError as error:
            raise ValueError("to_pandas needs pandas: pip install 'shadowjax[tables]'") from error
        return pandas.DataFrame([record.to_json() for record in self.records]).set_index("technique")

    def __str__(self) -> str:
        """Light error, RMS error, tones, bytes and milliseconds, the least error first."""
        rows = [("technique", "light error", "RMS error", "tones", "KiB", "build ms", "lookup ms")]
        for one in sorted(self.records, key=lambda record: record.light_rmse):
            rows.append((
                one.technique, f"{100 * one.light_rmse:.2f} %", f"{one.rmse:.4f}", str(one.tones),
                f"{one.stored_bytes / 1024:.1f}", f"{one.build_ms:.1f}", f"{one.visibility_ms:.1f}",
            ))  # fmt: skip
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join(
            "  ".join(cell.rjust(width) if index else cell.ljust(width) for index, (cell, width) in enumerate(pairs))
            for pairs in (list(zip(row, widths, strict=True)) for row in rows)
        )


__all__ = ["Record", "Table"]
