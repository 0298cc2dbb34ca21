"""Exact visibility of a camera's image: is there anything between each visible point and the light?"""

import numpy as np

from shadowjax.rays.caster import Caster, shadow_rays
from tests.benchmarks.cases.programs import compiled
from tests.benchmarks.cases.receivers import camera_and_light, device_mesh, visible_points
from tests.benchmarks.peers.base import Segments
from tests.benchmarks.session import Session

# How far above its receiver a peer's shadow ray starts, in roundings of the scene's extent.
PEER_ROUNDINGS = 64.0


def run(session: Session) -> None:
    """Ours from points and normals; peers get the finished shadow rays, and rasterisers have no exact test.

    The time of a depth map of as many texels stands next to it, in the same rounds.
    """
    caster = session.ours[0].caster
    if type(caster).visible is Caster.visible:
        session.say("visibility: left out, this caster has no test of its own for coherent shadow rays")
        return
    for size in session.middle_sizes:
        _measure(session, size)


def _measure(session: Session, size: str) -> None:
    session.say(f"visibility, {size}")
    ours, geometry = session.ours[0], session.geometry(size)
    mesh = device_mesh(geometry)
    seen, lit = camera_and_light(session, geometry)
    ours.prepare(geometry)
    points, normals = visible_points(ours, mesh, seen.grid)
    arguments = (mesh, lit.grid.space, points, normals)
    calls, beside = {}, {}
    calls[ours.name], beside[ours.name], answer = compiled(ours.visible, *arguments)
    calls["depth map"], beside["depth map"], _ = compiled(ours.caster.depth_on_grid, mesh, lit.grid)
    mine = np.asarray(answer)
    for other in session.ours[1:]:
        placed = *other.fit(arguments[:2]), *other.dealt(arguments[2:])
        calls[other.name], entry, answer = compiled(other.visible, *placed, options=other.compiler_options)
        beside[other.name] = entry | {"visibility_differs_percent": float(100 * np.mean(np.asarray(answer) != mine))}
    # A peer's own rounding is that of the whole scene: its rays start as far above the receivers as that asks for.
    gap = PEER_ROUNDINGS * np.finfo(np.float32).eps * float(mesh.extent)
    rays, facing = shadow_rays(lit.grid.space, points + gap * normals, normals)
    rays, facing = rays.flattened(), np.asarray(facing)
    segments = Segments(*(np.array(x, np.float32) for x in (rays.origins, rays.directions, rays.t_max)))
    for peer in (peer for peer in session.peers if peer.can_test_segments):
        peer.prepare(geometry)
        loaded = peer.load_segments(segments)
        theirs = facing & ~peer.read_occluded(peer.occluded(loaded)).reshape(facing.shape)
        beside[peer.name] = {"visibility_differs_percent": float(100 * np.mean(theirs != mine))}
        calls[peer.name] = lambda step, peer=peer, loaded=loaded: peer.occluded(loaded)
    record = session.measure("visibility", geometry, seen, calls, beside)
    record["lit_percent"] = float(100 * mine.mean())
