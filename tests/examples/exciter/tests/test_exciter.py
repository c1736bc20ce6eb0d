"""The exciter does what every device must do."""

from pathlib import Path

import pytest

from palpate.extend import SafetyError
from palpate.testing import GoldenFrames, ModbusConformance, OnTheBench


class TestExciter(GoldenFrames, OnTheBench, ModbusConformance):
    kind = "acme-exciter"
    golden = Path(__file__).with_name("exciter.toml")

    def test_its_effort_is_the_current_of_the_coil(self, device, simulated):
        device.drive()
        device.sine(10.0, 1.0)
        assert device.effort() == pytest.approx(2.0 / simulated.rig.scene.rig.coil_resistance, abs=1e-3)
        device.rest()
        assert device.effort() == 0.0

    def test_a_trip_is_told(self, device, simulated):
        device.drive()
        simulated.trip("over_current")
        with pytest.raises(SafetyError, match="has tripped"):
            device.check()
        device.rest()
