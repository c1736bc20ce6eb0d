"""The procedures that can be resumed and replayed, by the names in their records."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from palpate.instrument.errors import ConfigError, UsageError
from palpate.procedures.engine.plan import Step
from palpate.procedures.engine.procedure import Procedure, Result
from palpate.procedures.records.run import Run

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

GROUP = "palpate.procedures"
SHIPPED = {
    "sweep-loads": "palpate.procedures.measurements.loads.procedure:LoadSweep",
    "sweep-frequency": "palpate.procedures.measurements.frequency.procedure:FrequencySweep",
    "sweep-temperature": "palpate.procedures.measurements.temperature.procedure:TemperatureSweep",
    "sweep-position": "palpate.procedures.measurements.position.procedure:PositionSweep",
    "calibrate-load-cell": "palpate.procedures.measurements.load_cell.procedure:LoadCellSeries",
    "calibrate-films": "palpate.procedures.measurements.films.procedure:FilmSeries",
    "test-modulus": "palpate.procedures.measurements.modulus.procedure:ModulusTest",
}


def known() -> dict[str, str]:
    """Where the class of each procedure stands, as "module:Class": ours, then those of installed packages.

    Raises ConfigError: two of them have one name.
    """
    found = dict(SHIPPED)
    for entry in entry_points(group=GROUP):
        if entry.name in found:
            raise ConfigError(
                f"two procedures are named {entry.name!r}: {found[entry.name]}, {entry.value}; remove one"
            )
        found[entry.name] = entry.value
    return found


def class_of(run: Run, done: str) -> type[Procedure[Step, DataclassInstance, Result]]:
    """The class of the procedure of a run, which shall be "resumed" or "replayed".

    Raises:
        UsageError: no procedure of that name is known. ConfigError: it is none, or the name is there twice.
    """
    places = known()
    if run.procedure not in places:
        raise UsageError(f"{run.folder}: {run.procedure!r} cannot be {done}; valid: {', '.join(places)}")
    module, _, name = places[run.procedure].partition(":")
    found = vars(import_module(module)).get(name)
    if not (isinstance(found, type) and issubclass(found, Procedure)):
        raise ConfigError(f"{places[run.procedure]} is no procedure; mend the entry point of its package")
    return found
