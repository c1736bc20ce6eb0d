"""On the rigid support the probe presses the sample alone, or the bare support, and no film feels it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.errors import BenchError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.rig import SUPPORT_STIFFNESS, Rig
from tests.simulators.rigs import BALANCE, scene

SUSPENSION = 1000.0  # N/m


@pytest.mark.parametrize("sample", ["1", "2", None])
def test_the_force_is_that_of_suspension_sample_and_support_in_series(sample: str | None) -> None:
    rig = Rig(scene(), VirtualClock())
    pad = None if sample is None else SAMPLES[sample]
    rig.lay_on_support(pad)
    contact = BALANCE if pad else BALANCE + 3e-3
    yielding = 1 / SUSPENSION + 1 / SUPPORT_STIFFNESS + (pad.thickness / (pad.modulus * pad.area) if pad else 0.0)
    now = np.array([0])
    for advance in (-1e-3, 0.0, 1e-3, 4e-3):
        rig.set_position(contact + advance)
        assert rig.cell_force(now)[0] == pytest.approx(max(advance, 0.0) / yielding, abs=1e-12)
        assert (rig.film_voltages(now) == 0).all()


def test_a_sample_on_the_sensor_is_felt_again_after_the_support() -> None:
    rig = Rig(scene(), VirtualClock())
    rig.lay_on_support(SAMPLES["1"])
    rig.mount(SAMPLES["1"])
    rig.set_position(BALANCE + 2e-3)
    assert (rig.film_voltages(np.array([0])) > 0).all()


def test_nobody_reaches_under_a_lowered_probe(sim: SimulatedBench) -> None:
    sim.rig.set_position(5e-3)
    with pytest.raises(BenchError, match="the probe stands at 5 mm: move it home before"):
        sim.operator.lay_on_support(None)
