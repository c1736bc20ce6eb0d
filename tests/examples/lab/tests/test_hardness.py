"""`pytest` runs them on simulated benches, `pytest -s --bench FILE` those that need no simulation on a real one."""

from __future__ import annotations

import pytest
from lab.hardness import force_ratio, harder

from palpate.extend import Bench, Clock, SafetyError, Scene


def test_the_harder_sample_is_found(bench: Bench) -> None:
    assert harder(bench, "2", "1") == "1"
    assert not bench.driving


@pytest.mark.scene("noisy_lab", seed=7)
def test_noise_does_not_turn_the_order_round(bench: Bench, scene: Scene) -> None:
    assert scene.effects["white_noise"]
    assert harder(bench, "4", "5") == "4"


@pytest.mark.scene(faults=[{"kind": "over_current", "on": "shaker_amplifier", "at": "84 s"}])
def test_an_amplifier_that_trips_stops_the_measurement(bench: Bench, clock: Clock) -> None:
    with pytest.raises(SafetyError, match="over_current"):
        force_ratio(bench, "1")
    assert clock.now_ns() > 84e9
