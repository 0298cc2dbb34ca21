"""Options of a run and the run itself: from the choice of contestants to the files that are written."""

import dataclasses
import shlex
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from shadowjax._checks import require, require_choice, require_int
from shadowjax.io import write_json, write_text
from shadowjax.report.machine import machine
from tests.benchmarks.cases import CASES
from tests.benchmarks.fit import laws
from tests.benchmarks.ours import VARIANTS, Shadowjax
from tests.benchmarks.peers import ALWAYS, PEERS, start
from tests.benchmarks.peers.base import Absent
from tests.benchmarks.scenes import PROJECTIONS, SPHERES
from tests.benchmarks.session import Session
from tests.benchmarks.summary import ratios
from tests.benchmarks.table import fragment, show

SCHEMA = 1
NO_PEERS = ("none",)


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
        devices: Devices that JAX makes of the processor, for variants that use several; 0 for one of each core.
        mesh: Mesh files to measure as well.
        rounds: Timed calls of everybody, at least 7 for figures to publish; 0 for that, or 3 if quick.
        json: Where the results go.
        page: Where the tables go as Markdown for the documentation; nowhere if not given.
    """

    quick: bool = False
    only: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    sizes: tuple[str, ...] = ()
    resolutions: tuple[int, ...] = ()
    devices: int = 0
    mesh: tuple[str, ...] = ()
    rounds: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    json: str = "benchmarks/results.json"
    page: str | None = None

    def command(self) -> str:
        """The command line that measures the same, without the places of its outputs."""
        words = ["python -m tests.benchmarks"]
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name in ("json", "page") or value == field.default:
                continue
            words.append(f"--{field.name}")
            if value is not True:
                words += [shlex.quote(str(item)) for item in (value if isinstance(value, tuple) else (value,))]
        return " ".join(words)


def run(options: Options, console: Console | None = None) -> dict[str, Any]:
    """Measure, print the tables and write the files.

    Raises:
        ValueError: If a case, a peer, a variant, a size or a mesh file is unknown.
    """
    console = console or Console(highlight=False)
    begin = time.monotonic()
    check(options)
    session, absent = prepare(options)
    log = Console(stderr=True, highlight=False)
    session.say = lambda text: log.print(f"{time.monotonic() - begin:6.1f} s  {text}", soft_wrap=True)
    for name in options.only or CASES:
        CASES[name](session)
    results = {
        "schema": SCHEMA,
        "command": options.command(),
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


def check(options: Options) -> None:
    """Complain of what is unknown before any work is done."""
    for value, name, known in (
        (options.only, "case", CASES),
        (() if options.peers == NO_PEERS else options.peers, "peer", PEERS),
        (options.variants, "variant", VARIANTS),
        (options.sizes, "size", SPHERES),
    ):
        for item in value:
            require_choice(item, name, known)
    for resolution in options.resolutions:
        require_int(resolution, "a resolution", 1)
    require_int(options.rounds, "rounds", 0)
    require_int(options.devices, "devices", 0)
    for path in options.mesh:
        require(Path(path).is_file(), f"no such mesh file: {path}")


def prepare(options: Options) -> tuple[Session, dict[str, str]]:
    """The session of the options, and the peers that are absent with the reason."""
    everybody = [name for name in PEERS if name in ALWAYS] if options.quick else list(PEERS)
    asked = [] if options.peers == NO_PEERS else options.peers or everybody
    peers, absent = start(asked)
    ours = _variants(options.variants, absent)
    quick = options.quick
    sizes = options.sizes or (("1 k",) if quick else tuple(SPHERES))
    resolutions = options.resolutions or ((64,) if quick else (512, 1024, 2048))
    session = Session(
        ours=ours,
        peers=peers,
        sizes=sizes,
        middle_sizes=sizes if quick or options.sizes else ("20 k", "80 k", "330 k", "1.3 M"),
        resolutions=resolutions,
        resolution=1024 if 1024 in resolutions else resolutions[0],
        projections=PROJECTIONS[:1] if quick else PROJECTIONS,
        rounds=options.rounds or (3 if quick else 7),
        files=options.mesh,
    )
    return session, absent


def _variants(asked: tuple[str, ...], absent: dict[str, str]) -> list[Shadowjax]:
    """Our own contestants; those that cannot run here join the absent."""
    ours = []
    for name in asked or VARIANTS:
        try:
            ours.append(VARIANTS[name]())
        except Absent as error:
            absent[name] = str(error)
    require(len(ours) > 0, f"none of the variants asked for can run here: {absent}")
    return ours
