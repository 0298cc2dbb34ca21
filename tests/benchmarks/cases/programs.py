"""Compiled work of the package for the cases that only it takes part in, with what compiling took."""

from collections.abc import Callable
from typing import Any

import jax

from tests.benchmarks.ours import planned_megabytes
from tests.benchmarks.timing import resident_growth, timed


def compiled(
    function: Callable[..., Any], *arguments: Any, options: dict[str, Any] | None = None
) -> tuple[Callable[[int], Any], dict[str, Any], Any]:
    """Compile, run once, and describe.

    Args:
        function: Pure work on arrays.
        arguments: What it is called with; they stay arguments, so nothing is folded into the program.
        options: Of the compiler.

    Returns:
        A call to time; seconds of compilation, planned temporaries and growth of the process in megabytes; the result.
    """
    program, milliseconds = timed(lambda: jax.jit(function).lower(*arguments).compile(options))

    def call(step: int) -> Any:
        del step
        return jax.block_until_ready(program(*arguments))

    result, grown = resident_growth(lambda: call(0))
    entry = {
        "compile_s": milliseconds / 1e3,
        "temporaries_mb": planned_megabytes(program),
        "resident_mb": grown,
    }
    return call, entry, result
