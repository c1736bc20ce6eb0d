"""The loop of every procedure: set up, pause, measure, store, show."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from palpate.drivers.roles import SampleChanger
from palpate.instrument.errors import ConfigError, RecordError, UsageError, quoted
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.engine.procedure import Finished, Measurement, P, Procedure, R, S, Work, achieved_u
from palpate.procedures.engine.settings import check_settings
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import CalibrationKeys, reserved
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.events import unheard
from palpate.procedures.records.record import MEASURED, Recorder
from palpate.procedures.steps.beside import Surroundings
from palpate.procedures.steps.pause import NOBODY, Pause, pause_here

if TYPE_CHECKING:
    from palpate.instrument.models.response import RatioQuestion
    from palpate.instrument.sensor.design import Design


# --- Checks what the methods of a procedure return, because a procedure of another package may return anything


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


# --- the loop ------------------------------------------------------------------------------------------

ASKED_AT = frozenset(4**n for n in range(16))  # numbers of points at which the uncertainty so far is asked: it halves
ENOUGH = "enough"  # kind of the event that a run has before it ends ahead of its plan


def conduct(procedure: Procedure[S, P, R], lab: Lab, record: Recorder, pause: Pause = NOBODY) -> R:
    """Plan a procedure on an open bench, take the points that its record has not yet, and evaluate them.

    Arguments and errors as for `taken`; also raises RangeError, UnknownName: a setting is impossible on this bench;
    EstimateError: the points give no result.
    """
    procedure, plan = planned(procedure, lab.target)
    return evaluated(procedure, taken(procedure, plan, lab, record, pause), plan, lab)


def taken(procedure: Procedure[S, P, R], plan: Plan[S], lab: Lab, record: Recorder, pause: Pause) -> list[P]:
    """Carry out the remaining steps of a plan. The listener of the record hears of each step and point.

    Where the course of the procedure ends before its plan, an event of the record says why. Before a point is stored,
    the bench's sample changer is asked whether its sample is still mounted. Where the points of a calibration must be
    taken in one run, an event says once they are, so that a run that is killed later is not lost.

    Args:
        procedure: the procedure.
        plan: its plan for the open bench.
        lab: the open bench.
        record: the record of the run, which may hold finished points already.
        pause: asked before each step whether to pause.

    Returns: all points, finished ones and new ones.

    Raises:
        UnreachableError, SafetyError, LinkError, DeviceError: the bench failed; finished points stay on disk.
        SampleError: the sample changer does not hold the sample that it mounted, or it was away meanwhile.
        RecordError: the record holds more points than the procedure takes.
        ConfigError: a method of the procedure returned what it must not.
    """
    steps, work = plan.steps, begun(procedure, plan, lab, record)
    finished: list[P] = record.finished(procedure.point)
    points: list[P] = []
    group: str | None = None
    changer = lab.bench.maybe(SampleChanger)
    way, why = course(procedure, plan, points, lab), ""
    surroundings = Surroundings(lab.bench, record)
    promise = _Promise(procedure, plan, lab, record)
    while not record.measured or len(points) < len(finished):
        try:
            number = next(way)
        except StopIteration as end:
            why = end.value
            break
        if len(points) < len(finished):
            points.append(finished[len(points)])
            continue
        step = steps[number]
        if step.group != group:
            group = step.group
            if group:
                promise.step(number, group)
            work.arrange(step)
        promise.step(number, step.what)
        if procedure.pausable:
            pause_here(pause, lab.bench, record)
        found = measured(procedure, work, step)
        if changer:
            changer.check()
        beside = surroundings.read()
        point = beside.marked(found.point)
        record.point({**asdict(point), **found.beside, **beside.values}, found.waveforms, lab.bench.clock.now_ns())
        points.append(point)
        promise.point(number + 1, points)
        if found.error is not None:
            raise found.error
    if len(points) < len(finished):
        raise RecordError(
            f"the record holds {len(finished)} points, and this procedure takes {len(points)}; run it anew"
        )
    if why:
        record.event(ENOUGH, why, lab.bench.clock.now_ns())
    if not record.measured:
        work.end()
        if procedure.calibrates and not procedure.resumable_on_real_bench:
            record.event(MEASURED, "all points are taken", lab.bench.clock.now_ns())
    return points


class _Promise:
    """Tells the listener of a record what is done now, what is left by the plan, and what the points so far give."""

    def __init__(self, procedure: Procedure[Any, Any, Any], plan: Plan[Any], lab: Lab, record: Recorder) -> None:
        self._procedure, self._plan, self._lab, self._record = procedure, plan, lab, record
        self._heard = record.listener is not unheard
        self._left: list[float] = []  # by the number of steps behind [s]
        self._u: float | None = None

    def step(self, number: int, what: str) -> None:
        """Tell what is done now, with so many steps behind."""
        if not self._heard:
            return
        if not self._left:
            times = itertools.accumulate((step.seconds_expected for step in self._plan.steps), initial=0.0)
            self._left = [max(self._plan.seconds - time, 0.0) for time in times]
            self._tell(number)
        data = {"number": number, "points": len(self._plan.steps), "what": what}
        self._record.tell("step", self._lab.bench.clock.now_ns(), data)

    def point(self, number: int, points: Sequence[object]) -> None:
        """Tell what is left with so many steps behind, and these points."""
        if self._heard:
            if len(points) in ASKED_AT:
                self._u = self._reached(points)
            self._tell(number)

    def _tell(self, number: int) -> None:
        data = {"seconds": self._left[number], "u": self._u}
        self._record.tell("promise", self._lab.bench.clock.now_ns(), data)

    def _reached(self, points: Sequence[object]) -> float | None:
        try:
            return achieved_u(self._plan, evaluated(self._procedure, points, self._plan, self._lab))
        except Exception:  # so few points may give no result, and a listener must not harm the run
            return None
