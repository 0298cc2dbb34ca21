"""What moves: a new light or camera with every call, and new vertices with every call."""

from tests.benchmarks.cases.depth import compare, first_cast
from tests.benchmarks.scenes import Geometry, view
from tests.benchmarks.session import Session
from tests.benchmarks.timing import timed

# Views and shapes go round in this many steps, so that no two calls in a row see the same.
NUM_STEPS = 4


def run_new_view(session: Session) -> None:
    """Another light with every call; nobody has to rebuild, and nobody may have kept anything of the last view."""
    for size in session.middle_sizes:
        geometry = session.geometry(size)
        session.say(f"new-view, {size} triangles")
        views = [view(geometry, "orthographic", session.resolution, step) for step in range(NUM_STEPS)]
        loaded, beside = {}, {}
        for contestant in session.contestants:
            contestant.prepare(geometry)
            loaded[contestant.name] = [contestant.load_view(shown) for shown in views]
            beside[contestant.name] = first_cast(contestant, loaded[contestant.name][0], False)
        last = {name: rays[-1] for name, rays in loaded.items()}
        compare(session.contestants, last, geometry, views[-1], False, beside)
        calls = {
            c.name: lambda step, c=c: c.cast(loaded[c.name][step % NUM_STEPS], False)  # noqa: B023
            for c in session.contestants
        }
        session.measure("new-view", geometry, views[0], calls, beside)


def run_new_vertices(session: Session) -> None:
    """New vertices from the host with every call: copy, rebuild whatever there is to rebuild, and cast."""
    for size in session.middle_sizes:
        geometry = session.geometry(size)
        session.say(f"new-vertices, {size} triangles")
        shapes = [geometry.moved(step) for step in range(NUM_STEPS)]
        shown = view(geometry, "orthographic", session.resolution)
        loaded, beside = {}, {}
        for contestant in session.contestants:
            contestant.prepare(geometry)
            loaded[contestant.name] = contestant.load_view(shown)
            beside[contestant.name] = first_cast(contestant, loaded[contestant.name], False)
            contestant.move(shapes[0])
            _, beside[contestant.name]["move_ms"] = timed(lambda c=contestant: c.move(shapes[-1]))  # noqa: B023
        moved = Geometry(geometry.name, shapes[-1], geometry.faces, geometry.centre, geometry.radius)
        compare(session.contestants, loaded, moved, shown, False, beside)

        def call(contestant, step):
            contestant.move(shapes[step % NUM_STEPS])  # noqa: B023
            contestant.cast(loaded[contestant.name], False)  # noqa: B023

        calls = {c.name: lambda step, c=c, call=call: call(c, step) for c in session.contestants}
        session.measure("new-vertices", geometry, shown, calls, beside)
