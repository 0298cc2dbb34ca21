"""The equations of the sources, one module for each; every module exports `EQUATIONS: tuple[Equation, ...]`."""
