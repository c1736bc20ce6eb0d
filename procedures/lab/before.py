"""What was done on an open simulated bench before a run, so that the run can be resumed where it began.

What a simulated bench gives depends on everything that was done on it. So the header of a later run names the runs
before it, with their settings and calibrations. To resume it, they are carried out again on a new bench, and nothing of
them is stored. Time that passed between two runs passes again. Whatever else a script does with the bench between two
runs is known to nobody; then the later run cannot be resumed, and says so as it begins.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run

if TYPE_CHECKING:
    from palpate.simulators.bench import SimulatedBench

BEFORE = "before"  # header key; a run that begins on a bench as it was opened lacks it
AGAIN = (
    "procedure", "procedure_from", "started", "settings", "calibration", "film_calibration", "model_calibration",
    "mounting_scatter", "versions",
)  # fmt: skip
"""Keys of a run's header that are needed to carry the run out again."""


@dataclass(frozen=True, slots=True)
class Earlier:
    """A run that ended before another one began.

    Attributes:
        header: what of its header is needed to carry it out again.
        bench_ns: bench time at which it began [ns].
        paused: bench times of its pauses [ns].
        folder: its folder.
    """

    header: dict[str, Any]
    bench_ns: int
    paused: list[int]
    folder: str

    @property
    def run(self) -> Run:
        """The run by its header alone; its folder may be gone."""
        started = datetime.fromisoformat(self.header["started"]).astimezone(UTC)
        procedure = self.header["procedure"]
        return Run(Path(self.folder), procedure, True, started, "complete", self.header, {})


@dataclass(frozen=True, slots=True)
class Before:
    """Where a run began.

    Attributes:
        bench_ns: bench time [ns].
        state: digest of what does not change by waiting: the devices' settings, and when the rig was last touched.
        runs: the runs before it by their numbers.
        unknown: what was done besides, so that the run cannot be resumed; empty: nothing.
    """

    bench_ns: int
    state: str
    runs: dict[str, Earlier] = field(default_factory=dict)
    unknown: str = ""


def before_of(run: Run) -> Before | None:
    """Where a run began; None: on a bench as it was opened. Raises RecordError: its header does not tell."""
    found = run.header.get(BEFORE)
    if found is None:
        return None
    (before,) = values_of(Before, [found], f"{run.folder}: the runs before it")
    return before


class History:
    """What was done on an open simulated bench so far."""

    def __init__(self, simulated: SimulatedBench) -> None:
        self._simulated = simulated
        self._runs: dict[str, Earlier] = {}
        self._unknown = ""
        self._opened = self._left = self._now()

    def _now(self) -> Before:
        bench = self._simulated
        with bench.clock.lock:
            settings = {name: getattr(device, "settings", None) for name, device in bench.devices.items()}
            now, rig = bench.clock.now_ns(), bench.rig
            touched = (now - rig.settled_for_ns(), rig.exchanges, rig.position, rig.cell_position, len(rig.placed))
            state = json.dumps((touched, settings), sort_keys=True, default=str)
            return Before(now, hashlib.sha256(state.encode()).hexdigest())

    def begin(self) -> Before | None:
        """Where a run begins that begins now; None: on a bench as it was opened."""
        now = self._now()
        if now.state != self._left.state:
            run = f"after run {len(self._runs)}" if self._runs else "before its first run"
            self._unknown = self._unknown or f"something else was done with the bench {run}"
        if now == self._opened and not self._unknown:
            return None
        return Before(now.bench_ns, now.state, dict(self._runs), self._unknown)

    def wait_until(self, bench_ns: int) -> None:
        """Let time pass as it passed between two runs, up to a bench time [ns]; nothing if it is over."""
        self._simulated.clock.wait(1e-9 * max(0, bench_ns - self._simulated.clock.now_ns()))

    def end(self, header: Mapping[str, Any], begun_ns: int, paused: list[int], folder: Path) -> None:
        """A run has ended."""
        kept = json.loads(json.dumps({key: header[key] for key in AGAIN if key in header}))
        self._runs[str(len(self._runs) + 1)] = Earlier(kept, begun_ns, paused, str(folder))
        self._left = self._now()

    @property
    def now_ns(self) -> int:
        """Bench time [ns]."""
        return self._simulated.clock.now_ns()
