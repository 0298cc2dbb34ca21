"""Ledger of the warping source: aliasing error, warps for any γ, partitions in depth, and what lies beyond."""

from shadowjax.analysis.equations import Equation
from shadowjax.analysis.ledger import (
    _warping_beyond,
    _warping_choices,
    _warping_general,
    _warping_overhead,
    _warping_partition,
)

EQUATIONS: tuple[Equation, ...] = (
    *_warping_overhead.EQUATIONS,
    *_warping_general.EQUATIONS,
    *_warping_partition.EQUATIONS,
    *_warping_choices.EQUATIONS,
    *_warping_beyond.EQUATIONS,
)
