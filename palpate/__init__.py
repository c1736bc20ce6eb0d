"""Palpate: drivers, simulators and procedures for a bench that tests piezoelectric tactile sensors.

    import palpate
    with palpate.open_bench(scene="thesis_single", seed=3) as bench:
        sweep = palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0))
        done = palpate.run(sweep, bench, out="first")
    print(done.run.table())  # a DataFrame

The names in `__all__` are public and stable; each is imported on first use. What devices, effects and procedures of
one's own need is in `palpate.extend`. Other modules below `palpate.` may change.

Import palpate before numpy: the same scene and seed then give the same bytes as a command, on every x86-64 processor.

The folders `drivers`, `instrument`, `simulators` and `procedures` lie at the top of the repository. Symbolic links in
this package give them import names (`palpate.drivers`) that do not collide with folders of a laboratory.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.instrument.calibration.files import read_calibration
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
    from palpate.instrument.sensor.designs import get_design
    from palpate.instrument.sensor.sample import Load, get_sample
    from palpate.procedures.engine.dataset import as_dataset
    from palpate.procedures.engine.listeners import watch
    from palpate.procedures.engine.procedure import Finished
    from palpate.procedures.engine.replay import replay
    from palpate.procedures.engine.resume import resume
    from palpate.procedures.engine.run import plan, run
    from palpate.procedures.engine.verdict import judge
    from palpate.procedures.lab.open import open_bench
    from palpate.procedures.lab.run_table import runs
    from palpate.procedures.measurements.characterise.procedure import Characterisation
    from palpate.procedures.measurements.films import FilmSeries
    from palpate.procedures.measurements.frequency import FrequencySweep
    from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
    from palpate.procedures.measurements.loads import LoadSweep
    from palpate.procedures.measurements.modulus import ModulusTest
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus
    from palpate.procedures.measurements.position import PositionSweep
    from palpate.procedures.measurements.references import Reference, ReferenceSeries, read_reference
    from palpate.procedures.measurements.softness import SoftnessTest, unknown_object
    from palpate.procedures.measurements.temperature import TemperatureSweep
    from palpate.procedures.records.events import Event
    from palpate.procedures.records.run import Run, read

_PLACES = {
    "instrument.calibration.files": "read_calibration",
    "instrument.errors": "BenchError ConfigError EstimateError PalpateError RangeError RecordError UnknownName"
    " UsageError",
    "instrument.models.response": "response",
    "instrument.sensor.designs": "get_design",
    "instrument.sensor.sample": "get_sample Load",
    "procedures.engine.dataset": "as_dataset",
    "procedures.engine.listeners": "watch",
    "procedures.engine.procedure": "Finished",
    "procedures.engine.replay": "replay",
    "procedures.engine.resume": "resume",
    "procedures.engine.run": "plan run",
    "procedures.engine.verdict": "judge",
    "procedures.lab.open": "open_bench",
    "procedures.lab.run_table": "runs",
    "procedures.measurements.characterise.procedure": "Characterisation",
    "procedures.measurements.films": "FilmSeries",
    "procedures.measurements.frequency": "FrequencySweep",
    "procedures.measurements.load_cell.procedure": "LoadCellSeries",
    "procedures.measurements.loads": "LoadSweep",
    "procedures.measurements.modulus": "ModulusTest",
    "procedures.measurements.object_modulus.procedure": "ObjectModulus",
    "procedures.measurements.position": "PositionSweep",
    "procedures.measurements.references": "Reference ReferenceSeries read_reference",
    "procedures.measurements.softness": "SoftnessTest unknown_object",
    "procedures.measurements.temperature": "TemperatureSweep",
    "procedures.records.events": "Event",
    "procedures.records.run": "read Run",
}

__all__ = [
    "BenchError",
    "Characterisation",
    "ConfigError",
    "EstimateError",
    "Event",
    "FilmSeries",
    "Finished",
    "FrequencySweep",
    "Load",
    "LoadCellSeries",
    "LoadSweep",
    "ModulusTest",
    "ObjectModulus",
    "PalpateError",
    "PositionSweep",
    "RangeError",
    "RecordError",
    "Reference",
    "ReferenceSeries",
    "Run",
    "SoftnessTest",
    "TemperatureSweep",
    "UnknownName",
    "UsageError",
    "as_dataset",
    "get_design",
    "get_sample",
    "judge",
    "open_bench",
    "plan",
    "read",
    "read_calibration",
    "read_reference",
    "replay",
    "response",
    "resume",
    "run",
    "runs",
    "unknown_object",
    "watch",
]

if not (_LINK := Path(__file__).parent / "procedures").is_dir():
    raise ImportError(
        f"{_LINK} is no symbolic link to a folder: this checkout was made without links, as from a zip; "
        "clone with `git clone -c core.symlinks=true`, or install a wheel, as `pip install .` does"
    )

if "numpy" not in sys.modules:
    from palpate.instrument.arithmetic import same_everywhere

    same_everywhere()


def named(module: str, places: Mapping[str, str], name: str) -> object:
    """A public name of a module, imported on first use. `places`: the names of each module below `palpate`.

    Raises AttributeError: there is no such name.
    """
    from importlib import import_module

    for place, names in places.items():
        if name in names.split():
            found = vars(sys.modules[module])[name] = getattr(import_module(f"{__name__}.{place}"), name)
            return found
    raise AttributeError(f"module {module!r} has no attribute {name!r}")


if not TYPE_CHECKING:  # with `__getattr__` a type checker would accept any name

    def __getattr__(name):
        return named(__name__, _PLACES, name)
