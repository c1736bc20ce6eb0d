"""The result of a recorded run, evaluated anew from its points."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import Any

from palpate.instrument.arithmetic import alike
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.plan import Step
from palpate.procedures.engine.procedure import Report
from palpate.procedures.engine.result import Result
from palpate.procedures.engine.returned import evaluated, planned
from palpate.procedures.lab.recorded import recorded_lab, recorded_outcome
from palpate.procedures.lab.session import Outcome
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run


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
