"""The protocol of a contestant: take a mesh, take a view, cast it; everything but the cast can be left untimed."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests.benchmarks.scenes import Geometry, View


class Absent(Exception):
    """This contestant cannot run here; the message says what is missing."""


@dataclass(frozen=True)
class Segments:
    """Rays with ends, for the exact shadow test: all float32, (N, 3), (N, 3) and (N,)."""

    origins: np.ndarray
    directions: np.ndarray
    lengths: np.ndarray


class Contestant(ABC):
    """One program that casts depth maps.

    Only `cast`, `occluded`, and, where geometry moves, `move` are timed in calls. `prepare` is timed once, apart, as
    the building of a tree. `load_view` and `load_segments` put rays (or a matrix) into the program's own memory and
    are never timed. Timed methods return only when the work is done.
    """

    name: str
    kind: ClassVar[str] = "ray caster"
    can_test_segments: ClassVar[bool] = False
    can_differentiate: ClassVar[bool] = False
    most_rays: ClassVar[int] = 1 << 31  # a program that is very slow is not asked for more than this

    @abstractmethod
    def version(self) -> str:
        """The program and its settings, for the record."""

    @abstractmethod
    def prepare(self, geometry: Geometry) -> None:
        """Take a new mesh and build whatever is built once for it."""

    @abstractmethod
    def move(self, vertices: np.ndarray) -> None:
        """Replace the vertices of the mesh and rebuild what depends on them."""

    @abstractmethod
    def load_view(self, view: View) -> Any:
        """Rays of a view in the program's own form."""

    @abstractmethod
    def cast(self, loaded: Any, with_face: bool) -> Any:
        """First hits: depth alone, or depth and triangle."""

    @abstractmethod
    def read(self, result: Any, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Distance along each ray, (rows, cols), infinite for a miss; and triangle if asked for, −1 for a miss."""

    def load_segments(self, segments: Segments) -> Any:
        """Rays with ends in the program's own form."""
        raise NotImplementedError

    def occluded(self, loaded: Any) -> Any:
        """Whether anything lies on each segment."""
        raise NotImplementedError

    def read_occluded(self, result: Any) -> np.ndarray:
        """The answers of `occluded` as booleans."""
        raise NotImplementedError

    def loss_and_gradient(self, loaded: Any, target: Any) -> tuple[float, np.ndarray]:
        """Mean squared difference of depth from a target, and its derivative by every vertex, (V, 3)."""
        raise NotImplementedError

    def load_target(self, depth: np.ndarray) -> Any:
        """A depth map in the program's own form."""
        raise NotImplementedError

    def compile(self, loaded: Any, with_face: bool) -> dict[str, Any]:
        """Compile the cast of a view ahead, where that is a step of its own: what it took, for the record."""
        del loaded, with_face
        return {}


def as_image(values: np.ndarray, view: View) -> np.ndarray:
    """A flat list of per-ray values as (rows, cols)."""
    return np.asarray(values).reshape(view.grid.num_rows, view.grid.num_cols)
