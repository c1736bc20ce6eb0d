"""What a procedure is: settings, a plan of steps, the work at each, and what is made of the points.

How one is written, with the load sweep (`measurements/loads/`) as the example:

1. `result.py`: the point, a frozen dataclass whose fields are the names in the record; the result, which has `points`,
   `budgets` and `summary()`; `evaluate`, a function of the points. It imports from `instrument` alone.
2. `report.py`: how the result is shown, as a function that prints it and one that draws it into a folder.
3. `procedure.py`:
   - the procedure, a frozen dataclass whose fields are the settings, in the order in which the record holds them. A
     `Setting` (`engine/settings.py`) says the unit of each and what it is;
   - `check` refuses what the bench cannot give, before any device is spoken to;
   - `plan` lists the steps; each says `what` is measured, and in `group` what is set up before it;
   - `begin` returns the work: `arrange` sets up a group, `take` measures one step, `end` leaves the bench at rest.
     Work under a dynamic load inherits from `measurements.loaded.Loaded`, which has films, servo and end;
   - `evaluate` and `report` call the functions of 1 and 2.
4. Its name goes into `engine/known.py`: then its runs resume and replay, and `palpate measure` makes a command of it.
5. Where fields do not suffice as options, a command of its own makes the procedure and gives it to
   `commands.procedures.measure`.

The engine does the rest (`engine/conduct.py`): it stores each point before it tells of it, pauses, resumes and replays.
A procedure holds nothing that changes; what stays set up from step to step is the work's.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, Self, TypeVar

from palpate.instrument.errors import PalpateError, RecordError
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.open import Calibrating
from palpate.procedures.lab.session import Kept, Outcome, Session
from palpate.procedures.records.encoding import Waveforms
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.resumed import settings_of
from palpate.procedures.records.run import Run
from palpate.procedures.steps.flags import Judged, check_some_valid

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.instrument.uncertainty.budget import Budget
    from palpate.instrument.uncertainty.propagation import Propagated


class Result(Protocol):
    """What a procedure finds."""

    @property
    def points(self) -> Sequence[DataclassInstance]:
        """What was measured, under public names."""

    @property
    def budgets(self) -> Sequence[Budget | Propagated]:
        """Of what is uncertain in it."""

    def summary(self) -> dict[str, Any]:
        """It without its points, under public names."""


S = TypeVar("S", bound=Step)
P = TypeVar("P", bound="DataclassInstance")
R = TypeVar("R", bound=Result)
S_contra = TypeVar("S_contra", bound=Step, contravariant=True)
P_co = TypeVar("P_co", bound="DataclassInstance", covariant=True)


@dataclass(frozen=True, slots=True)
class Found(Generic[P]):
    """A result of points and of values by their public names, for a procedure that needs no class of its own."""

    points: Sequence[P]
    values: Mapping[str, object] = field(default_factory=dict)
    budgets: Sequence[Budget | Propagated] = ()

    def summary(self) -> dict[str, Any]:
        return dict(self.values)


@dataclass(frozen=True, slots=True)
class Taken(Generic[P_co]):
    """A measured point with its waveforms. `error`: is raised once the point is stored, as it ends the run."""

    point: P_co
    waveforms: Waveforms = field(default_factory=dict)
    error: PalpateError | None = None


class Work(Protocol[S_contra, P_co]):
    """What stays set up on the bench from step to step."""

    def arrange(self, step: S_contra) -> None:
        """Set up what a group of steps has in common: mount a sample, press on it. Called before its first step."""

    def take(self, step: S_contra) -> Taken[P_co]:
        """Measure one step."""

    def end(self) -> None:
        """Leave the bench at rest, and check what must not have changed."""


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads that the load cell must tell by its calibration [N, peak to peak], unless it may `extrapolate`."""

    values: Sequence[float]
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """How a result is shown. `show` prints it, with where its files are; `draw` makes a plot in a folder."""

    show: Callable[[Outcome, Path], None]
    draw: Callable[[Path], Path]


@dataclass(frozen=True, slots=True)
class Finished(Generic[R]):
    """A run that was taken to its end, and what was found."""

    procedure: Procedure[Any, Any, R]
    result: R
    session: Session
    outcome: Outcome

    @property
    def folder(self) -> Path:
        """Where the run lies."""
        return self.session.record.folder

    @property
    def replayed(self) -> bool:
        """Whether it was done on the traffic of a log: then nothing is kept for later runs."""
        return self.session.opened.chosen.logged is not None

    @property
    def run(self) -> Run:
        """The run as it is on disk. Raises RecordError."""
        return Run.open(self.folder)

    def plot(self) -> Path | None:
        """Draw the result into the run's folder; returns the file, or None: the procedure draws nothing."""
        report = self.procedure.report(self.result, self.session.lab)
        return None if report is None else report.draw(self.folder)


@dataclass(frozen=True)
class Procedure(ABC, Generic[S, P, R]):
    """Something to measure on a bench: steps `S`, points `P`, a result `R`. A frozen dataclass; fields are settings.

    Attributes:
        name: of its runs.
        point: class of its points.
        calibrating: what it calibrates, whose calibration it does not need.
        continues: on a real bench it can go on at any point; else what came before has to be measured anew.
        pausable: outputs may rest before any step, which sets its load anew.
        by_hand: what a person does in it beside mounting samples, as "places weights"; "": nothing.
        constants: what the record says beside the settings.
        added: settings that records of older versions lack; every other one must be in a record that goes on.
    """

    name: ClassVar[str]
    point: ClassVar[type[Any]]
    calibrating: ClassVar[Calibrating | None] = None
    continues: ClassVar[bool] = False
    pausable: ClassVar[bool] = False
    by_hand: ClassVar[str] = ""
    constants: ClassVar[Mapping[str, object]] = {}
    added: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def recorded(cls, run: Run) -> Self:
        """The procedure of a run, with its settings. Raises RecordError: they are of another version."""
        given = run.header["settings"]
        asked = {each.name for each in fields(cls)} - cls.added
        if isinstance(given, dict) and (lacking := asked - given.keys()):
            lack = ", ".join(sorted(lacking))
            raise RecordError(
                f"{run.folder}: its settings were recorded by another version of palpate (no {lack}); run anew"
            )
        return settings_of(run, cls)

    def check(self, target: Target) -> None:
        """Refuse what the bench cannot give, before any device is spoken to. Raises RangeError, UnknownName."""

    def loads_to_tell(self) -> Loads | None:
        """What its load cell must tell; None: no loads, or they are not known before."""
        return None

    @abstractmethod
    def plan(self, target: Target) -> Plan[S]:
        """Every step, in order, with the time and the uncertainty to be expected."""

    @abstractmethod
    def begin(self, lab: Lab, record: Recorder) -> Work[S, P]:
        """Set up what all steps have in common. `record` takes events."""

    @abstractmethod
    def evaluate(self, points: Sequence[P], lab: Lab) -> R:
        """What the points tell. Raises EstimateError: nothing."""

    def keep(self, done: Finished[R]) -> Kept:
        """Keep a calibration for later runs; what the outcome then says in addition. Raises RecordError."""
        return {}

    def report(self, result: R, lab: Lab) -> Report | None:
        """How the result is shown; None: as a table of its points."""
        return None

    def judge(self, result: R) -> None:
        """Refuse a result from which nothing can be concluded. The engine asks when the result has been told.

        By default a result whose points are valid or not must have a valid one. Raises EstimateError.
        """
        if judged := [point for point in result.points if isinstance(point, Judged)]:
            check_some_valid(judged)
