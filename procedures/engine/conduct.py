"""The loop of every procedure: set up, pause, measure, store, show."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from palpate.drivers.roles import SampleChanger
from palpate.instrument.errors import RecordError
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import P, Procedure, R, S
from palpate.procedures.engine.promise import achieved_u
from palpate.procedures.engine.returned import begun, course, evaluated, measured, planned
from palpate.procedures.lab.lab import Lab
from palpate.procedures.records.events import unheard
from palpate.procedures.records.record import MEASURED, Recorder
from palpate.procedures.steps.beside import Surroundings
from palpate.procedures.steps.pause import NOBODY, Pause, pause_here

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
        told = {"number": number, "points": len(self._plan.steps), "what": what}
        self._record.tell("step", self._lab.bench.clock.now_ns(), told)

    def point(self, number: int, points: Sequence[object]) -> None:
        """Tell what is left with so many steps behind, and these points."""
        if self._heard:
            if len(points) in ASKED_AT:
                self._u = self._reached(points)
            self._tell(number)

    def _tell(self, number: int) -> None:
        told = {"seconds": self._left[number], "u": self._u}
        self._record.tell("promise", self._lab.bench.clock.now_ns(), told)

    def _reached(self, points: Sequence[object]) -> float | None:
        try:
            return achieved_u(self._plan, evaluated(self._procedure, points, self._plan, self._lab))
        except Exception:  # so few points may give no result, and a listener must not harm the run
            return None
