"""What readers of mesh files hand over: parts in NumPy, checked, placed and joined in one go."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from shadowjax._checks import require
from shadowjax.geometry.mesh_files.colors import Paint

# More triangles than this package casts within minutes; a scene that places one part often reaches them quickly.
MAX_TRIANGLES = 5_000_000


@dataclass
class Part:
    """Triangles of a file before they stand in the scene.

    Args:
        vertices: (vertices, 3) in the part's own frame.
        faces: (faces, 3) indices.
        paint: Its colour.
        placements: 4×4 matrices, one for each place where the part stands.
    """

    vertices: np.ndarray
    faces: np.ndarray
    paint: Paint = field(default_factory=Paint)
    placements: Sequence[np.ndarray] = (np.eye(4),)


@dataclass
class Reading:
    """All that one file holds.

    Args:
        parts: Surfaces.
        notes: What a person should know: what was left out or changed.
    """

    parts: list[Part]
    notes: list[str] = field(default_factory=list)


def join(reading: Reading, default_albedo: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All parts where they stand: vertices (V, 3), faces (F, 3) and linear colours (F, 3), in float64.

    Vertices that no face uses are left out, so that they do not count into bounds. A placement that mirrors also turns
    the faces round.

    Raises:
        ValueError: If a number is not finite, an index is out of range, or there are too many triangles.
    """
    total = sum(len(part.faces) * len(part.placements) for part in reading.parts)
    require(total <= MAX_TRIANGLES, f"it holds {total:,} triangles; at most {MAX_TRIANGLES:,} are read: simplify it")
    vertices, faces, colors, start = [], [], [], 0
    for part in reading.parts:
        if not len(part.faces) or not len(part.placements):
            continue
        places, corners = _checked(part)
        albedo = part.paint.albedo(corners, reading.notes)
        albedo = np.full((len(corners), 3), default_albedo) if albedo is None else albedo
        # Only vertices that faces use are placed, renumbered in rising order.
        used, corners = np.unique(corners, return_inverse=True)
        places, corners = places[used], corners.reshape(-1, 3)
        for matrix in part.placements:
            require(bool(np.isfinite(matrix).all()), "a transform holds NaN or infinite numbers")
            vertices.append(places @ matrix[:3, :3].T + matrix[:3, 3])
            faces.append(start + (corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners))
            colors.append(albedo)
            start += len(places)
    require(len(faces) > 0, "it holds no triangles (points, lines or nothing at all); export it as a surface")
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(colors)


def _checked(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a part, if they fit each other."""
    vertices, faces = np.asarray(part.vertices), np.asarray(part.faces)
    require(
        vertices.ndim == 2 and vertices.shape[1] == 3 and vertices.dtype.kind in "fiu",
        f"vertices must have three coordinates each; got an array of shape {vertices.shape}",
    )
    require(
        faces.ndim == 2 and faces.shape[1] == 3 and faces.dtype.kind in "iu",
        f"faces must have three corners each; got an array of shape {faces.shape}",
    )
    low, high = int(faces.min()), int(faces.max())
    require(
        low >= 0 and high < len(vertices),
        f"face indices must lie in [0, {len(vertices)}), the number of vertices; got {low} … {high}",
    )
    vertices, faces = vertices.astype(np.float64), faces.astype(np.int64)
    bad = int((~np.isfinite(vertices[faces.reshape(-1)])).any(axis=-1).sum())
    require(bad == 0, f"vertices must be finite; {bad} corners of faces hold NaN or infinite numbers")
    return vertices, faces


def see_through(names: Sequence[str]) -> list[str]:
    """The note on materials that let light through, if there are any; they are named."""
    if not names:
        return []
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return [f"transparent or cut-out materials are solid here and cast whole shadows: {shown}"]
