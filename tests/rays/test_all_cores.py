"""All cores in one call: the same picture bit by bit, and a clear complaint where the call comes too late."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = """
import numpy as np
import shadowjax as sj
assert sj.use_all_cores(2) == 2
import jax
from shadowjax.rays import GridCaster, cast_over_bands
assert len(jax.devices()) == 2
scene = sj.make_scene("solids")
grid = sj.SingleMap().grids(scene.mesh, scene.lights[0], scene.camera, 64)[0]
two = cast_over_bands(GridCaster().faces_on_grid, scene.mesh, grid)
one = cast_over_bands(GridCaster().faces_on_grid, scene.mesh, grid, jax.devices()[:1])
assert len(two[0].devices()) == 2 and (np.asarray(one[1]) >= 0).any() and (np.asarray(one[1]) < 0).any()
assert [np.asarray(part).tobytes() for part in one] == [np.asarray(part).tobytes() for part in two]
assert sj.use_all_cores(2) == 2
try:
    sj.use_all_cores(3)
except ValueError as error:
    print(error)
"""


def test_two_devices_give_the_map_of_one_bit_by_bit():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "came too late: JAX has started with 2 of 3 devices; call it at the start" in done.stdout
