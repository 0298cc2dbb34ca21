"""Options of a run and the run itself: from the choice of contestants to the files that are written."""

import sys
import time
from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from rich.console import Console

from shadowjax._checks import require, require_choice
from shadowjax.io import write_json, write_text
from shadowjax.report.machine import machine
from tests.benchmarks.cases import CASES
from tests.benchmarks.fit import laws
from tests.benchmarks.ours import VARIANTS
from tests.benchmarks.peers import ALWAYS, PEERS, start
from tests.benchmarks.scenes import SPHERES
from tests.benchmarks.session import Session
from tests.benchmarks.summary import ratios
from tests.benchmarks.table import fragment, show

SCHEMA = 1


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        quick: A few seconds: a small mesh, small maps, and the peers that tests always have.
        only: Cases to run; all if none is named.
        peers: Peers to run by name, or "none"; all that are installed if none is named.
        variants: Ways to run the package, by name; all if none is named.
        sizes: Displaced spheres of the depth maps, by name.
        resolutions: Cells along each side of the depth maps.
        mesh: Mesh files to measure as well.
        rounds: Timed calls of everybody, at least 7 for figures to publish.
        json: Where the results go.
        page: Where the tables go as Markdown for the documentation; nowhere if not given.
    """

    quick: bool = False
    only: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    sizes: tuple[str, ...] = ()
    resolutions: tuple[int, ...] = ()
    mesh: tuple[str, ...] = ()
    rounds: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    json: str = "benchmarks/results.json"
    page: str | None = None


def run(options: Options, console: Console | None = None) -> dict[str, Any]:
    """Measure, print the tables and write the files.

    Raises:
        ValueError: If a case, a peer, a variant, a size or a mesh file is unknown.
    """
    console = console or Console(highlight=False)
    begin = time.monotonic()
    names = [require_choice(name, "case", CASES) for name in options.only] or list(CASES)
    session, absent = prepare(options)
    log = Console(stderr=True, highlight=False)
    session.say = lambda text: log.print(f"{time.monotonic() - begin:6.1f} s  {text}", soft_wrap=True)
    for name in names:
        CASES[name](session)
    results = {
        "schema": SCHEMA,
        "command": " ".join(["python -m tests.benchmarks", *sys.argv[1:]])
        if sys.argv[0].endswith("__main__.py")
        else "",
        "seconds": time.monotonic() - begin,
        "machine": machine(),
        "versions": {contestant.name: contestant.version() for contestant in session.contestants},
        "kinds": {contestant.name: contestant.kind for contestant in session.contestants},
        "absent": absent,
        "ratios": ratios(session.records, {c.name: c.kind for c in session.contestants}),
        "laws": laws(session.records),
        "records": session.records,
    }
    if not console.is_terminal:
        console.width = 240
    show(results, console)
    write_json(options.json, results)
    if options.page is not None:
        write_text(options.page, fragment(results))
    return results


def prepare(options: Options) -> tuple[Session, dict[str, str]]:
    """The session of the options, and the peers that are absent with the reason."""
    require(options.rounds >= 0, f"rounds must be at least 1; got {options.rounds}")
    for size in options.sizes:
        require_choice(size, "size", SPHERES)
    everybody = [name for name in PEERS if name in ALWAYS] if options.quick else list(PEERS)
    asked = [] if options.peers == ("none",) else list(options.peers) or everybody
    peers, absent = start(require_choice(name, "peer", PEERS) for name in asked)
    variants = [require_choice(name, "variant", VARIANTS) for name in options.variants] or list(VARIANTS)
    quick = options.quick
    sizes = options.sizes or (("1 k",) if quick else tuple(SPHERES))
    resolutions = options.resolutions or ((64,) if quick else (512, 1024, 2048))
    session = Session(
        ours=[VARIANTS[name]() for name in variants],
        peers=peers,
        sizes=sizes,
        middle_sizes=sizes if quick or options.sizes else ("20 k", "80 k", "330 k", "1.3 M"),
        resolutions=resolutions,
        resolution=1024 if 1024 in resolutions else resolutions[0],
        rounds=options.rounds or (3 if quick else 7),
        files=options.mesh,
    )
    return session, absent
