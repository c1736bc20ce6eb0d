"""The loop of every procedure: set up, pause, measure, store, show."""

from __future__ import annotations

from dataclasses import asdict

from palpate.drivers.roles import SampleChanger
from palpate.procedures.console.progress import Progress, silent
from palpate.procedures.engine.procedure import P, Procedure, R, S
from palpate.procedures.engine.returned import begun, evaluated, filled, measured, planned, skipped, stopping
from palpate.procedures.lab.lab import Lab
from palpate.procedures.records.record import MEASURED, Recorder
from palpate.procedures.steps.pause import NOBODY, Pause, pause_here

ENOUGH = "enough"  # kind of the event that a run has before it ends ahead of its plan


def conduct(
    procedure: Procedure[S, P, R], lab: Lab, record: Recorder, progress: Progress = silent, pause: Pause = NOBODY
) -> R:
    """Carry out the remaining steps of a procedure. Each point is durable on disk before `progress` is called.

    Where the procedure has enough before its plan ends, an event of the record says why; steps of a group that has
    enough are left out. Before a point is stored, the bench's sample changer is asked whether its sample is still
    mounted. Where the points of a calibration must be taken in one run, an event says once they are, so that a run that
    is killed later is not lost.

    Args:
        procedure: the procedure.
        lab: the open bench.
        record: the record of the run, which may hold finished points already.
        progress: called with the number of finished points, of all points, and what is done now.
        pause: asked before each step whether to pause.

    Raises:
        RangeError, UnknownName: a setting is impossible on this bench; the outputs stay off.
        UnreachableError, SafetyError, LinkError, DeviceError: the bench failed; finished points stay on disk.
        SampleError: the sample changer does not hold the sample that it mounted, or it was away meanwhile.
        EstimateError: the points give no result.
        ConfigError: a method of the procedure returned what it must not.
    """
    procedure = filled(procedure, lab.target)
    return evaluated(procedure, taken(procedure, lab, record, progress, pause), lab)


def taken(procedure: Procedure[S, P, R], lab: Lab, record: Recorder, progress: Progress, pause: Pause) -> list[P]:
    """As `conduct`, but returns the points without evaluating them."""
    procedure.check(lab.target)
    steps = planned(procedure, lab.target).steps
    work = begun(procedure, lab, record)
    finished: list[P] = record.finished(procedure.point)
    points: list[P] = []
    group: str | None = None
    changer = lab.bench.maybe(SampleChanger)
    for number, step in enumerate(steps):
        before = len(points) < len(finished)
        if record.measured and not before:
            break
        if not before and (why := stopping(procedure, points, lab)):
            record.event(ENOUGH, why, lab.bench.clock.now_ns())
            break
        if skipped(procedure, step, points, lab):
            continue
        if before:
            points.append(finished[len(points)])
            continue
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
    if not record.measured:
        work.end()
        if procedure.calibrates and not procedure.resumable_on_real_bench:
            record.event(MEASURED, "all points are taken", lab.bench.clock.now_ns())
    return points
