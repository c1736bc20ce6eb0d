"""Who may drive: a claim, how long that of a killed program is waited for, and what a person is told."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.ownership import CLAIMS, cautions, claim
from palpate.instrument.errors import BenchInUse
from palpate.simulators.clock import VirtualClock

WATCHDOG = 2.0  # s


class Guard:
    """Belongs to another program for so many claims."""

    name = "amplifier"

    def __init__(self, refusals: int, owned: bool = True) -> None:
        self.refusals, self.owned, self.claims = refusals, owned, 0

    def claim(self) -> bool:
        self.claims += 1
        return self.claims > self.refusals

    def get(self, name: str) -> float:
        return {"watchdog": WATCHDOG}[name]


@pytest.mark.parametrize("refusals", [0, 1, CLAIMS, CLAIMS + 1])
def test_a_claim_is_tried_at_once_and_then_until_the_watchdog_s_time_is_over(refusals: int) -> None:
    guard: Any = Guard(refusals)
    clock, told = VirtualClock(), list[str]()
    begun = clock.now_ns()
    if refusals <= CLAIMS:
        claim(guard, clock, told.append)
    else:
        with pytest.raises(BenchInUse, match=r"^amplifier: belongs to another program, .*; wait for it or end it$"):
            claim(guard, clock, told.append)
    waits = min(refusals, CLAIMS)
    assert guard.claims == waits + 1
    assert clock.now_ns() - begun == pytest.approx(1e9 * WATCHDOG * waits / CLAIMS)
    assert len(told) == (refusals > 0)
    assert all(re.match("amplifier: is busy, or belongs to another program .*waiting 2 s", text) for text in told)


@pytest.mark.parametrize(
    ("exciter", "said"),
    [
        (None, []),
        (SimpleNamespace(guard=Guard(0)), []),
        (SimpleNamespace(guard=Guard(0, owned=False)), ["amplifier: any request feeds its watchdog"]),
        (SimpleNamespace(guard=None, members=(SimpleNamespace(name="drive"),)), ["drive: has no watchdog"]),
    ],
)
def test_a_person_is_told_why_the_output_could_stay_on(exciter: Any, said: list[str]) -> None:
    found = cautions(exciter)
    assert len(found) == len(said)
    assert all(text.startswith(begins) for text, begins in zip(found, said, strict=True))
