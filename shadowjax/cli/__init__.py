"""The command line: `shadowjax report | render | compare | verify | optimize | scenes`."""

from shadowjax.cli.main import main

__all__ = ["main"]
