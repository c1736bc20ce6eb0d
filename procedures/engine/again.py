"""Does the earlier runs of an open simulated bench again, so that a later one begins where it began."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate.instrument.errors import RecordError
from palpate.procedures.engine.catalogue import class_before, outside
from palpate.procedures.engine.conduct import taken
from palpate.procedures.engine.procedure import Procedure
from palpate.procedures.engine.returned import planned
from palpate.procedures.lab.before import Before, Earlier
from palpate.procedures.lab.logged import Used
from palpate.procedures.lab.open import OpenBench
from palpate.procedures.lab.software import added_by, versions
from palpate.procedures.records.events import unheard
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import Waveforms, as_samples
from palpate.procedures.records.stored_dwell import StoredDwell
from palpate.procedures.steps.pause import NOBODY, PausedAgain


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
