"""Devices that know one quantity: what agrees is not flagged, in any draw of scatter and noise."""

from __future__ import annotations

import pytest

from tests.benchmarks.agreement import DWELLS, false_alarms
from tests.benchmarks.coverage import LOADS, LOUD

SEEDS = 20  # the benchmark `agreement` takes 300


@pytest.mark.slow
def test_films_that_agree_with_load_cell_and_generator_are_not_flagged() -> None:
    assert false_alarms(LOUD, LOUD, range(SEEDS)) == (0, 0, SEEDS * len(LOADS) * len(DWELLS))
