"""Runs a procedure and records it, on an open bench, or on one that is opened for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from palpate.instrument.additions import check_ours
from palpate.instrument.errors import RecordError
from palpate.procedures.engine.catalogue import GROUP, SHIPPED, WHAT, class_before, outside
from palpate.procedures.engine.conduct import asked, calibration_saved, evaluated, planned, taken
from palpate.procedures.engine.listeners import told_to
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S, achieved, achieved_u, expected_of
from palpate.procedures.lab.about import added_by, versions
from palpate.procedures.lab.before import Before, Earlier, before_of
from palpate.procedures.lab.calibrations import Unstored, check_store
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.lab.lab import Target
from palpate.procedures.lab.logged import Used
from palpate.procedures.lab.open import OpenBench, one_run, opened
from palpate.procedures.lab.session import Promise, places, recording
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.events import Listener, unheard
from palpate.procedures.records.record import Recorder, StoredDwell
from palpate.procedures.records.record_file import Waveforms, as_samples
from palpate.procedures.records.resumed import UNSTORED, Resumed
from palpate.procedures.steps.pause import NOBODY, Pause, PausedAgain

# --- Does the earlier runs of an open simulated bench again, so that a later one begins where it began -


class _Held(StoredDwell):
    """A dwell whose samples are kept in memory."""

    def __init__(self) -> None:
        self.number, self.samples = 0, 0
        self._pieces: list[tuple[int, dict[str, np.ndarray]]] = []

    def add(self, waveforms: Mapping[str, tuple[float, np.ndarray]]) -> None:
        """Keep the next samples, as a record would have them."""
        piece = {name: as_samples(name, rate, samples) for name, (rate, samples) in waveforms.items()}
        self._pieces.append((self.samples, piece))
        self.samples += min(samples.size for samples in piece.values())

    def pieces(self) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """All samples again."""
        return iter(self._pieces)


class Unrecorded(Recorder):
    """A recorder that stores nothing, for a run that is stored already."""

    def __init__(self) -> None:
        self._points = 0
        self.listener = unheard

    def point(self, data: Mapping[str, object], waveforms: Waveforms, bench_ns: int) -> int:
        """Count a point."""
        self._points += 1
        return self._points

    def begin_dwell(self) -> StoredDwell:
        """A dwell that is kept in memory."""
        return _Held()

    def event(self, kind: str, message: str, bench_ns: int) -> None:
        """Do nothing."""


def bring_back(bench: OpenBench, before: Before, kind: type[Procedure[Any, Any, Any]], record: Recorder) -> None:
    """Bring a simulated bench that was just opened to where a run of class `kind` began.

    The listener of the record hears of each run that is done again.

    Raises:
        UsageError: the procedure of an earlier run is not known. RecordError: the record of one is wrong.
        Others as `conduct` raises them.
    """
    assert bench.history is not None
    for number, earlier in before.runs.items():
        what = f"run {number} of the {len(before.runs)} before it, again"
        record.tell("step", bench.history.now_ns, {"number": 0, "points": 0, "what": what})
        bench.history.wait_until(earlier.bench_ns)
        _do_again(bench, earlier, kind)
    bench.history.wait_until(before.bench_ns)


def _do_again(bench: OpenBench, earlier: Earlier, kind: type[Procedure[Any, Any, Any]]) -> None:
    assert bench.history is not None
    run = earlier.run
    found = class_before(run, kind)
    procedure = found.recorded(run)
    try:
        used = Used.of(run.header, str(run.folder))
    except KeyError as error:
        raise RecordError(f"{run.folder}: its header has no {error}; run anew") from None
    lab = bench.lab(run.folder.name, run.started, used=used)
    record, begun_ns = Unrecorded(), bench.history.now_ns
    lab.bench.attend(record.event)
    pause = PausedAgain(lambda bench_ns: bench_ns in earlier.paused, lab.bench, NOBODY)
    procedure, plan = planned(procedure, lab.target)
    taken(procedure, plan, lab, record, pause)
    lab.bench.incidents.hold()
    now = versions() | added_by(lab.bench.description, bench.scene, outside(found))
    bench.runs.append(run.folder)
    bench.history.end({**run.header, "versions": now}, begun_ns, earlier.paused, run.folder)


# --- running a procedure -------------------------------------------------------------------------------

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
