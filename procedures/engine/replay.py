"""Repeats a recorded run from its bus log."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, overload

from palpate.instrument.arithmetic import alike
from palpate.instrument.errors import PalpateError
from palpate.procedures.engine.catalogue import class_of, procedure_class
from palpate.procedures.engine.conduct import evaluated, planned
from palpate.procedures.engine.listeners import told_to
from palpate.procedures.engine.plan import Step
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, Report, Result, S
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.session import Outcome, recorded_lab, recorded_outcome
from palpate.procedures.records.events import Listener
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run

# --- The result of a recorded run, evaluated anew from its points --------------------------------------


@dataclass(frozen=True, slots=True)
class RecordedResult:
    """The result of a recorded run.

    Attributes:
        result: the result of its points.
        outcome: the keys that the result has in JSON.
        report: how its procedure shows it; None: as a table of its points.
        asked: fields of a point that tell of which step it is, as its sample and its load.
        changed: names of values that are not as the record has them, since another version of palpate computed those.
    """

    result: Result
    outcome: Outcome
    report: Report | None
    asked: tuple[str, ...]
    changed: list[str]


def result_of(run: Run, stored: list[dict[str, Any]]) -> RecordedResult:
    """Evaluate the points of a run anew; `stored`: as they are stored.

    Raises:
        UnknownName, ConfigError: its procedure, a device or a calibration is not known here.
        RecordError: another version of palpate recorded it.
        EstimateError: its points give no result, since they are too few.
    """
    kind, lab = procedure_class(run.procedure), recorded_lab(run)
    procedure, plan = planned(kind.recorded(run), lab.target)
    points = values_of(kind.point, stored, f"{run.folder}: its points")
    result = evaluated(procedure, points, plan, lab)
    now: dict[str, Any] = json.loads(
        as_json({**result.summary(), "budgets": [each.summary() for each in result.budgets]})
    )
    changed = [name for name, value in now.items() if run.summary and not alike(run.summary.get(name), value)]
    own = {each.name for each in fields(type(plan.steps[0]))} - {each.name for each in fields(Step)}
    asked = tuple(each.name for each in fields(kind.point) if each.name in own)
    return RecordedResult(result, recorded_outcome(run, lab), procedure.report(result, lab), asked, changed)


# --- The replay of a run ------------------------------------------------------------------------------


@overload
def replay(
    log: str | Path, out: str | Path | None = None, kind: None = None, *, listeners: Sequence[Listener] = ()
) -> Finished[Result]: ...
@overload
def replay(
    log: str | Path, out: str | Path | None, kind: type[Procedure[S, P, R]], *, listeners: Sequence[Listener] = ()
) -> Finished[R]: ...
def replay(
    log: str | Path,
    out: str | Path | None = None,
    kind: type[Procedure[S, P, R]] | None = None,
    *,
    listeners: Sequence[Listener] = (),
) -> Finished[R] | Finished[Result]:
    """Repeat the run of a bus log: the drivers receive the logged answers, without devices, operator or waiting.

    Args:
        log: the .pcapng file of a log, or the CAN file beside it.
        out: folder of the new run; None: a new one in the store.
        kind: class of its procedure; None: the one of that name, ours or of an installed package.
        listeners: as for `run`.

    Raises:
        UsageError: its procedure is not known, or is another one than `kind`.
        ConfigError: the log is damaged, or another version of palpate wrote it.
    """
    logged, folder = LoggedRun(Path(log)), None if out is None else Path(out)
    if kind is None:
        return _replayed(class_of(logged.run, "replay"), logged, folder, listeners)
    return _replayed(kind, logged, folder, listeners)


def _replayed(
    kind: type[Procedure[S, P, R]], logged: LoggedRun, out: Path | None, listeners: Sequence[Listener]
) -> Finished[R]:
    procedure = kind.recorded(logged.run)
    with told_to(listeners) as listener:
        done = do_again(procedure, logged, out, listener)
    done.conclude()
    return done


def do_again(procedure: Procedure[S, P, R], logged: LoggedRun, out: Path | None, listener: Listener) -> Finished[R]:
    """Carry out the procedure of a bus log, with the logged answers.

    Raises:
        ConfigError: the procedure sends a request that the log does not have at this place.
    """
    try:
        return open_and_run(procedure, Chosen.of_log(logged), out=out, listener=listener)
    except PalpateError as error:
        error.__notes__ = []  # drops notes about outputs that could not be switched off, because a log has none
        raise
