"""For the tests of a package of one's own: what every device and every effect must do.

The fixtures come with the pytest plugin.
"""

from palpate.procedures.testing.canopen_conformance import CanopenConformance
from palpate.procedures.testing.effect_conformance import EffectConformance
from palpate.procedures.testing.golden import GoldenFrames
from palpate.procedures.testing.modbus_conformance import ModbusConformance, RtuConformance
from palpate.procedures.testing.on_the_bench import OnTheBench

__all__ = [
    "CanopenConformance", "EffectConformance", "GoldenFrames", "ModbusConformance", "OnTheBench", "RtuConformance",
]  # fmt: skip
