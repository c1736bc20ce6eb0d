"""Runs a procedure and records it, on an open bench, or on one that is opened for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path

from palpate.instrument.additions import check_ours
from palpate.procedures.engine.again import bring_back
from palpate.procedures.engine.catalogue import GROUP, SHIPPED, WHAT, outside
from palpate.procedures.engine.conduct import taken
from palpate.procedures.engine.listeners import told_to
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S
from palpate.procedures.engine.promise import achieved, achieved_u, expected_of
from palpate.procedures.engine.returned import asked, calibration_saved, evaluated, planned
from palpate.procedures.lab.before import before_of
from palpate.procedures.lab.calibrations import Unstored, check_store
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.lab.lab import Target
from palpate.procedures.lab.open import OpenBench, one_run, opened
from palpate.procedures.lab.session import Promise, places, recording
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.events import Listener, unheard
from palpate.procedures.records.resumed import UNSTORED, Resumed
from palpate.procedures.steps.pause import NOBODY, Pause, PausedAgain

TOLERANCE_OF, COVERED = "tolerance_of", "U95"  # a tolerance is the half-width of a 95 % interval


def prepared(
    procedure: Procedure[S, P, R], target: Target, *, by_store: bool = True
) -> tuple[Procedure[S, P, R], Plan[S], str]:
    """Plan a procedure before a bench is opened, or refuse it.

    Its settings are checked and, with `by_store`, its loads against stored calibrations.

    Returns: the procedure with what it leaves to the sensor; its plan; a note about what may still be refused once the
    bench is open, empty if nothing is known. Raises what the checks raise.
    """
    procedure, plan = planned(procedure, target)
    if procedure.name in SHIPPED:
        check_ours(GROUP, WHAT, [procedure.name])
    loads = procedure.required_loads()
    if by_store and loads is not None:
        stored = check_store(loads.values, loads.extrapolate, target.scene, datetime.now(UTC).date())
        if not stored and target.scene is None:
            note = "no stored calibration of a real bench covers these loads: run palpate calibrate load-cell there"
            return procedure, plan, note
    return procedure, plan, ""


def plan(procedure: Procedure[S, P, R], bench: OpenBench) -> Plan[S]:
    """The plan of a procedure on an open bench; nothing is sent. Raises what the procedure's checks raise."""
    return prepared(procedure, bench.target)[1]


def run(
    procedure: Procedure[S, P, R],
    bench: OpenBench,
    *,
    out: str | Path | None = None,
    listeners: Sequence[Listener] = (),
    pause: Pause = NOBODY,
) -> Finished[R]:
    """Carry out a procedure on an open bench and record it. A resulting calibration is stored for later runs.

    Args:
        procedure: the procedure.
        bench: the open bench.
        out: folder of the run, new or empty; None: a new one in the store ($PALPATE_STORE, or runs/).
        listeners: each is called with every `Event` of the run, in a thread of its own. The run does not wait for it;
            one that raises or hangs is dropped, which is told.
        pause: asked before each point whether to pause.

    Raises:
        UsageError, RangeError, UnknownName: a setting is impossible on this bench; nothing was sent.
        BenchError: the bench failed; its outputs are off and it is closed. `resume` goes on with the run.
        EstimateError: the points give no result.
        RecordError: the run cannot be written.
    """
    procedure, ahead, _ = prepared(procedure, bench.target)
    started = datetime.now(UTC)
    with (
        told_to(listeners) as listener,
        result_folder(None if out is None else Path(out), procedure.name, started) as folder,
    ):
        done = record_run(procedure, ahead, bench, folder, listener, pause)
    done.conclude()
    return done


def open_and_run(
    procedure: Procedure[S, P, R],
    chosen: Chosen,
    *,
    out: Path | None = None,
    log: Path | None = None,
    listener: Listener = unheard,
    pause: Pause = NOBODY,
    resumed: Resumed | None = None,
) -> Finished[R]:
    """Open a bench, carry out a procedure on it or go on with one, and close the bench.

    All checks that need no open bench come before it is opened. Raises as `run` does.
    """
    procedure, ahead, _ = prepared(procedure, chosen.target, by_store=chosen.logged is None)
    chosen.mounting(procedure.manual_work, procedure.automated_by)
    if resumed is not None:
        before = before_of(resumed.run)
        first = before.runs["1"].run.started if before and before.runs else None
        with opened(chosen, log, resumed, first) as bench:
            if before is not None:
                bring_back(bench, before, type(procedure), resumed)
            return record_run(procedure, ahead, bench, resumed.folder, listener, pause, resumed)
    started = datetime.now(UTC) if chosen.logged is None else chosen.logged.run.started
    with places(out, log, procedure.name, started) as folder, opened(chosen, log, started=started) as bench:
        return record_run(procedure, ahead, bench, folder, listener, pause)


def record_run(
    procedure: Procedure[S, P, R],
    ahead: Plan[S],
    bench: OpenBench,
    folder: Path,
    listener: Listener,
    pause: Pause,
    resumed: Resumed | None = None,
) -> Finished[R]:
    """Carry out a procedure on an open bench and record it in a folder, or go on with a run.

    Args:
        ahead: the plan of before the bench was opened, of which the record tells.
        listener: hears of a new run; a run that goes on has that of its recorder.
    """
    with (
        one_run(bench),
        recording(
            bench,
            procedure.name,
            {**asdict(procedure), **procedure.constants, **_meaning(procedure)},
            folder,
            calibrating=procedure.calibrating,
            question=asked(procedure, bench.target.design),
            manual_work=procedure.manual_work,
            automated_by=procedure.automated_by,
            outside=outside(type(procedure)),
            planned={"points": len(ahead.steps), "seconds": ahead.seconds, "u": ahead.predicted.u},
            listener=listener,
            resumed=resumed,
        ) as session,
    ):
        if resumed is not None:
            pause = PausedAgain(resumed.paused, session.lab.bench, pause)
        # The bench's time begins with its first run. A log holds one run, with as many looks at the clock as it had.
        before = 0.0 if len(bench.runs) == 1 else 1e-9 * session.lab.bench.clock.now_ns()
        lab = session.lab
        procedure, plan = planned(procedure, lab.target)
        result = evaluated(procedure, taken(procedure, plan, lab, session.record, pause), plan, lab)
        outcome = session.outcome()
        promise = _promise(plan, result)
        if resumed is None or resumed.run.header["scene"] is not None:  # else nobody knows what lay between
            promise["achieved_seconds"] = outcome["bench_seconds"] - before
        done = stored(Finished(procedure, result, session, {**outcome, **promise}))
        found = {**result.summary(), "budgets": [each.summary() for each in result.budgets]}
        session.record.finish("complete", {**found, "bench_seconds": outcome["bench_seconds"], **promise})
    return done


def _meaning(procedure: Procedure[S, P, R]) -> dict[str, object]:
    """An entry of the record that says what its tolerance is, if it has one; records without it mean u."""
    return {} if getattr(procedure, "tolerance", None) is None else {TOLERANCE_OF: COVERED}


def stored(done: Finished[R]) -> Finished[R]:
    """A measured run whose calibration, if it has one, is stored, or of which the record says why it is not."""
    try:
        return replace(done, outcome={**done.outcome, **calibration_saved(done.procedure, done)})
    except Unstored as error:
        session = done.session
        session.record.event(UNSTORED, str(error), session.bench.clock.now_ns())
        return replace(done, unstored=error)


def _promise(plan: Plan[S], result: R) -> Promise:
    """What was predicted of a run, and what it gave; its time is not known yet."""
    predicted, expected = plan.predicted, expected_of(plan)
    reached = achieved(expected, result)
    return {
        "predicted_seconds": predicted.seconds,
        "predicted_u": predicted.u,
        "achieved_seconds": None,
        "achieved_u": achieved_u(plan, result),
        "predicted_results": [asdict(each) for each in expected],
        "achieved_results": [asdict(each) for each in reached],
    }
