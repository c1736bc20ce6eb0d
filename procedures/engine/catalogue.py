"""All known procedures by name: palpate's own, and those that installed packages add.

Their names are known at once; a class is imported, with all that a procedure needs, when it is asked for.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.additions import Addition, addition, additions, check_ours, load_addition, unusable
from palpate.instrument.errors import UnknownName, UsageError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.procedures.engine.plan import Step
    from palpate.procedures.engine.procedure import P, Procedure, R, Result, S
    from palpate.procedures.records.run import Run

GROUP, WHAT = "palpate.procedures", "procedure"
SHIPPED = {
    "sweep-loads": "palpate.procedures.measurements.loads:LoadSweep",
    "sweep-frequency": "palpate.procedures.measurements.frequency:FrequencySweep",
    "sweep-temperature": "palpate.procedures.measurements.temperature:TemperatureSweep",
    "sweep-position": "palpate.procedures.measurements.position:PositionSweep",
    "calibrate-load-cell": "palpate.procedures.measurements.load_cell.procedure:LoadCellSeries",
    "calibrate-films": "palpate.procedures.measurements.films:FilmSeries",
    "calibrate-model": "palpate.procedures.measurements.references:ReferenceSeries",
    "test-modulus": "palpate.procedures.measurements.modulus:ModulusTest",
    "measure-modulus": "palpate.procedures.measurements.object_modulus.procedure:ObjectModulus",
    "softness": "palpate.procedures.measurements.softness:SoftnessTest",
    "characterise": "palpate.procedures.measurements.characterise.procedure:Characterisation",
}


def names() -> list[str]:
    """Names of all procedures: palpate's own, then those of installed packages, even if they cannot be used."""
    return list(dict.fromkeys((*SHIPPED, *additions(GROUP))))


def procedure_class(name: str) -> type[Procedure[Step, DataclassInstance, Result]]:
    """The class of a procedure by its name.

    Raises:
        UnknownName: there is no procedure of that name.
        ConfigError: the package that adds it cannot be used.
    """
    from palpate.procedures.engine.procedure import Procedure

    if name in SHIPPED:
        check_ours(GROUP, WHAT, [name])  # so that a package cannot replace it
        added: Addition | None = Addition(name, SHIPPED[name], "palpate", "")
    else:
        added = addition(GROUP, WHAT, name)
    if added is None:
        raise UnknownName(WHAT, name, names())
    found = load_addition(added, WHAT)
    if not (isinstance(found, type) and issubclass(found, Procedure) and getattr(found, "name", None) == name):
        raise unusable(added, WHAT, f"is no Procedure that is called {name!r}")
    return found


def class_of(run: Run, done: str) -> type[Procedure[Step, DataclassInstance, Result]]:
    """The class of a run's procedure; `done` is "resume" or "replay", what is done with it.

    Raises:
        UsageError: no procedure of that name is known.
        ConfigError: the package that adds it cannot be used.
    """
    try:
        return procedure_class(run.procedure)
    except UnknownName:
        origin = f" of {run.header['procedure_from']}" if "procedure_from" in run.header else ""
        raise UsageError(
            f"{run.folder}: {run.procedure!r}{origin} cannot be {done}d without its class: install its package, or "
            f"give the class to palpate.{done} in a script; known: {', '.join(names())}"
        ) from None


def class_before(run: Run, kind: type[Procedure[Any, Any, Any]]) -> type[Procedure[Any, Any, Any]]:
    """The class of a run that came before one of class `kind` on the same bench.

    A script may have defined it: then it is known as soon as the script has. Raises as `class_of` does.
    """
    from palpate.procedures.engine.procedure import Procedure

    defined: list[type[Procedure[Any, Any, Any]]] = [kind, *reversed(Procedure.__subclasses__())]
    for each in defined:
        if getattr(each, "name", None) == run.procedure and run.procedure not in names():
            return each
        defined += reversed(each.__subclasses__())
    return class_of(run, "resume")


def outside(kind: type[Procedure[S, P, R]]) -> Addition | None:
    """Where a procedure that is not palpate's own comes from; None: it is palpate's own.

    The package is that of the entry point that names the class. A class that none names is of a script: the script's
    file then stands for the package, without a version.
    """
    if kind.__module__.startswith("palpate."):
        return None
    for added in additions(GROUP).get(kind.name, ()):
        module, _, name = added.place.partition(":")
        if getattr(sys.modules.get(module), name, None) is kind:
            return added
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return Addition(kind.name, kind.__module__, Path(file).name if file else kind.__module__, "")
