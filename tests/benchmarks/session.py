"""One run: who takes part, at which sizes, and the records that it collects."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.benchmarks.ours import Shadowjax
from tests.benchmarks.peers.base import Contestant
from tests.benchmarks.scenes import Geometry, View, from_file, sphere_over_plane
from tests.benchmarks.timing import interleave

# A depth counts as different from ours beyond this part of the scene's radius.
DIFFERS = 1e-3


@dataclass
class Session:
    """Contestants and sizes of a run.

    Attributes:
        ours: Ways to run the package; the first is what ratios refer to.
        peers: The other programs.
        sizes: Names of the displaced spheres of the depth maps.
        middle_sizes: Names of those that the slower cases use.
        resolutions: Cells along each side of a depth map.
        resolution: Of the cases that have one.
        projections: Kinds of views of a depth map; shadow tests have a light of the first and a camera of the last.
        rounds: Timed calls of each contestant.
        files: Meshes given, measured as further depth maps.
        say: Told what happens now.
        records: What has been measured: one for each case, mesh, view and resolution.
    """

    ours: list[Shadowjax]
    peers: list[Contestant]
    sizes: tuple[str, ...]
    middle_sizes: tuple[str, ...]
    resolutions: tuple[int, ...]
    resolution: int
    projections: tuple[str, ...]
    rounds: int
    files: tuple[str, ...] = ()
    say: Callable[[str], None] = print
    records: list[dict[str, Any]] = field(default_factory=list)
    _geometries: dict[str, Geometry] = field(default_factory=dict)

    @property
    def contestants(self) -> list[Contestant]:
        """Everybody, ours first."""
        return [*self.ours, *self.peers]

    def geometry(self, size: str) -> Geometry:
        """A displaced sphere over its plane, made once."""
        if size not in self._geometries:
            self._geometries[size] = sphere_over_plane(size)
        return self._geometries[size]

    def file_geometries(self) -> Iterable[Geometry]:
        """The meshes of the files given."""
        return (from_file(path) for path in self.files)

    def measure(
        self,
        case: str,
        geometry: Geometry,
        view: View,
        calls: Mapping[str, Callable[[int], Any]],
        beside: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> dict[str, Any]:
        """Time calls that are warm, compare them with ours, and keep the record.

        Args:
            case: Name of the case.
            geometry: What is cast.
            view: The rays.
            calls: Work by name of contestant; the first is what ratios refer to.
            next to: Further figures by name of contestant.
        """
        times = interleave(calls, self.rounds)
        first = next(iter(times.values()))["median_ms"]
        for name, entry in times.items():
            entry["ratio"] = entry["median_ms"] / first
            entry.update((beside or {}).get(name, {}))
        record = {
            "case": case,
            "mesh": geometry.name,
            "triangles": geometry.num_faces,
            "projection": view.projection,
            "rows": view.grid.num_rows,
            "columns": view.grid.num_cols,
            "contestants": times,
        }
        self.records.append(record)
        return record


def agreement(
    depth: np.ndarray, face: np.ndarray | None, reference: tuple[np.ndarray, np.ndarray | None], radius: float
) -> dict[str, float]:
    """How a depth map differs from another one: a median in parts of the radius, and per cents of its cells.

    Args:
        depth: Distance along each ray, infinite for a miss.
        face: Triangles, if known.
        reference: Depth and triangles to compare with.
        radius: Of the scene.
    """
    both = np.isfinite(depth) & np.isfinite(reference[0])
    difference = np.abs(np.subtract(depth, reference[0], out=np.zeros(depth.shape), where=both)) / radius
    one_only = np.isfinite(depth) != np.isfinite(reference[0])
    result = {
        "depth_median_difference": float(np.median(difference[both])) if both.any() else 0.0,
        "depth_differs_percent": float(100 * np.mean((difference > DIFFERS) | one_only)),
    }
    if face is not None and reference[1] is not None:
        result["face_differs_percent"] = float(100 * np.mean(face != reference[1]))
    return result
