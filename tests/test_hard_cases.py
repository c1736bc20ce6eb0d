"""Hard cases keep the digits that they have beside references that share no solver with them."""

from __future__ import annotations

import math

import pytest

from tests.hard_cases import CASES


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_digits_agree(name: str) -> None:
    case = CASES[name]
    assert -math.log10(case.error()) >= case.least
