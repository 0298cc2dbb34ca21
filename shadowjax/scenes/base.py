"""What a scene is, what a family of scenes is, and how one is put together from parts."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import equinox as eqx
import numpy as np

from shadowjax._checked import Checked, checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight, Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes.parts import Part, Vector, join

ASPECT = 4.0 / 3.0
MARGIN = 0.04  # of the image, kept free around a framed scene
SUNLIGHT = (1.0, 0.96, 0.88)


class Scene(Checked):
    """A mesh with a camera that looks at it and the lights that shine on it.

    Attributes:
        mesh: All surfaces, metres, y up.
        camera: A view that shows the shadows.
        lights: One light or more.
        name: Name in the registry.
        description: One line for people.
    """

    mesh: Mesh
    camera: Camera
    lights: tuple[Light, ...]
    name: str = eqx.field(static=True)
    description: str = eqx.field(static=True)


@checked
@dataclass(frozen=True)
class SceneFamily:
    """An entry of the registry of scenes.

    Attributes:
        name: Kebab-case name.
        description: One line for people: what stands there and what its shadows are good for.
        source: Which source's scene it stands in for, or "shadowjax".
        build: Makes mesh, camera and lights for about that many triangles.
        default_triangles: Triangles asked for where the user gives no number.
        min_triangles: Least that may be asked for.
        max_triangles: Most that may be asked for; equal to the least where the family has one size only.
        closed: Whether every body, the ground included, is watertight and oriented outwards.
    """

    name: str
    description: str
    source: str
    build: Callable[[int], tuple[Mesh, Camera, tuple[Light, ...]]]
    default_triangles: int
    min_triangles: int
    max_triangles: int
    closed: bool = True

    @property
    def scales(self) -> bool:
        """Whether the number of triangles can be chosen (the result then lies within a factor 2 of the wish)."""
        return self.min_triangles < self.max_triangles


@checked
def to_mesh(parts: Iterable[Part]) -> Mesh:
    """One checked mesh of all parts."""
    part = join(parts)
    return Mesh.create(part.vertices, part.faces, part.colors)


@checked
def view(position: Vector, target: Vector, half_angle_deg: float, near: float, far: float) -> Camera:
    """Camera of the scenes' common aspect, with half its vertical angle of view in degrees."""
    return Camera.look_at(position, target, phi_y=float(np.radians(half_angle_deg)), aspect=ASPECT, near=near, far=far)


@checked
def framed(mesh: Mesh, azimuth_deg: float, elevation_deg: float, half_angle_deg: float = 20.0) -> Camera:
    """Camera that holds the whole mesh in its image, as large as it goes, with near and far close around it.

    In view coordinates about the origin, a vertex (x, y, z) lies inside the right edge of the image of a camera shifted
    by c and drawn back by d where x - c ≤ tan (z + d); the four edges give c and the least d in closed form.

    Args:
        mesh: What to show.
        azimuth_deg: Where the camera stands, degrees from +z to +x.
        elevation_deg: Its height above the horizon, degrees in (-90, 90).
        half_angle_deg: Half the vertical angle of view, degrees.
    """
    back = towards(azimuth_deg, elevation_deg)
    right = np.array([back[2], 0.0, -back[0]]) / np.hypot(back[0], back[2])
    up = np.cross(back, right)
    x, y, z = (np.asarray(mesh.vertices, float) @ np.stack([right, up, -back], -1)).T
    tangent_y = np.tan(np.radians(half_angle_deg)) * (1.0 - MARGIN)
    tangent_x = tangent_y * ASPECT
    # Largest x − tan·z and −x − tan·z, then for y: what c and d must satisfy with equality at the tightest vertices.
    edges = [np.max(sign * w - t * z) for w, t in ((x, tangent_x), (y, tangent_y)) for sign in (1.0, -1.0)]
    drawn_back = max((edges[0] + edges[1]) / (2 * tangent_x), (edges[2] + edges[3]) / (2 * tangent_y))
    position = 0.5 * (edges[0] - edges[1]) * right + 0.5 * (edges[2] - edges[3]) * up + drawn_back * back
    near, far = 0.98 * (z.min() + drawn_back), 1.02 * (z.max() + drawn_back)
    return view(position, position - back, half_angle_deg, near, far)


@checked
def towards(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """Unit vector (3,) to azimuth (from +z, where the viewer stands, to +x) and elevation, both in degrees."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])


@checked
def sun(azimuth_deg: float, elevation_deg: float, strength: float = 1.0) -> tuple[DirectionalLight, ...]:
    """The sun alone, as a tuple of lights.

    Args:
        azimuth_deg: Where the sun stands, degrees from +z to +x: 90 is to the viewer's right.
        elevation_deg: Its height above the horizon, degrees in (0, 90].
        strength: Factor on the colour.
    """
    color = [strength * channel for channel in SUNLIGHT]
    return (DirectionalLight.create(-towards(azimuth_deg, elevation_deg), color),)
