"""Every equation of the warping source: closed form = derivation = measurement, and printed errata refuted."""

import pytest

from shadowjax.analysis.equations import check
from shadowjax.analysis.ledger import warping

BY_ID = {equation.id: equation for equation in warping.EQUATIONS}


@pytest.mark.parametrize("name", BY_ID)
def test_equation_holds_as_its_verdict_says(name):
    result = check(BY_ID[name])
    assert result.checks
    assert result.passed, [one for one in result.checks if not one.passed]
