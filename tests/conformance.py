"""What every device must do, by kind of bus. A new device's test inherits one of these and says which it is:

class TestSignalGenerator(ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.generator, sim.generator
"""

from __future__ import annotations

from tests.canopen_conformance import CanopenConformance
from tests.modbus_conformance import ModbusConformance, RtuConformance

__all__ = ["CanopenConformance", "ModbusConformance", "RtuConformance"]
