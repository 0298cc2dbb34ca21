"""Ledger of the warping source: aliasing error, warps for any γ, partitions in depth, and what lies beyond."""

from shadowjax.ledger.equation import Equation
from shadowjax.ledger.warping import beyond, choices, general, logarithmic, overhead, partition

EQUATIONS: tuple[Equation, ...] = (
    *overhead.EQUATIONS,
    *general.EQUATIONS,
    *partition.EQUATIONS,
    *choices.EQUATIONS,
    *logarithmic.EQUATIONS,
    *beyond.EQUATIONS,
)
