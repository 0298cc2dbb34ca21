"""asm, walkthrough: frames along a path with a memory that never grows, and what comes when the camera stops.

The source says that an adaptive map serves walks through a scene, that its memory can be set, and that the picture
improves while a view holds still. Measured: a camera walks straight on and then stands. Every frame may cast a few
steps of tiles; for each frame the tiles cast, those read that were there before, the bytes, and the pixels near exact
shadow edges that are wrong before and after its refinement. A map built for each frame from nothing, without a limit on
steps, shows what there is to gain.

How to read it: on the left wrong pixels of every frame; to the right of the vertical line the camera stands still. On
the right the tiles that each frame reads, split into those that were there and those that it cast.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from experiments.adaptive_views import KIB, Stage, check_view
from experiments.base import Claim
from experiments.claiming import at_most
from shadowjax._checks import require, require_int
from shadowjax.plotting import PALETTE, label, new_figure, styled


@dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scene: Name of a built-in scene.
        num_triangles: About how many triangles it has.
        height: Pixels down, ≥ 24.
        budget_kib: Memory, KiB.
        texels_per_pixel: Texels asked for along a pixel.
        num_frames: Frames of the walk, ≥ 3.
        num_still: Frames that the camera then stands, ≥ 2.
        stride: Way from frame to frame, world units.
        steps_per_frame: Steps of refinement in a frame, ≥ 1.
        tiles_per_step: Most tiles cast in a step, ≥ 1.
    """

    scene: str = "colonnade"
    num_triangles: int = 8000
    height: int = 240
    budget_kib: int = 1024
    texels_per_pixel: float = 4.0
    num_frames: int = 24
    num_still: int = 20
    stride: float = 0.25
    steps_per_frame: int = 1
    tiles_per_step: int = 32

    def __post_init__(self):
        check_view(self.scene, self.num_triangles, self.height)
        require_int(self.budget_kib, "budget_kib", 1)
        require_int(self.num_frames, "num_frames", 3)
        require_int(self.num_still, "num_still", 2)
        require_int(self.steps_per_frame, "steps_per_frame", 1)
        require_int(self.tiles_per_step, "tiles_per_step", 1)
        require(self.stride > 0, f"stride must be positive; got {self.stride}")


@dataclass(frozen=True)
class Frame:
    """One frame.

    Attributes:
        near: Pixels near an edge.
        before: Wrong ones of them before the frame's refinement.
        after: After it.
        fresh: With a map built for this frame alone; −1 where none was.
        cast: Tiles cast.
        evicted: Tiles that left.
        read: Tiles that the frame reads after its refinement.
        kept: Those of them that were there before.
        held: Bytes.
    """

    near: int
    before: int
    after: int
    fresh: int
    cast: int
    evicted: int
    read: int
    kept: int
    held: int


@dataclass(frozen=True)
class Result:
    """The walk.

    Attributes:
        config: The settings.
        frames: In order; the last `num_still` from one place.
    """

    config: Config
    frames: tuple[Frame, ...]

    def of(self, what: str) -> np.ndarray:
        """One count of every frame."""
        return np.array([getattr(frame, what) for frame in self.frames])


def run(config: Config) -> Result:
    """Walk, then stand."""
    options = {"texels_per_pixel": config.texels_per_pixel}
    stage = Stage(config.scene, config.num_triangles, config.height)
    camera = stage.scene.camera
    ahead = np.array(camera.forward)
    ahead[1] = 0.0
    ahead /= np.linalg.norm(ahead)
    technique = stage.technique(config.budget_kib, **options)
    shadows = technique.start(stage.scene.mesh, stage.scene.lights[0], camera)
    frames, view = [], None
    for number in range(config.num_frames + config.num_still):
        if number < config.num_frames:
            place = camera.position + (number * config.stride * ahead).astype(camera.position.dtype)
            moved = eqx.tree_at(lambda one: one.position, camera, place)
            stage = Stage(config.scene, config.num_triangles, config.height, moved)
            view = shadows.look(moved)
        assert view is not None
        before = stage.wrong(shadows).near
        held_keys = {tuple(key) for key in np.asarray(shadows.map.store.keys).tolist()}
        shadows, steps = shadows.refined(view, config.steps_per_frame, config.tiles_per_step)
        slots = np.unique(np.asarray(shadows.map.table.find(shadows.square_of(view))[0])[np.asarray(view.counts)])
        read = [tuple(key) for key in np.asarray(shadows.map.store.keys)[slots].tolist()]
        last = number in (config.num_frames - 1, config.num_frames + config.num_still - 1)
        fresh = stage.wrong(stage.adaptive(config.budget_kib, **options)).near if last else -1
        frames.append(
            Frame(
                int(stage.near.sum()),
                before,
                stage.wrong(shadows).near,
                fresh,
                sum(step.num_cast for step in steps),
                sum(step.num_evicted for step in steps),
                len(read),
                sum(key in held_keys for key in read),
                shadows.map_bytes,
            )
        )
    return Result(config, tuple(frames))


def claims(result: Result) -> tuple[Claim, ...]:
    """Memory, reuse and progress."""
    config = result.config
    walk = slice(1, config.num_frames)
    before, after, read, kept = (result.of(what) for what in ("before", "after", "read", "kept"))
    share = kept[walk].sum() / read[walk].sum()
    moving, still = after[config.num_frames - 1], after[-1]
    fresh = result.frames[-1].fresh
    return (
        at_most("no frame holds more than the budget", result.of("held"), KIB * config.budget_kib),
        Claim("tiles leave on the way: the walk needs more than memory holds", result.of("evicted").sum() > 0,
              f"{result.of('evicted').sum()} tiles evicted", "more than 0"),
        Claim("most tiles that a frame reads were there before it", share > 0.5, f"{100 * share:.0f} %",
              "more than 50 %"),
        Claim("refinement leaves fewer wrong pixels, over the walk", after[walk].sum() < before[walk].sum(),
              f"{after[walk].sum()}", f"less than {before[walk].sum()}"),
        Claim("while the camera stands the picture improves", still < moving, f"{still} wrong pixels",
              f"less than {moving}"),
        Claim("and comes within a third of a map built for the place alone", still <= fresh * 4 / 3 + 3,
              f"{still}", f"at most 4/3 of {fresh}, and 3"),
    )  # fmt: skip


def numbers(result: Result) -> dict[str, Any]:
    """Every frame."""
    return {"frames": result.frames}


@styled
def draw(result: Result) -> Figure:
    """Wrong pixels and tiles, frame by frame."""
    figure, axes = new_figure(9.6, 4.2, 1, 2)
    left, right = axes[0]
    frame = np.arange(len(result.frames))
    near = result.of("near")
    for index, (what, name) in enumerate((("before", "before refinement"), ("after", "after it"))):
        left.plot(
            frame, 100 * result.of(what) / near, "os"[index] + "-", color=PALETTE[index], markersize=4, label=name
        )
    fresh = result.of("fresh")
    left.plot(frame[fresh >= 0], (100 * fresh / near)[fresh >= 0], "D", color=PALETTE[2], markersize=7,
              label="a map for this frame alone")  # fmt: skip
    left.set_ylim(0)
    label(left, "frame", "wrong pixels near edges, %", "Error of every frame")
    kept, read = result.of("kept"), result.of("read")
    right.bar(frame, kept, color=PALETTE[0], width=0.85, label="read, were there")
    right.bar(frame, read - kept, bottom=kept, color=PALETTE[1], width=0.85, label="read, newly cast")
    right.set_ylim(0, 1.3 * read.max())
    label(right, "frame", "tiles", f"Tiles in {result.config.budget_kib} KiB")
    for spot in (left, right):
        spot.axvline(result.config.num_frames - 0.5, color="#4d4d4d", linestyle="--", linewidth=1.0)
        spot.xaxis.set_major_locator(MaxNLocator(integer=True))
        spot.legend(loc="upper right", frameon=True, framealpha=1.0, edgecolor="none")
    return figure
