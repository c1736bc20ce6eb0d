"""Whatever is allowed survives the wire; whatever is not never gets there."""

from __future__ import annotations

import math
from random import Random

import pytest

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.errors import RangeError


@pytest.mark.parametrize("name", CONTRACTS)
def test_an_allowed_value_comes_back_within_half_a_step_and_any_other_is_refused(name: str) -> None:
    contract, draw = CONTRACTS[name], Random(name)
    for field in contract.fields:
        low, high = field.minimum, field.maximum
        if low is None or high is None:
            continue
        span = high - low or 1.0
        inside = [low, high, *(draw.uniform(low, high) for _ in range(5))]
        outside = [math.nan, -math.inf, math.inf, low - span, high + span, low - field.scale, high + field.scale]
        for value in inside:
            encoded = contract.encode(field.name, value)
            back = contract.decode(field.name, encoded)
            assert abs(back - value) <= field.scale / 2 * (1 + 1e-9) + 1e-12 * abs(value)
            assert contract.encode(field.name, back) == encoded
        for value in outside:
            with pytest.raises(RangeError):
                contract.encode(field.name, value)
