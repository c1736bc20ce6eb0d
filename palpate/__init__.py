"""Palpate: drivers, simulators and procedures for a bench that tests piezoelectric tactile sensors.

    import palpate
    with palpate.open_bench(scene="thesis_single", seed=3) as bench:
        sweep = palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0))
        done = palpate.run(sweep, bench, out="first")
    print(done.run.table())  # a DataFrame

The names in `__all__` are public and stable; each is imported on first use. Modules below `palpate.` may change.

Import palpate before numpy: the same scene and seed then give the same bytes as a command, on every x86-64 processor.

The folders `drivers`, `instrument`, `simulators` and `procedures` lie at the top of the repository. Symbolic links in
this package give them import names (`palpate.drivers`) that do not collide with folders of a laboratory.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.instrument.calibration.files import read_calibration, read_film_calibration, read_model_calibration
    from palpate.instrument.calibration.films import FilmCalibration
    from palpate.instrument.calibration.load_cell import LoadCellCalibration
    from palpate.instrument.calibration.model_calibration import ModelCalibration
    from palpate.instrument.errors import (
        BenchError,
        ConfigError,
        EstimateError,
        PalpateError,
        RangeError,
        RecordError,
        UnknownName,
        UsageError,
    )
    from palpate.instrument.models.response import response
    from palpate.instrument.models.table import Response
    from palpate.instrument.sensor.designs import get_design
    from palpate.instrument.sensor.load import Load
    from palpate.instrument.sensor.sample import get_sample
    from palpate.procedures.engine.dataset import as_dataset
    from palpate.procedures.engine.plan import Plan, Predicted, Step
    from palpate.procedures.engine.procedure import (
        Finished,
        Measurement,
        Procedure,
        Report,
        RequiredLoads,
        Work,
    )
    from palpate.procedures.engine.replay import replay
    from palpate.procedures.engine.result import SimpleResult
    from palpate.procedures.engine.resume import resume
    from palpate.procedures.engine.run import plan, run
    from palpate.procedures.engine.settings import Setting
    from palpate.procedures.lab.lab import Lab, Target
    from palpate.procedures.lab.open import OpenBench, open_bench
    from palpate.procedures.measurements.characterise.procedure import Characterisation
    from palpate.procedures.measurements.dynamic_load import DynamicLoadWork
    from palpate.procedures.measurements.films.procedure import FilmSeries
    from palpate.procedures.measurements.frequency.procedure import FrequencySweep
    from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
    from palpate.procedures.measurements.loads.procedure import LoadSweep
    from palpate.procedures.measurements.modulus.procedure import ModulusTest
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus
    from palpate.procedures.measurements.position.procedure import PositionSweep
    from palpate.procedures.measurements.references.procedure import ReferenceSeries
    from palpate.procedures.measurements.references.reference import Reference, read_reference
    from palpate.procedures.measurements.softness.procedure import SoftnessTest, unknown_object
    from palpate.procedures.measurements.static_load import StaticLoadWork
    from palpate.procedures.measurements.temperature.procedure import TemperatureSweep
    from palpate.procedures.records.columns import Column, gathered
    from palpate.procedures.records.record import Recorder
    from palpate.procedures.records.run import Run, read

_PLACES = {
    "instrument.calibration.files": "read_calibration read_film_calibration read_model_calibration",
    "instrument.calibration.films": "FilmCalibration",
    "instrument.calibration.load_cell": "LoadCellCalibration",
    "instrument.calibration.model_calibration": "ModelCalibration",
    "instrument.errors": "BenchError ConfigError EstimateError PalpateError RangeError RecordError UnknownName"
    " UsageError",
    "instrument.models.response": "response",
    "instrument.models.table": "Response",
    "instrument.sensor.designs": "get_design",
    "instrument.sensor.load": "Load",
    "instrument.sensor.sample": "get_sample",
    "procedures.engine.dataset": "as_dataset",
    "procedures.engine.plan": "Plan Predicted Step",
    "procedures.engine.procedure": "Finished Measurement Procedure Report RequiredLoads Work",
    "procedures.engine.replay": "replay",
    "procedures.engine.result": "SimpleResult",
    "procedures.engine.resume": "resume",
    "procedures.engine.run": "plan run",
    "procedures.engine.settings": "Setting",
    "procedures.lab.lab": "Lab Target",
    "procedures.lab.open": "OpenBench open_bench",
    "procedures.measurements.characterise.procedure": "Characterisation",
    "procedures.measurements.dynamic_load": "DynamicLoadWork",
    "procedures.measurements.films.procedure": "FilmSeries",
    "procedures.measurements.frequency.procedure": "FrequencySweep",
    "procedures.measurements.load_cell.procedure": "LoadCellSeries",
    "procedures.measurements.loads.procedure": "LoadSweep",
    "procedures.measurements.modulus.procedure": "ModulusTest",
    "procedures.measurements.object_modulus.procedure": "ObjectModulus",
    "procedures.measurements.position.procedure": "PositionSweep",
    "procedures.measurements.references.procedure": "ReferenceSeries",
    "procedures.measurements.references.reference": "Reference read_reference",
    "procedures.measurements.softness.procedure": "SoftnessTest unknown_object",
    "procedures.measurements.static_load": "StaticLoadWork",
    "procedures.measurements.temperature.procedure": "TemperatureSweep",
    "procedures.records.columns": "Column gathered",
    "procedures.records.record": "Recorder",
    "procedures.records.run": "Run read",
}

__all__ = [
    "BenchError",
    "Characterisation",
    "Column",
    "ConfigError",
    "DynamicLoadWork",
    "EstimateError",
    "FilmCalibration",
    "FilmSeries",
    "Finished",
    "FrequencySweep",
    "Lab",
    "Load",
    "LoadCellCalibration",
    "LoadCellSeries",
    "LoadSweep",
    "Measurement",
    "ModelCalibration",
    "ModulusTest",
    "ObjectModulus",
    "OpenBench",
    "PalpateError",
    "Plan",
    "PositionSweep",
    "Predicted",
    "Procedure",
    "RangeError",
    "RecordError",
    "Recorder",
    "Reference",
    "ReferenceSeries",
    "Report",
    "RequiredLoads",
    "Response",
    "Run",
    "Setting",
    "SimpleResult",
    "SoftnessTest",
    "StaticLoadWork",
    "Step",
    "Target",
    "TemperatureSweep",
    "UnknownName",
    "UsageError",
    "Work",
    "as_dataset",
    "gathered",
    "get_design",
    "get_sample",
    "open_bench",
    "plan",
    "read",
    "read_calibration",
    "read_film_calibration",
    "read_model_calibration",
    "read_reference",
    "replay",
    "response",
    "resume",
    "run",
    "unknown_object",
]

if not (_LINK := Path(__file__).parent / "procedures").is_dir():
    raise ImportError(
        f"{_LINK} is no symbolic link to a folder: this checkout was made without links, as from a zip; "
        "clone with `git clone -c core.symlinks=true`, or install a wheel, as `pip install .` does"
    )

if "numpy" not in sys.modules:
    from palpate.instrument.arithmetic import same_everywhere

    same_everywhere()

if not TYPE_CHECKING:  # with `__getattr__` a type checker would accept any name

    def __getattr__(name):
        from importlib import import_module

        for module, names in _PLACES.items():
            if name in names.split():
                found = globals()[name] = getattr(import_module(f"{__name__}.{module}"), name)
                return found
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
