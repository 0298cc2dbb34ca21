"""What moves: a new light or camera with every call, and new vertices with every call."""

from tests.benchmarks.cases.depth import able, warm_up
from tests.benchmarks.peers.base import Contestant
from tests.benchmarks.scenes import view
from tests.benchmarks.session import Session
from tests.benchmarks.timing import timed

# Views and shapes go round in this many steps, so that no two calls in a row see the same.
NUM_STEPS = 4


def run_new_view(session: Session) -> None:
    """Another light with every call; nobody has to rebuild, and nobody may have kept anything of the last view."""
    taking_part = able(session.contestants, session.resolution)
    for size in session.middle_sizes:
        geometry = session.geometry(size)
        session.say(f"new-view, {size}")
        views = [view(geometry, "orthographic", session.resolution, step) for step in range(NUM_STEPS)]
        for contestant in taking_part:
            contestant.prepare(geometry)
        loaded = {c.name: [c.load_view(shown) for shown in views] for c in taking_part}
        first = {name: rays[0] for name, rays in loaded.items()}
        beside = warm_up(taking_part, first, geometry, views[0], False)
        calls = {
            c.name: lambda step, c=c: c.cast(loaded[c.name][step % NUM_STEPS], False)  # noqa: B023
            for c in taking_part
        }
        session.measure("new-view", geometry, views[0], calls, beside)


def run_new_vertices(session: Session) -> None:
    """New vertices from the host with every call: copy, rebuild whatever there is to rebuild, and cast."""
    taking_part = able(session.contestants, session.resolution)
    for size in session.middle_sizes:
        geometry = session.geometry(size)
        session.say(f"new-vertices, {size}")
        shapes = [geometry.moved(step) for step in range(NUM_STEPS)]
        shown = view(geometry, "orthographic", session.resolution)
        moving = {}
        for contestant in taking_part:
            contestant.prepare(geometry)
            contestant.move(shapes[0])
            _, moving[contestant.name] = timed(lambda c=contestant: c.move(shapes[-1]))  # noqa: B023
        loaded = {c.name: c.load_view(shown) for c in taking_part}
        # The pictures compared show the mesh after it moved: a rebuild that did nothing would differ.
        beside = warm_up(taking_part, loaded, geometry, shown, False)
        for name, entry in beside.items():
            entry["move_ms"] = moving[name]

        def call(contestant: Contestant, step: int) -> None:
            contestant.move(shapes[step % NUM_STEPS])  # noqa: B023
            contestant.cast(loaded[contestant.name], False)  # noqa: B023

        calls = {c.name: lambda step, c=c, call=call: call(c, step) for c in taking_part}
        session.measure("new-vertices", geometry, shown, calls, beside)
