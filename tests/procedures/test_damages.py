"""No damage of what is read back is silent, and every whole point comes back; a share of the campaign."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.damages import BAD, VICTIMS, damages


@pytest.mark.parametrize(
    "share", [range(60), pytest.param(range(60, 1000), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_no_damage_is_silent_and_every_whole_point_is_returned(tmp_path: Path, share: range) -> None:
    found, bad = Counter[str](), []
    with damages(tmp_path) as damage:
        for number in share:
            victim, came = damage(number)
            found[victim] += 1
            bad += [(number, victim, came)] * any(what in BAD for what in came)
    assert bad == []
    assert found.keys() == VICTIMS.keys()
