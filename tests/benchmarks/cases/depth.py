"""Depth maps, alone and with the triangle hit, over triangles, resolutions and projections."""

from typing import Any

from tests.benchmarks.peers.base import Contestant
from tests.benchmarks.scenes import Geometry, View, view
from tests.benchmarks.session import Session, agreement
from tests.benchmarks.timing import resident_growth, timed

# Comparing pictures takes longer than casting them; larger ones are not compared.
MOST_COMPARED = 1 << 20


def run_depth(session: Session) -> None:
    """Depth alone: every size at every resolution, and every file at one."""
    for size in session.sizes:
        measure(session, "depth", session.geometry(size), session.resolutions, False)
    for geometry in session.file_geometries():
        measure(session, "depth", geometry, (session.resolution,), False)


def run_faces(session: Session) -> None:
    """Depth and triangle: every size and file at one resolution."""
    for geometry in [*map(session.geometry, session.sizes), *session.file_geometries()]:
        measure(session, "faces", geometry, (session.resolution,), True)


def measure(session: Session, case: str, geometry: Geometry, resolutions: tuple[int, ...], with_face: bool) -> None:
    """Build once for the mesh, then cast all its views."""
    built = {}
    for contestant in session.contestants:
        _, built[contestant.name] = timed(lambda contestant=contestant: contestant.prepare(geometry))
    for resolution in resolutions:
        for projection in session.projections:
            session.say(f"{case}, {geometry.name}, {resolution}², {projection}")
            shown = view(geometry, projection, resolution)
            taking_part = able(session.contestants, resolution)
            loaded = {c.name: c.load_view(shown) for c in taking_part}
            beside = warm_up(taking_part, loaded, geometry, shown, with_face)
            for name, entry in beside.items():
                entry["build_ms"] = built[name]
            calls = {
                c.name: lambda step, c=c: c.cast(loaded[c.name], with_face)  # noqa: B023
                for c in taking_part
            }
            session.measure(case, geometry, shown, calls, beside)


def able(contestants: list[Contestant], resolution: int) -> list[Contestant]:
    """Those that are fast enough for so many rays."""
    return [contestant for contestant in contestants if resolution**2 <= contestant.most_rays]


def warm_up(
    contestants: list[Contestant], loaded: dict[str, Any], geometry: Geometry, shown: View, with_face: bool
) -> dict[str, dict[str, Any]]:
    """Compile and cast once, and compare the pictures with the first contestant's.

    Returns:
        For each name what compiling took, growth of the process in megabytes, and the differences.
    """
    beside: dict[str, dict[str, Any]] = {}
    reference = None
    for contestant in contestants:
        rays = loaded[contestant.name]
        entry: dict[str, Any] = contestant.compile(rays, with_face)
        result, entry["resident_mb"] = resident_growth(lambda c=contestant, rays=rays: c.cast(rays, with_face))
        if shown.grid.num_rows * shown.grid.num_cols <= MOST_COMPARED:
            picture = contestant.read(result, shown)
            reference = picture if reference is None else reference
            entry |= agreement(*picture, reference, geometry.radius)
        beside[contestant.name] = entry
    return beside
