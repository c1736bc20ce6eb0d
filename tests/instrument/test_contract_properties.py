"""Whatever is allowed survives the wire; whatever is not never gets there."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.errors import RangeError

hypothesis = pytest.importorskip("hypothesis", reason="property tests need the test extra")
strategies: Any = pytest.importorskip("hypothesis.strategies", reason="property tests need the test extra")

LIMITED = [(c, f) for c in CONTRACTS.values() for f in c.fields if f.minimum is not None]


@hypothesis.given(strategies.data())  # type: ignore[untyped-decorator]
def test_an_allowed_value_comes_back_within_half_a_step_and_any_other_is_refused(data: Any) -> None:
    contract: Contract
    field: Field
    contract, field = data.draw(strategies.sampled_from(LIMITED))
    assert field.minimum is not None
    assert field.maximum is not None
    span = field.maximum - field.minimum or 1.0
    value = data.draw(strategies.floats(field.minimum - span, field.maximum + span) | strategies.floats(allow_nan=True))
    try:
        encoded = contract.encode(field.name, value)
    except RangeError:
        assert not field.minimum <= value <= field.maximum
        return
    back = contract.decode(field.name, encoded)
    assert abs(back - value) <= field.scale / 2 * (1 + 1e-9) + 1e-12 * abs(value)
    assert contract.encode(field.name, back) == encoded
