"""The cases by name, in the order they run: each takes a session and adds records to it."""

from collections.abc import Callable

from tests.benchmarks.cases import depth, gradient, moving, multi_depth, visibility
from tests.benchmarks.session import Session

CASES: dict[str, Callable[[Session], None]] = {
    "depth": depth.run_depth,
    "faces": depth.run_faces,
    "new-view": moving.run_new_view,
    "new-vertices": moving.run_new_vertices,
    "visibility": visibility.run,
    "multi-depth": multi_depth.run,
    "gradient": gradient.run,
}
