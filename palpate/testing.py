"""Conformance suites for the tests of other packages, which every device kind and every effect must pass.

The pytest plugin provides their fixtures. With `steps` and `InStep` a test looks into a run between two points, or ends
it there: such a listener is called in the run's own thread.
"""

from palpate.procedures.engine.listeners import InStep, steps
from palpate.procedures.testing.canopen_conformance import CanopenConformance
from palpate.procedures.testing.conformance import CanopenGoldenFrames, GoldenFrames, OnTheBench
from palpate.procedures.testing.effect_conformance import EffectConformance
from palpate.procedures.testing.modbus_conformance import ModbusConformance, RtuConformance

__all__ = [
    "CanopenConformance", "CanopenGoldenFrames", "EffectConformance", "GoldenFrames", "InStep", "ModbusConformance",
    "OnTheBench", "RtuConformance", "steps",
]  # fmt: skip
