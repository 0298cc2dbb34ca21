"""Ledger of the multi-depth shadow map source (mdsm): tones, addressing and conventions, cost."""

from shadowjax.analysis.equations import Equation
from shadowjax.analysis.ledger import _mdsm_addressing, _mdsm_cost, _mdsm_tones

EQUATIONS: tuple[Equation, ...] = (*_mdsm_tones.EQUATIONS, *_mdsm_addressing.EQUATIONS, *_mdsm_cost.EQUATIONS)
