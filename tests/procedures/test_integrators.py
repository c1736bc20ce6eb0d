"""What each method that integrates in time costs, with its failures left in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.simulators.linear import integrators
from palpate.simulators.linear.integrators import STATES, STIFFNESS, IntegratorError, chain, compare


@pytest.fixture(scope="module")
def measured() -> list[IntegratorError]:
    """Each method once, on a short record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(integrators, "DURATION", 1.0)
        patch.setattr(integrators, "REPEATED", 0.0)
        patch.setattr(integrators, "TOLERANCES", {"Radau": (1e-3,), "LSODA": (1e-6, 1e-9)})
        return list(compare())


def test_the_chain_is_as_stiff_and_as_large_as_is_said() -> None:
    rates = np.abs(np.linalg.eigvals(chain().a))
    assert len(rates) == STATES
    assert rates.max() / rates.min() == pytest.approx(STIFFNESS, rel=1e-9)


def test_exact_methods_are_exact_and_the_others_as_good_as_their_order_says(measured: list[IntegratorError]) -> None:
    rows: dict[str, list[IntegratorError]] = {}
    for row in measured:
        rows.setdefault(row.method, []).append(row)
    errors: dict[str, Any] = {method: [row.error for row in own] for method, own in rows.items()}
    assert errors["closed form"][0] < 1e-12
    assert errors["matrix exponential, blocks"][0] < 1e-9
    for method in ("first-order hold", "trapezoid"):  # second order: a step ten times finer is a hundred times better
        assert errors[method][1] / errors[method][2] == pytest.approx(100, rel=0.05)
    assert errors["Radau"][0] < 1e-2
    assert errors["LSODA"][1] < errors["LSODA"][0] < 1e-4
    fails, holds = rows["explicit Euler"]  # 2.1 and 1.9 us: a microsecond is followed up to a step of two
    assert (fails.error, fails.failure) == (None, "diverges")
    assert holds.error is not None and holds.error < 1e-2
