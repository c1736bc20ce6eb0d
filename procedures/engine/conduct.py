"""The loop of every procedure: set up, pause, measure, store, show."""

from __future__ import annotations

from dataclasses import asdict

from palpate.drivers.roles import SampleChanger
from palpate.instrument.errors import RecordError
from palpate.procedures.console.progress import Progress, silent
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import P, Procedure, R, S
from palpate.procedures.engine.returned import begun, course, evaluated, measured, planned
from palpate.procedures.lab.lab import Lab
from palpate.procedures.records.record import MEASURED, Recorder
from palpate.procedures.steps.pause import NOBODY, Pause, pause_here

ENOUGH = "enough"  # kind of the event that a run has before it ends ahead of its plan


def conduct(
    procedure: Procedure[S, P, R], lab: Lab, record: Recorder, progress: Progress = silent, pause: Pause = NOBODY
) -> R:
    """Plan a procedure on an open bench, take the points that its record has not yet, and evaluate them.

    Arguments and errors as for `taken`; also raises RangeError, UnknownName: a setting is impossible on this bench;
    EstimateError: the points give no result.
    """
    procedure, plan = planned(procedure, lab.target)
    return evaluated(procedure, taken(procedure, plan, lab, record, progress, pause), plan, lab)


def taken(
    procedure: Procedure[S, P, R], plan: Plan[S], lab: Lab, record: Recorder, progress: Progress, pause: Pause
) -> list[P]:
    """Carry out the remaining steps of a plan. Each point is durable on disk before `progress` is called.

    Where the course of the procedure ends before its plan, an event of the record says why. Before a point is stored,
    the bench's sample changer is asked whether its sample is still mounted. Where the points of a calibration must be
    taken in one run, an event says once they are, so that a run that is killed later is not lost.

    Args:
        procedure: the procedure.
        plan: its plan for the open bench.
        lab: the open bench.
        record: the record of the run, which may hold finished points already.
        progress: called with the number of finished points, of all points, and what is done now.
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
                progress(number, len(steps), group)
            work.arrange(step)
        progress(number, len(steps), step.what)
        if procedure.pausable:
            pause_here(pause, lab.bench, record)
        found = measured(procedure, work, step)
        if changer:
            changer.check()
        record.point(asdict(found.point), found.waveforms, lab.bench.clock.now_ns())
        points.append(found.point)
        progress(number + 1, len(steps), step.what)
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
