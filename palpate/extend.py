"""What devices, effects, procedures and sensors of one's own are made of.

    from palpate.extend import Plan, Procedure, Step

A script that only measures needs `palpate` alone, and tests of what is made here find their suites in
`palpate.testing`. The names in `__all__` are public; each is imported on first use, so that a driver does not import
simulators.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import named

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.drivers.clock import Clock
    from palpate.drivers.devices.canopen_device import CanopenDevice
    from palpate.drivers.devices.modbus_device import ModbusDevice
    from palpate.drivers.devices.sensor_node import Recording
    from palpate.drivers.roles import (
        Bias,
        Chamber,
        Exciter,
        LoadIndicator,
        Positioner,
        ProbeStage,
        SampleChanger,
        SensorNode,
    )
    from palpate.instrument.arrays import Floats
    from palpate.instrument.bench.description import BenchDescription, read_bench
    from palpate.instrument.bench.kinds import DeviceKind
    from palpate.instrument.calibration.films import FilmCalibration
    from palpate.instrument.calibration.load_cell import LoadCellCalibration
    from palpate.instrument.calibration.model_calibration import ModelCalibration
    from palpate.instrument.contracts.contract import Contract, Field, Identity, Pdo, probe, sdo
    from palpate.instrument.contracts.own import place
    from palpate.instrument.errors import DeviceError, SafetyError
    from palpate.instrument.findings.film_forces import film_forces
    from palpate.instrument.models.table import Response
    from palpate.instrument.sensor.design import FILM_KINDS, Design, Film, FilmSheet, Plate, Ring, Tooth
    from palpate.instrument.sensor.material import FILM_MATERIALS, Material
    from palpate.procedures.engine.plan import Plan, Predicted, Step
    from palpate.procedures.engine.procedure import (
        Expected,
        Measurement,
        Procedure,
        Report,
        RequiredLoads,
        SimpleResult,
        Work,
        predicted,
        until_full,
    )
    from palpate.procedures.engine.settings import Setting
    from palpate.procedures.lab.lab import Lab, Target
    from palpate.procedures.lab.open import OpenBench
    from palpate.procedures.measurements.work import DynamicLoadWork, StaticLoadWork
    from palpate.procedures.records.columns import Column, gathered
    from palpate.procedures.records.record import Recorder
    from palpate.procedures.steps.checks import preload_for
    from palpate.procedures.steps.films import Films
    from palpate.procedures.steps.probe import press, withdraw
    from palpate.procedures.steps.servo import LoadServo
    from palpate.simulators.linear.periodic import sine
    from palpate.simulators.physics.effect import (
        AmplifierEffect,
        Bound,
        CanEffect,
        CellEffect,
        ConverterEffect,
        DriveEffect,
        FilmsEffect,
        HysteresisEffect,
        InputEffect,
        Kind,
        LeakEffect,
        LineEffect,
        ShakerEffect,
        ShareEffect,
        SourceEffect,
        StackEffect,
    )
    from palpate.simulators.planning.plan import Question, driven
    from palpate.simulators.planning.settle import read_scene
    from palpate.simulators.randomness import Stream
    from palpate.simulators.rig import Rig
    from palpate.simulators.scenes.scene import Scene
    from palpate.simulators.wire.canopen_device import SimulatedNode
    from palpate.simulators.wire.device import DEVICE_FAILURE, Refused, SimulatedDevice

_PLACES = {
    "drivers.bench": "Bench",
    "drivers.clock": "Clock",
    "drivers.devices.canopen_device": "CanopenDevice",
    "drivers.devices.modbus_device": "ModbusDevice",
    "drivers.devices.sensor_node": "Recording",
    "drivers.roles": "Bias Chamber Exciter LoadIndicator Positioner ProbeStage SampleChanger SensorNode",
    "instrument.arrays": "Floats",
    "instrument.bench.description": "BenchDescription read_bench",
    "instrument.bench.kinds": "DeviceKind",
    "instrument.calibration.films": "FilmCalibration",
    "instrument.calibration.load_cell": "LoadCellCalibration",
    "instrument.calibration.model_calibration": "ModelCalibration",
    "instrument.contracts.contract": "Contract Field Identity Pdo probe sdo",
    "instrument.contracts.own": "place",
    "instrument.errors": "DeviceError SafetyError",
    "instrument.findings.film_forces": "film_forces",
    "instrument.models.table": "Response",
    "instrument.sensor.design": "Design Film FILM_KINDS FilmSheet Plate Ring Tooth",
    "instrument.sensor.material": "FILM_MATERIALS Material",
    "procedures.engine.plan": "Plan Predicted Step",
    "procedures.engine.procedure": "Expected Measurement Procedure Report RequiredLoads SimpleResult Work predicted"
    " until_full",
    "procedures.engine.settings": "Setting",
    "procedures.lab.lab": "Lab Target",
    "procedures.lab.open": "OpenBench",
    "procedures.measurements.work": "DynamicLoadWork StaticLoadWork",
    "procedures.records.columns": "Column gathered",
    "procedures.records.record": "Recorder",
    "procedures.steps.checks": "preload_for",
    "procedures.steps.films": "Films",
    "procedures.steps.probe": "press withdraw",
    "procedures.steps.servo": "LoadServo",
    "simulators.linear.periodic": "sine",
    "simulators.physics.effect": "AmplifierEffect Bound CanEffect CellEffect ConverterEffect DriveEffect FilmsEffect"
    " HysteresisEffect InputEffect Kind LeakEffect LineEffect ShakerEffect ShareEffect SourceEffect StackEffect",
    "simulators.planning.plan": "driven Question",
    "simulators.planning.settle": "read_scene",
    "simulators.randomness": "Stream",
    "simulators.rig": "Rig",
    "simulators.scenes.scene": "Scene",
    "simulators.wire.canopen_device": "SimulatedNode",
    "simulators.wire.device": "DEVICE_FAILURE Refused SimulatedDevice",
}

__all__ = [
    "DEVICE_FAILURE",
    "FILM_KINDS",
    "FILM_MATERIALS",
    "AmplifierEffect",
    "Bench",
    "BenchDescription",
    "Bias",
    "Bound",
    "CanEffect",
    "CanopenDevice",
    "CellEffect",
    "Chamber",
    "Clock",
    "Column",
    "Contract",
    "ConverterEffect",
    "Design",
    "DeviceError",
    "DeviceKind",
    "DriveEffect",
    "DynamicLoadWork",
    "Exciter",
    "Expected",
    "Field",
    "Film",
    "FilmCalibration",
    "FilmSheet",
    "Films",
    "FilmsEffect",
    "Floats",
    "HysteresisEffect",
    "Identity",
    "InputEffect",
    "Kind",
    "Lab",
    "LeakEffect",
    "LineEffect",
    "LoadCellCalibration",
    "LoadIndicator",
    "LoadServo",
    "Material",
    "Measurement",
    "ModbusDevice",
    "ModelCalibration",
    "OpenBench",
    "Pdo",
    "Plan",
    "Plate",
    "Positioner",
    "Predicted",
    "ProbeStage",
    "Procedure",
    "Question",
    "Recorder",
    "Recording",
    "Refused",
    "Report",
    "RequiredLoads",
    "Response",
    "Rig",
    "Ring",
    "SafetyError",
    "SampleChanger",
    "Scene",
    "SensorNode",
    "Setting",
    "ShakerEffect",
    "ShareEffect",
    "SimpleResult",
    "SimulatedDevice",
    "SimulatedNode",
    "SourceEffect",
    "StackEffect",
    "StaticLoadWork",
    "Step",
    "Stream",
    "Target",
    "Tooth",
    "Work",
    "driven",
    "film_forces",
    "gathered",
    "place",
    "predicted",
    "preload_for",
    "press",
    "probe",
    "read_bench",
    "read_scene",
    "sdo",
    "sine",
    "until_full",
    "withdraw",
]

if not TYPE_CHECKING:  # with `__getattr__` a type checker would accept any name

    def __getattr__(name):
        return named(__name__, _PLACES, name)
