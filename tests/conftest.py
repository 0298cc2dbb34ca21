"""Settings of every test: float64 at hand, strict promotion, NaN debugging, checked annotations, one cache."""

import gc
import os
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "agg")
# For small programs that run once or twice most optimisations take longer than the runs: see `effort_of_the_compiler`.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")

import jax
import jax.numpy as jnp
import pytest
from jaxtyping import install_import_hook

# XLA's newer code generator takes longer over thousands of small programs than they take to run, so most tests use the
# older one; tests/rays/test_default_compiler.py tests casters with the one that users get. XLA stops at a flag that it
# does not know, so only the release that is pinned is given it. No device has been asked for yet.
EMITTERS = "--xla_cpu_use_fusion_emitters"
if jax.__version__.startswith("0.10.") and EMITTERS not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {EMITTERS}=false".strip()

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_debug_nans", True)
jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parent.parent / ".jax_cache"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

# Shapes and types written in annotations are checked on every call a test makes.
install_import_hook("shadowjax", "typechecking.check")


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="run the long tests too: large fuzzing, random scenes")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--long"):
        return
    skip = [item for item in items if item.get_closest_marker("long")]
    config.hook.pytest_deselected(items=skip)
    items[:] = [item for item in items if not item.get_closest_marker("long")]


# One relative rounding budget per dtype; tests scale it by what they compute, never by what they observe.
ROUNDING = {jnp.float32: 2e-6, jnp.float64: 1e-13}


# Every compiled program holds memory maps, of which Linux gives a process 65 530; beyond that, XLA crashes.
MOST_MAPS = 20_000


def num_maps():
    """Memory maps of this process, where the system tells."""
    maps = Path("/proc/self/maps")
    return len(maps.read_bytes().splitlines()) if maps.exists() else 0


@pytest.fixture(autouse=True, scope="module")
def forgotten_programs():
    """After a file of tests that leaves a process with many programs, JAX lets go of them."""
    yield
    if num_maps() > MOST_MAPS:
        jax.clear_caches()
        gc.collect()


# Tests of these directories, and files marked `optimised`, hold claims about single roundings or run long loops.
OPTIMISED = ("benchmarks", "oracle", "rays")


@pytest.fixture(autouse=True, scope="module")
def effort_of_the_compiler(request):
    """Compile without most optimisations, except where a test needs them."""
    quick = request.path.parent.name not in OPTIMISED and request.node.get_closest_marker("optimised") is None
    if jax.config.read("jax_disable_most_optimizations") != quick:
        jax.clear_caches()
        jax.config.update("jax_disable_most_optimizations", quick)


@pytest.fixture(params=[jnp.float32, jnp.float64], ids=["float32", "float64"])
def dtype(request):
    """Both dtypes of the package."""
    return request.param


@pytest.fixture
def rounding(dtype):
    """A few roundings of the dtype, relative."""
    return ROUNDING[dtype]
