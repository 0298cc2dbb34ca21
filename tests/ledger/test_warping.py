"""Every equation of the warping source: closed form = derivation = measurement, and printed errata refuted."""

import pytest

from shadowjax.ledger.equation import check
from shadowjax.ledger.warping import all

BY_ID = {equation.id: equation for equation in all.EQUATIONS}


@pytest.mark.parametrize("name", BY_ID)
def test_equation_holds_as_its_verdict_says(name):
    result = check(BY_ID[name])
    assert result.checks
    assert result.passed, [one for one in result.checks if not one.passed]
