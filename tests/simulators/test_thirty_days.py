"""A scene after a month: reached by its changes alone, exact there, whatever samples are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.linear.periodic import HERTZ
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Rig
from tests.simulators.rigs import MS, SECOND, pressed

pytestmark = pytest.mark.slow

MONTH = 30 * 86_400
PRESSED = 2e-3  # m: tissue creeps away from a probe that merely touches it


@pytest.mark.parametrize("name", ["noisy_lab", "humid_body", "long_drift"])
def test_a_second_of_samples_after_30_days_costs_no_more_than_the_changes_before(name: str) -> None:
    clock, chosen = VirtualClock(), read_scene(name)
    rig = Rig(chosen, clock)
    clock.add(rig)
    pressed(rig, "2", chosen.rig.sensor_position + PRESSED, 1.0)
    clock.wait(MONTH)
    assert rig.changes <= 3 + 1000  # of a leak that creeps in by 1000 parts
    times = MONTH * SECOND + MS * np.arange(1, 1001)
    whole, pieces = SimulatedSensorNode(clock, 1, 1, rig), SimulatedSensorNode(clock, 1, 1, rig)

    def counts(node: SimulatedSensorNode, some: np.ndarray[tuple[int], np.dtype[np.int64]]) -> bytes:
        return node.sample(some, node.film_channels @ rig.film_voltages(some, MS), MS).counts.tobytes()

    taken = counts(whole, times)
    assert b"".join(counts(pieces, times[at : at + 333]) for at in range(0, 1000, 333)) == taken
    # What is left after a month is the steady state: one sine of the drive's own frequency.
    films = rig.film_voltages(times, MS)
    frequency = rig.coil_voltage().frequency / HERTZ
    phasors = 2 * (films - films.mean(axis=1, keepdims=True)) @ np.exp(-2e-9j * np.pi * frequency * (times - times[0]))
    assert np.abs(phasors) / len(times) == pytest.approx(np.abs(rig.transfer(frequency)[:-1]), rel=1e-6)
