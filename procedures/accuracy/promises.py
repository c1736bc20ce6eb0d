"""Whether promises are kept: what runs of a store were predicted to take and to give, and what they took and gave.

kept = promises(Path("runs"))
kept.procedures[0].time.mean             # 0.99: bench time over the predicted one
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.errors import RecordError
from palpate.procedures.records.run import Run
from palpate.procedures.records.run_list import list_runs


@dataclass(frozen=True, slots=True)
class Promised:
    """What one run was predicted to take and to give, and what it took and gave; None: not known.

    Attributes:
        run: name of its folder.
        procedure: name of its procedure.
        simulated: whether its bench was.
    """

    run: str
    procedure: str
    simulated: bool
    predicted_seconds: float | None
    achieved_seconds: float | None
    predicted_u: float | None
    achieved_u: float | None

    @property
    def time(self) -> float | None:
        """Bench time over the predicted one."""
        return _over(self.achieved_seconds, self.predicted_seconds)

    @property
    def uncertainty(self) -> float | None:
        """Relative standard uncertainty over the predicted one."""
        return _over(self.achieved_u, self.predicted_u)

    def row(self) -> dict[str, Any]:
        """Under the names of JSON."""
        return {**asdict(self), "seconds_over_predicted": self.time, "u_over_predicted": self.uncertainty}


@dataclass(frozen=True, slots=True)
class Spread:
    """Achieved over predicted values of some runs: how many, and their mean, least and greatest."""

    count: int
    mean: float
    least: float
    greatest: float

    @classmethod
    def of(cls, values: Sequence[float | None]) -> Spread | None:
        """The spread of the values that are known; None: none is."""
        known = [value for value in values if value is not None]
        if not known:
            return None
        return cls(len(known), math.fsum(known) / len(known), min(known), max(known))


@dataclass(frozen=True, slots=True)
class KeptBy:
    """The promises of one procedure on simulated or on real benches."""

    procedure: str
    simulated: bool
    runs: int
    time: Spread | None
    uncertainty: Spread | None

    def row(self) -> dict[str, Any]:
        """Under the names of JSON."""
        return {
            "procedure": self.procedure,
            "simulated": self.simulated,
            "runs": self.runs,
            "seconds_over_predicted": None if self.time is None else asdict(self.time),
            "u_over_predicted": None if self.uncertainty is None else asdict(self.uncertainty),
        }


@dataclass(frozen=True, slots=True)
class Kept:
    """The promises of a store.

    Attributes:
        runs: the complete runs that have a promise, newest first.
        procedures: the same for each procedure.
        without: number of complete runs without one, because an older version recorded them.
        unreadable: names of runs that cannot be read.
    """

    runs: list[Promised]
    procedures: list[KeptBy]
    without: int
    unreadable: list[str]


def promises(store: Path) -> Kept:
    """Compare what was predicted of the complete runs of a store with what they reached."""
    runs, without, unreadable = [], 0, []
    for each in list_runs(store):
        if each.fault:
            unreadable.append(each.folder.name)
        elif each.status == "complete":
            try:
                found = _promised(Run.open(each.folder))
            except RecordError:
                unreadable.append(each.folder.name)
                continue
            if found is None:
                without += 1
            else:
                runs.append(found)
    names = sorted({(run.procedure, run.simulated) for run in runs})
    return Kept(runs, [_kept_by(runs, *name) for name in names], without, unreadable)


def _kept_by(runs: Sequence[Promised], procedure: str, simulated: bool) -> KeptBy:
    own = [run for run in runs if (run.procedure, run.simulated) == (procedure, simulated)]
    times, uncertainties = ([run.time for run in own], [run.uncertainty for run in own])
    return KeptBy(procedure, simulated, len(own), Spread.of(times), Spread.of(uncertainties))


def _promised(run: Run) -> Promised | None:
    """The promise of a run; None: it has none."""
    names = ("predicted_seconds", "achieved_seconds", "predicted_u", "achieved_u")
    if not all(name in run.summary for name in names):
        return None
    seconds, taken, u, reached = (_number(run.summary[name]) for name in names)
    return Promised(run.folder.name, run.procedure, run.simulated, seconds, taken, u, reached)


def _number(value: object) -> float | None:
    known = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if known else None  # type: ignore[arg-type]


def _over(achieved: float | None, predicted: float | None) -> float | None:
    return None if achieved is None or not predicted else achieved / predicted
