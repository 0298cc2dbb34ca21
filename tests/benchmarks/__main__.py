"""First form of the command: depth maps of 80 k, 330 k and 1.3 M triangles, all contestants in turn.

`python -m tests.benchmarks [SIZES [RESOLUTION [PEERS]]]`, for example `"80 k,330 k" 1024 "Mitsuba LLVM,llvmpipe"`.
"""

import statistics
import sys
import time

import jax
import numpy as np

from tests.benchmarks.ours import VARIANTS
from tests.benchmarks.peers import PEERS, start
from tests.benchmarks.scenes import PROJECTIONS, sphere_over_plane, view


def main(sizes: str = "80 k,330 k,1.3 M", resolution: str = "1024", peers: str = ",".join(PEERS)) -> None:
    """Print median and least milliseconds of seven warm calls, and agreement with the first contestant."""
    jax.config.update("jax_enable_compilation_cache", False)
    present, absent = start(peers.split(",") if peers else [])
    contestants = [make() for make in VARIANTS.values()] + present
    print("absent:", absent)
    for size in sizes.split(","):
        geometry = sphere_over_plane(size)
        for contestant in contestants:
            contestant.prepare(geometry)
        for projection in PROJECTIONS:
            shown = view(geometry, projection, int(resolution))
            loaded = [contestant.load_view(shown) for contestant in contestants]
            for with_face in (False, True):
                read = [c.read(c.cast(rays, with_face), shown) for c, rays in zip(contestants, loaded, strict=True)]
                times = [[] for _ in contestants]
                for _ in range(7):
                    for taken, contestant, rays in zip(times, contestants, loaded, strict=True):
                        begin = time.perf_counter()
                        contestant.cast(rays, with_face)
                        taken.append(1e3 * (time.perf_counter() - begin))
                for taken, contestant, (depth, _) in zip(times, contestants, read, strict=True):
                    middle = statistics.median(taken)
                    print(
                        f"{size:6s} {projection:12s} {'depth+face' if with_face else 'depth':10s} {contestant.name:20s}"
                        f" {middle:8.2f} ms (least {min(taken):8.2f})  × {middle / statistics.median(times[0]):6.2f}"
                        f"  differs in {100 * np.mean(~(np.abs(depth - read[0][0]) < 1e-3)):.4f} %",
                        flush=True,
                    )


main(*sys.argv[1:])
