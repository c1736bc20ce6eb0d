"""Checks what the methods of a procedure return, because a procedure of another package may return anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from palpate.instrument.errors import ConfigError, quoted
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.engine.procedure import Finished, Measurement, P, Procedure, R, S, Work
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import Kept, reserved
from palpate.procedures.records.record import Recorder

if TYPE_CHECKING:
    from palpate.instrument.models.ratio import Question
    from palpate.instrument.sensor.design import Design


def filled(procedure: Procedure[S, P, R], target: Target) -> Procedure[S, P, R]:
    """The procedure with what it leaves to the sensor. Raises ConfigError: `on` returned something else."""
    if not isinstance(procedure, Procedure):
        return procedure  # the check of its settings tells
    found = procedure.on(target)
    if type(found) is not type(procedure):
        raise _wrong(procedure, f"on returned {quoted(found)}", "it must return a procedure of its own kind")
    return found


def planned(procedure: Procedure[S, P, R], target: Target) -> Plan[S]:
    """The procedure's plan. Raises ConfigError: it is no plan of steps."""
    plan = procedure.plan(target)
    if not isinstance(plan, Plan):
        raise _wrong(procedure, f"plan returned {quoted(plan)}", "it must return a Plan")
    if not isinstance(plan.steps, Sequence):
        raise _wrong(procedure, f"plan returned steps {quoted(plan.steps)}", "they must be a list")
    for step in plan.steps:
        if not isinstance(step, Step):
            raise _wrong(procedure, f"plan returned {quoted(step)} as a step", "it must be a Step")
    return plan


def asked(procedure: Procedure[S, P, R], design: Design) -> Question | None:
    """What it asks a sensor model. Raises ConfigError: `model_question` returned something else."""
    found = procedure.model_question(design)
    if found is None:
        return None
    from palpate.instrument.models.ratio import Question

    if not isinstance(found, Question):
        raise _wrong(procedure, f"model_question returned {quoted(found)}", "it must return a Question or None")
    return found


def begun(procedure: Procedure[S, P, R], lab: Lab, record: Recorder) -> Work[S, P]:
    """The procedure's work on the bench. Raises ConfigError: it is no work."""
    work = procedure.begin(lab, record)
    if not all(callable(getattr(work, name, None)) for name in ("arrange", "take", "end")):
        raise _wrong(procedure, f"begin returned {quoted(work)}", "it must return the work, with arrange, take and end")
    return work


def measured(procedure: Procedure[S, P, R], work: Work[S, P], step: S) -> Measurement[P]:
    """The next measured step. Raises ConfigError: its point is none of the procedure's."""
    found = work.take(step)
    if not isinstance(found, Measurement):
        raise _wrong(procedure, f"take returned {quoted(found)}", "it must return a Measurement")
    if type(found.point) is not procedure.point:
        raise _wrong(
            procedure, f"take returned the point {quoted(found.point)}", f"it must be a {procedure.point.__name__}"
        )
    return found


def stopping(procedure: Procedure[S, P, R], points: Sequence[P], lab: Lab) -> str:
    """Why the procedure has enough; empty: it goes on. Raises ConfigError: `enough` returned no text."""
    why = procedure.enough(points, lab)
    if not isinstance(why, str):
        raise _wrong(procedure, f"enough returned {quoted(why)}", "it must return a text, empty to go on")
    return why


def skipped(procedure: Procedure[S, P, R], step: S, points: Sequence[P], lab: Lab) -> bool:
    """Whether a step is not needed. Raises ConfigError: `skips` returned neither True nor False."""
    found = procedure.skips(step, points, lab)
    if not isinstance(found, bool):
        raise _wrong(procedure, f"skips returned {quoted(found)}", "it must return True or False")
    return found


def evaluated(procedure: Procedure[S, P, R], points: Sequence[P], lab: Lab) -> R:
    """The result of the points.

    Raises:
        EstimateError: the points give no result.
        ConfigError: it is no result, or a value of its summary has the name of one that palpate gives.
    """
    result = procedure.evaluate(points, lab)
    if not all(hasattr(result, name) for name in ("points", "budgets", "summary")):
        raise _wrong(procedure, f"evaluate returned {quoted(result)}", "it must return a result, as SimpleResult is")
    if theirs := sorted(reserved() & result.summary().keys()):
        raise _wrong(
            procedure,
            f"its result has a value {theirs[0]!r}, which palpate gives for every run",
            "it must have another name",
        )
    return result


def calibration_saved(procedure: Procedure[S, P, R], done: Finished[R]) -> Kept:
    """Store a calibration for later runs. Raises RecordError; ConfigError: `save_calibration` returned other keys."""
    keys = procedure.save_calibration(done)
    if not isinstance(keys, Mapping) or keys.keys() - Kept.__annotations__.keys():
        raise _wrong(
            procedure,
            f"save_calibration returned {quoted(keys)}",
            f"it must return a mapping of {', '.join(Kept.__annotations__)}",
        )
    return keys


def _wrong(procedure: Procedure[S, P, R], what: str, remedy: str) -> ConfigError:
    kind = type(procedure)
    return ConfigError(f"procedure {procedure.name!r}: {what}; {remedy}; mend {kind.__module__}.{kind.__qualname__}")
