"""A gear train on a drilled base plate: closed machined bodies with bores, flat faces and exact edges."""

import numpy as np

from shadowjax._checked import checked
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh
from shadowjax.scenes import palette
from shadowjax.scenes.base import SceneFamily, framed, sun, to_mesh
from shadowjax.scenes.parts import Part, join
from shadowjax.scenes.primitives import block, cylinder, floor, revolve
from shadowjax.scenes.surfaces import circle, extrude, rectangle

DEFAULT = 5500
PLATE = 0.18  # thickness of the base plate, metres
AXIS = 1.25  # height of the shafts over the plate's top
WHEEL_TEETH, PINION_TEETH = 30, 12
WHEEL_RADIUS = 0.9
PINION_RADIUS = WHEEL_RADIUS * PINION_TEETH / WHEEL_TEETH
BOLT_PLACES = [(x, z) for x in (-1.95, 1.95) for z in (-0.85, 0.85)]


@checked
def gear_outline(teeth: int, radius: float, phase: float) -> np.ndarray:
    """(4 teeth, 2) outline of a spur gear with straight flanks about its pitch circle; `phase` in tooth pitches."""
    module = 2.0 * radius / teeth
    pitch = 2 * np.pi / teeth
    start = pitch * (np.arange(teeth) + phase)[:, None]
    angles = start + pitch * np.array([-0.36, -0.14, 0.14, 0.36])
    # Root, tip, tip, root of every tooth, off the pitch circle in modules.
    radii = np.array([radius - 1.15 * module, radius + 0.95 * module, radius + 0.95 * module, radius - 1.15 * module])
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], -1).reshape(-1, 2)


@checked
def gear(teeth: int, radius: float, bore: float, width: float, phase: float, windows: int, segments: int) -> Part:
    """Spur gear about the z axis from z = 0 to `width`, with a bore and round windows."""
    holes = [circle(bore, segments)]
    for k in range(windows):
        angle = 2 * np.pi * (k + 0.5) / windows
        holes.append(circle(0.19 * radius, segments, 0.55 * radius * np.array([np.cos(angle), np.sin(angle)])))
    return extrude([gear_outline(teeth, radius, phase), *holes], width)


@checked
def along_z(part: Part) -> Part:
    """A body of revolution about y turned to lie about z; its top looks to +z."""
    return part.turned((1, 0, 0), np.pi / 2)


@checked
def bearing(width: float, height: float, bore: float, thickness: float, segments: int) -> Part:
    """Upright bearing plate in the xy plane: straight sides, a round head and a bore at y = `height`."""
    radius = 0.36 * width
    half_turn = np.linspace(0.0, np.pi, segments + 1)
    head = np.array([0.0, height]) + radius * np.stack([np.cos(half_turn), np.sin(half_turn)], -1)
    foot = np.linspace((-width / 2, 0.0), (width / 2, 0.0), 9)
    flank = np.linspace(0.0, 1.0, 13)[1:-1, None]
    right = foot[-1] + flank * (head[0] - foot[-1])
    left = head[-1] + flank * (foot[0] - head[-1])
    outline = np.concatenate([foot, right, head, left])
    return extrude([outline, circle(bore, segments, (0.0, height))], thickness)


@checked
def bolt(radius: float, segments: int) -> Part:
    """Washer, hexagonal head and threadless end, standing on y = 0."""
    washer = revolve([(1.9 * radius, 0.0), (1.9 * radius, 0.03), (radius, 0.03), (radius, 0.0)], segments, loop=True)
    head = revolve([(1.35 * radius, 0.03), (1.55 * radius, 0.06), (1.55 * radius, 0.15), (1.35 * radius, 0.18)], 6)
    return join([washer.painted(palette.GRAPHITE), head.painted(palette.BRASS)])


@checked
def motor(segments: int) -> Part:
    """Finned housing about z with its front at z = 0, on a foot that reaches down to the plate."""
    rows = [(0.3, 0.0), (0.42, 0.05), (0.44, 0.1)]
    for place in 0.12 + 0.075 * np.arange(8):
        rows += [(0.44, place), (0.5, place + 0.005), (0.5, place + 0.035), (0.44, place + 0.04)]
    rows += [(0.44, 0.78), (0.4, 0.86), (0.2, 0.9)]
    housing = along_z(revolve(rows, segments)).turned((0, 1, 0), np.pi).painted(palette.NAVY)
    foot = block(0.7, AXIS - 0.3, 0.5).moved(y=-AXIS, z=-0.45).painted(palette.GRAPHITE)
    return join([housing, foot])


@checked
def machine(segments: int) -> Part:
    """The whole assembly standing on y = 0, its shafts along z."""
    top = PLATE
    drills = [circle(0.11, segments, place) for place in BOLT_PLACES]
    window = circle(0.2, segments, (-1.25, 0.0))
    plate = extrude([rectangle(4.5, 2.3, 24), *drills, window], PLATE).turned((1, 0, 0), -np.pi / 2)
    wheel = gear(WHEEL_TEETH, WHEEL_RADIUS, 0.16, 0.24, 0.0, 6, segments)
    phase = 0.5 * (PINION_TEETH + 1)  # a gap of the pinion meets the tooth of the wheel at angle 0
    pinion = gear(PINION_TEETH, PINION_RADIUS, 0.11, 0.3, phase, 0, segments)
    shaft = revolve([(0.14, -1.1), (0.155, -1.06), (0.155, 0.72), (0.12, 0.76), (0.12, 0.92), (0.1, 0.95)], segments)
    short = cylinder(0.105, -0.35, 0.72, segments)
    flange = revolve([(0.16, 0.0), (0.42, 0.0), (0.42, 0.1), (0.16, 0.1)], segments, loop=True)
    parts = [
        plate.painted(palette.STEEL),
        bearing(1.3, AXIS, 0.16, 0.22, segments).moved(-0.5, top - 0.004, 0.02).painted(palette.SLATE),
        bearing(1.3, AXIS, 0.16, 0.22, segments).moved(-0.5, top - 0.004, -0.95).painted(palette.SLATE),
        along_z(shaft).moved(-0.5, top + AXIS, 0.0).painted(palette.STEEL),
        wheel.moved(-0.5, top + AXIS, 0.36).painted(palette.BRASS),
        along_z(flange).moved(-0.5, top + AXIS, 0.25).painted(palette.TERRACOTTA),
        pinion.moved(-0.5 + WHEEL_RADIUS + PINION_RADIUS, top + AXIS, 0.33).painted(palette.TERRACOTTA),
        along_z(short).moved(-0.5 + WHEEL_RADIUS + PINION_RADIUS, top + AXIS, 0.0).painted(palette.STEEL),
        motor(segments).moved(-0.5 + WHEEL_RADIUS + PINION_RADIUS, top + AXIS - 0.004, 0.05),
    ]
    parts += [bolt(0.11, segments).moved(x, top + 0.002, z) for x, z in BOLT_PLACES]
    return join(parts)


@checked
def build(num_triangles: int) -> tuple[Mesh, Camera, tuple[Light, ...]]:
    """Round outlines get finer with the wish; teeth and bodies stay."""
    segments = max(8, round(20 * num_triangles / DEFAULT))
    parts = [
        machine(segments).turned((0, 1, 0), np.radians(22.0)).moved(y=0.004),
        floor(3.1, 2.2).moved(x=-0.4, z=-0.1).painted(palette.PLASTER),
    ]
    mesh = to_mesh(parts)
    return mesh, framed(mesh, 0.0, 32.0), sun(62.0, 40.0)


FAMILY = SceneFamily(
    name="cad-assembly",
    description="a gear train on a drilled plate: closed machined bodies with holes and exact edges",
    source="shadowjax",
    build=build,
    default_triangles=DEFAULT,
    min_triangles=3000,
    max_triangles=100_000,
)
