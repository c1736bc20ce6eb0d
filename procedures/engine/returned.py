"""Checks what the methods of a procedure return, because a procedure of another package may return anything."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate.instrument.errors import ConfigError, UsageError, quoted
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.engine.procedure import Finished, Measurement, P, Procedure, R, S, Work
from palpate.procedures.engine.settings import check_settings
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import CalibrationKeys, reserved
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.record import Recorder

if TYPE_CHECKING:
    from palpate.instrument.models.response import RatioQuestion
    from palpate.instrument.sensor.design import Design


def _filled(procedure: Procedure[S, P, R], target: Target) -> Procedure[S, P, R]:
    found = procedure.on(target)
    if type(found) is not type(procedure):
        raise _wrong(procedure, f"on returned {quoted(found)}", "it must return a procedure of its own kind")
    return found


def planned(procedure: Procedure[S, P, R], target: Target) -> tuple[Procedure[S, P, R], Plan[S]]:
    """The procedure with what it leaves to the sensor, and its plan, once its settings are checked.

    Raises what the checks raise; UsageError: there is no step; ConfigError: it is no plan of steps.
    """
    check_settings(procedure)
    columns_of(procedure.point)
    procedure = _filled(procedure, target)
    procedure.check(target)
    plan = procedure.plan(target)
    if not isinstance(plan, Plan):
        raise _wrong(procedure, f"plan returned {quoted(plan)}", "it must return a Plan")
    if not isinstance(plan.steps, Sequence):
        raise _wrong(procedure, f"plan returned steps {quoted(plan.steps)}", "they must be a list")
    for step in plan.steps:
        if not isinstance(step, Step):
            raise _wrong(procedure, f"plan returned {quoted(step)} as a step", "it must be a Step")
    if not plan.steps:
        raise UsageError(f"procedure {procedure.name!r} has no steps with these settings; change them")
    return procedure, plan


def asked(procedure: Procedure[S, P, R], design: Design) -> RatioQuestion | None:
    """What it asks a sensor model. Raises ConfigError: `model_question` returned something else."""
    found = procedure.model_question(design)
    if found is None:
        return None
    from palpate.instrument.models.response import RatioQuestion

    if not isinstance(found, RatioQuestion):
        raise _wrong(procedure, f"model_question returned {quoted(found)}", "it must return a Question or None")
    return found


def begun(procedure: Procedure[S, P, R], plan: Plan[S], lab: Lab, record: Recorder) -> Work[S, P]:
    """The procedure's work on the bench. Raises ConfigError: it is no work."""
    work = procedure.begin(plan, lab, record)
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


def course(procedure: Procedure[S, P, R], plan: Plan[S], points: Sequence[P], lab: Lab) -> Generator[int, None, str]:
    """The procedure's course through its plan.

    Raises ConfigError: it is none, it yields no number of a later step, or it ends without a text.
    """
    found, last, steps = procedure.course(plan, points, lab), -1, len(plan.steps)
    if not isinstance(found, Generator):
        raise _wrong(procedure, f"course returned {quoted(found)}", "it must yield numbers of steps")
    while True:
        try:
            number = next(found)
        except StopIteration as end:
            if isinstance(end.value, str):
                return end.value
            remedy = "it must return a text, empty if there is nothing to say"
            raise _wrong(procedure, f"course ended with {quoted(end.value)}", remedy) from None
        if type(number) is not int or not last < number < steps:
            remedy = f"it must be the number of a later step, below {steps}"
            raise _wrong(procedure, f"course yielded {quoted(number)} after step {last}", remedy)
        yield number
        last = number


def evaluated(procedure: Procedure[S, P, R], points: Sequence[P], plan: Plan[S], lab: Lab) -> R:
    """The result of the points.

    Raises:
        EstimateError: the points give no result.
        ConfigError: it is no result, or a value of its summary has the name of one that palpate gives.
    """
    result = procedure.evaluate(points, plan, lab)
    if not all(hasattr(result, name) for name in ("points", "budgets", "summary")):
        raise _wrong(procedure, f"evaluate returned {quoted(result)}", "it must return a result, as SimpleResult is")
    if theirs := sorted(reserved() & result.summary().keys()):
        raise _wrong(
            procedure,
            f"its result has a value {theirs[0]!r}, which palpate gives for every run",
            "it must have another name",
        )
    return result


def calibration_saved(procedure: Procedure[S, P, R], done: Finished[R]) -> CalibrationKeys:
    """Store a calibration for later runs. Raises RecordError; ConfigError: `save_calibration` returned other keys."""
    keys = procedure.save_calibration(done)
    if not isinstance(keys, Mapping) or keys.keys() - CalibrationKeys.__annotations__.keys():
        raise _wrong(
            procedure,
            f"save_calibration returned {quoted(keys)}",
            f"it must return a mapping of {', '.join(CalibrationKeys.__annotations__)}",
        )
    return keys


def _wrong(procedure: Procedure[S, P, R], what: str, remedy: str) -> ConfigError:
    kind = type(procedure)
    return ConfigError(f"procedure {procedure.name!r}: {what}; {remedy}; mend {kind.__module__}.{kind.__qualname__}")
