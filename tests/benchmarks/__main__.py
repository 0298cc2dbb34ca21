"""The command `python -m tests.benchmarks`: measure everybody in one run, print tables, write the results."""

import os
import sys

import jax
import tyro
from rich.console import Console

from tests.benchmarks.run import Options, run


def main() -> int:
    """Run from the repository root; exit code 2 and one line for bad input."""
    options = tyro.cli(Options, prog="python -m tests.benchmarks", description=__doc__)
    # What compiling takes is measured, so nothing comes from an earlier run.
    jax.config.update("jax_enable_compilation_cache", False)
    jax.config.update("jax_num_cpu_devices", options.devices or os.cpu_count() or 1)
    try:
        run(options)
    except ValueError as error:
        Console(stderr=True).print(f"error: {error}", style="red", highlight=False)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
