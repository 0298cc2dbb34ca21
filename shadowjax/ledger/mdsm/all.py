"""Ledger of the multi-depth shadow map source (mdsm): tones, addressing and conventions, cost."""

from shadowjax.ledger.equation import Equation
from shadowjax.ledger.mdsm import addressing, cost, tones

EQUATIONS: tuple[Equation, ...] = (*tones.EQUATIONS, *addressing.EQUATIONS, *cost.EQUATIONS)
