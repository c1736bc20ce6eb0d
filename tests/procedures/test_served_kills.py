"""Sweeps on a served bench that are killed, stopped and meddled with: a share of `tests.benchmarks served_kills`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.served_kills import FAULTS, rounds


@pytest.mark.slow
def test_no_point_is_that_of_another_sample_or_lost_or_silently_missing(
    tmp_path: Path, nothing_left_behind: None
) -> None:
    """Seeds whose blows are a kill, each other signal, a hand at the sample and another client's order."""
    with rounds(tmp_path, "real_bench") as played:
        found = Counter(played.play(11))
    assert {what: found[what] for what in FAULTS if found[what]} == {}
    assert found["killed"] > 0
    assert found["interrupted"] > 0
    assert found["resumed"] > 0
    assert found["noticed"] > 0
