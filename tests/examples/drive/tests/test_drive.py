"""The drive does what every CANopen device must do."""

import pytest

from palpate.extend import SafetyError
from palpate.testing import CanopenConformance, OnTheBench


class TestDrive(OnTheBench, CanopenConformance):
    kind = "acme-drive"

    def test_its_effort_is_the_torque_and_its_process_data_say_the_same(self, bench, node, simulated):
        node.drive()
        node.sine(10.0, 1.0)
        effort = node.effort()
        assert effort == pytest.approx(40.0 / simulated.rig.scene.rig.coil_resistance, abs=0.1)
        bench.device("sensor_node_1").acquire(0.01)  # sends SYNC
        assert node.received("state") == {"statusword": 4, "torque": effort}
        node.rest()
        assert node.effort() == 0.0

    def test_a_fault_is_told_by_an_emergency_and_the_next_look(self, node, simulated):
        node.drive()
        simulated.trip("over_current")
        with pytest.raises(SafetyError, match="is in fault"):
            node.check()
        assert node.notices() == [f"{node.name}: emergency 0x2310"]
        simulated.fault = False
        node.rest()
