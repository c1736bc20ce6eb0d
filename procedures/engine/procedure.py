"""The types of a procedure: its settings, its plan of steps, the work at each step, and the result of its points.

A procedure is written as follows, with the load sweep (`measurements/loads.py`) as the example:

1. The point, a frozen dataclass whose fields are the names in the record, each with a `Column`
   (`records/columns.py`) that says what it is and how it is printed; the result, which has `points`, `budgets` and
   `summary()`; and `evaluate`, a function of the points.
2. What it shows: a function that gives tables and lines of the result, and one that draws it into a folder.
3. The procedure:
   - the procedure, a frozen dataclass whose fields are the settings, in the order of the record. A `Setting`
     (`engine/settings.py`) gives the unit and the description of each;
   - `check` refuses impossible settings before anything is sent to a device;
   - `plan` lists the steps, each with `what` it measures, and the `group` of steps that share one set-up;
   - `begin` returns the work: `arrange` sets up a group, `take` measures one step, `end` leaves the bench at rest.
     Work under a dynamic load inherits from `DynamicLoadWork` (`measurements/work.py`), which has films, servo
     and end;
   - `course`, where the points themselves tell when to stop, or when a group of steps, such as a mounted sample, has
     enough (`until_full`): `plan` then lists the most steps, and its `basis` is what `course` and `evaluate` judge by;
   - `evaluate` and `report` call the functions of 1 and 2. Where a file gets long, 1 and 2 are a file `report.py`.
4. Its name goes into `engine/catalogue.py`: then its runs resume and replay, and `palpate measure` makes it a command.
5. A shorter name, a longer help and a scene of its own are said in `commands/` by `commands.settings.conducting`; its
   options come from the fields. Where these do not suffice, a command of class `SettingsCommand` adds options.

The engine does the rest (`engine/conduct.py`): it stores each point before it shows it, pauses, resumes and replays.
A procedure never changes; the work holds the state from step to step.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, Self, TypeVar

from palpate.instrument.bench.kinds import Role
from palpate.instrument.errors import PalpateError, RecordError, UsageError
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.console.terminal import load_matplotlib
from palpate.procedures.engine.plan import B, Plan, Predicted, Step
from palpate.procedures.lab.calibrations import Unstored
from palpate.procedures.lab.lab import Dwells, Lab, Target
from palpate.procedures.lab.open import Calibrating
from palpate.procedures.lab.session import CalibrationKeys, Outcome, Session
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import Waveforms
from palpate.procedures.records.resumed import settings_of
from palpate.procedures.records.run import Run
from palpate.procedures.steps.flags import Judged, check_some_valid

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.instrument.models.response import RatioQuestion
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.uncertainty.budget import Propagated


# --- What a procedure finds: its points, its budgets, and its other values for JSON --------------------


P = TypeVar("P", bound="DataclassInstance")


class Result(Protocol):
    """The result of a procedure.

    What a plan predicts of its results is compared with their budgets. A result may have besides:
    `unbudgeted`, values and standard uncertainties by name of results without a budget; and `achieved_u`, the relative
    standard uncertainty that it reached, or None, where that is not the greatest one among the predicted results.
    """

    @property
    def points(self) -> Sequence[DataclassInstance]:
        """The measured points; their fields have the names of the record."""

    @property
    def budgets(self) -> Sequence[Budget | Propagated]:
        """The uncertainty budgets of the result."""

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""


@dataclass(frozen=True, slots=True)
class SimpleResult(Generic[P]):
    """A result for a procedure that needs no class of its own.

    Attributes:
        points: the measured points.
        values: the other values, by their names in JSON.
        budgets: the uncertainty budgets.
    """

    points: Sequence[P]
    values: Mapping[str, object] = field(default_factory=dict)
    budgets: Sequence[Budget | Propagated] = ()

    def summary(self) -> dict[str, Any]:
        return dict(self.values)


# --- What a run is predicted to give, result by result, and what it gave, under the names of the results' budgets

RELATIVE = "relative"
RESULTS, ACHIEVED = "predicted_results", "achieved_results"  # keys of a plan and of a run in JSON


@dataclass(frozen=True, slots=True)
class Expected:
    """The uncertainty of one result.

    Attributes:
        name: name of the result; that of its budget, if it has one.
        u: standard uncertainty; in most cases the root mean square of what runs give, as a scatter that is known
            beforehand stands for the scatter of a run's own points.
        unit: unit of `u`; "relative": it is relative to the result.
    """

    name: str
    u: float
    unit: str = RELATIVE

    @classmethod
    def of(cls, budget: Budget) -> Expected:
        """The relative uncertainty of a budget's result."""
        return cls(budget.quantity, budget.u / abs(budget.value))


def predicted(steps: Sequence[Step], results: Sequence[Expected], u: float | None = None) -> Predicted:
    """The prediction of a run by its steps and its results; `u`: None: the greatest relative uncertainty among them."""
    seconds = math.fsum(step.seconds_expected for step in steps)
    return foreseen(seconds, greatest(results) if u is None else u, results)


def foreseen(
    seconds: float, u: float | None, results: Sequence[Expected], lines: Sequence[str] = (), **details: Any
) -> Predicted:
    """The prediction of a run with its results; the other arguments are as of `Predicted`."""
    return Predicted(seconds, u, {RESULTS: [asdict(each) for each in results], **details}, lines)


def expected_of(plan: Plan[Any]) -> list[Expected]:
    """The results that a plan predicts."""
    return [Expected(**row) for row in plan.predicted.details.get(RESULTS, ())]


def achieved(expected: Sequence[Expected], result: Result) -> list[Expected]:
    """What a run achieved of what was expected of it; a result that the run does not have is left out."""
    linear = [each if isinstance(each, Budget) else each.budget for each in result.budgets]
    values = {each.quantity: (each.value, each.u) for each in linear} | dict(getattr(result, "unbudgeted", {}))
    found = []
    for each in expected:
        value, u = values.get(each.name, (0.0, None))
        if u is None or (each.unit == RELATIVE and not value):
            continue
        found.append(Expected(each.name, u / abs(value) if each.unit == RELATIVE else u, each.unit))
    return found


def greatest(results: Sequence[Expected]) -> float | None:
    """The greatest relative uncertainty among some results; None: there is none."""
    return max((each.u for each in results if each.unit == RELATIVE), default=None)


def achieved_u(plan: Plan[Any], result: Result) -> float | None:
    """The relative standard uncertainty that a run achieved, to compare with the plan's; None: it is not known."""
    expected = expected_of(plan)
    reached = achieved(expected, result)
    found: float | None = getattr(result, "achieved_u", greatest(reached) if len(reached) == len(expected) else None)
    return found


# --- the procedure -------------------------------------------------------------------------------------

S = TypeVar("S", bound=Step)
R = TypeVar("R", bound=Result)
S_contra = TypeVar("S_contra", bound=Step, contravariant=True)
P_co = TypeVar("P_co", bound="DataclassInstance", covariant=True)


@dataclass(frozen=True, slots=True)
class Measurement(Generic[P_co]):
    """A measured step.

    Attributes:
        point: the point.
        waveforms: its waveforms, by name.
        error: an error that ends the run; it is raised once the point is stored.
        beside: values that the record keeps beside those of the point, by the names of their columns.
    """

    point: P_co
    waveforms: Waveforms = field(default_factory=dict)
    error: PalpateError | None = None
    beside: Mapping[str, float | None] = field(default_factory=dict)


class Work(Protocol[S_contra, P_co]):
    """The work of a procedure on the bench, which holds the state from step to step."""

    def arrange(self, step: S_contra) -> None:
        """Set up what a group of steps shares, such as a mounted sample. Called before the first step of the group."""

    def take(self, step: S_contra) -> Measurement[P_co]:
        """Measure one step."""

    def end(self) -> None:
        """Leave the bench at rest, and check that it has not drifted."""


@dataclass(frozen=True, slots=True)
class RequiredLoads:
    """Loads that the load cell's calibration must cover.

    Attributes:
        values: loads, peak to peak [N].
        extrapolate: True: loads outside the calibrated range are allowed.
    """

    values: Sequence[float]
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """How a result is shown.

    Attributes:
        show: gives the tables (of rich) and lines of text that show the result, by its outcome.
        draw: draws a plot into a folder; returns its path.
    """

    show: Callable[[Outcome], Sequence[object]]
    draw: Callable[[Path], Path]


@dataclass(frozen=True, slots=True)
class Finished(Generic[R]):
    """A complete run with its result.

    Attributes:
        procedure: the procedure.
        result: its result.
        session: the recorded run on the open bench; of a pickled result, what is left of it.
        outcome: the keys that every result has in JSON.
        unstored: why its calibration is not stored for later runs; None: it is, or there is none.
    """

    procedure: Procedure[Any, Any, R]
    result: R
    session: Session = field(repr=False)
    outcome: Outcome
    unstored: Unstored | None = None

    def conclude(self) -> None:
        """Raises EstimateError: the result permits no conclusion; Unstored: its calibration is not stored."""
        if self.unstored is not None:
            raise self.unstored
        self.procedure.check_result(self.result)

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.session.folder

    @property
    def replayed(self) -> bool:
        """Whether the run was replayed from a bus log; then no calibration is stored for later runs."""
        return self.session.replayed

    @property
    def run(self) -> Run:
        """The run on disk. Raises RecordError: it cannot be read."""
        return Run.open(self.folder)

    def plot(self) -> Path | None:
        """Draw the result into the run's folder; returns the file, or None: the procedure draws nothing."""
        report = self.procedure.report(self.result, self.session.lab)
        if report is None:
            return None
        load_matplotlib()
        return report.draw(self.folder)


@dataclass(frozen=True)
class Procedure(ABC, Generic[S, P, R, B]):
    """A measurement on a bench, as a frozen dataclass whose fields are its settings.

    Its type parameters are the classes of its steps `S`, of its points `P`, of its result `R`, and of the basis of its
    plan `B`, which most have not.

    Attributes:
        name: name of the procedure, in records and commands.
        point: class of its points.
        calibrates: whether each of its runs has a calibration that is stored for later runs.
        calibrating: what it calibrates, so that it needs no stored calibration of it; None: nothing.
        resumable_on_real_bench: True: a run on a real bench can be resumed at any point; False: its points must be
            taken in one run. A run of a simulated bench can always be resumed.
        pausable: True: outputs may go to zero before any step, because each step sets its load again.
        manual_work: what a person does in addition to mounting samples, as "places weights"; empty: nothing.
        automated_by: role of a device that does the `manual_work` instead, if the bench has one; None: no device can.
        constants: entries of the record in addition to the settings.
    """

    name: ClassVar[str]
    point: ClassVar[type[Any]]
    calibrates: ClassVar[bool] = False
    calibrating: ClassVar[Calibrating | None] = None
    resumable_on_real_bench: ClassVar[bool] = False
    pausable: ClassVar[bool] = False
    manual_work: ClassVar[str] = ""
    automated_by: ClassVar[Role | None] = None
    constants: ClassVar[Mapping[str, object]] = {}

    @classmethod
    def recorded(cls, run: Run) -> Self:
        """The procedure of a run, with its settings.

        Raises:
            UsageError: the run is of another procedure.
            RecordError: another version recorded the settings.
        """
        if run.procedure != cls.name:
            raise UsageError(f"{run.folder} is of procedure {run.procedure!r}, not {cls.name!r}; name its class")
        given = run.header["settings"]
        if isinstance(given, dict) and (lacking := {each.name for each in fields(cls)} - given.keys()):
            lack = ", ".join(sorted(lacking))
            raise RecordError(
                f"{run.folder}: its settings were recorded by another version of palpate (no {lack}); run anew"
            )
        return settings_of(run, cls)

    def on(self, target: Target) -> Self:
        """The procedure for this bench: settings that it leaves to the sensor are filled in. Nothing is sent."""
        return self

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device. Raises UsageError, RangeError, UnknownName."""

    def required_loads(self) -> RequiredLoads | None:
        """The loads that the load cell's calibration must cover; None: there are none, or they are not known yet."""
        return None

    def dwells(self) -> Dwells | None:
        """The load sets of which the result is made; None: it also comes from something else.

        A simulated bench that knows them can leave out the effects that they do not feel (`--fidelity`).
        """
        return None

    def model_question(self, design: Design) -> RatioQuestion | None:
        """What `evaluate` asks a sensor model, for whose calibration by references the store is searched.

        None: it asks none, or shall not use a calibration.
        """
        return None

    @abstractmethod
    def plan(self, target: Target) -> Plan[S, B]:
        """All steps in order, each with its expected time and uncertainty; `check` has passed. Raises RangeError."""

    @abstractmethod
    def begin(self, plan: Plan[S, B], lab: Lab, record: Recorder) -> Work[S, P]:
        """Set up what all steps share, and return the work. `record` takes events."""

    def course(self, plan: Plan[S, B], points: Sequence[P], lab: Lab) -> Generator[int, None, str]:
        """The way through the plan: yields the number of each step, from 0, that is to be taken.

        Steps may be left out, but none comes after a later one. `points` are those so far: it has one more after each
        `yield`. What is returned says, for people, why the run ends before its plan; empty: all that was needed is
        done. All must follow from the points, so that a run that is resumed or replayed goes the same way.
        """
        yield from range(len(plan.steps))
        return ""

    @abstractmethod
    def evaluate(self, points: Sequence[P], plan: Plan[S, B], lab: Lab) -> R:
        """Compute the result from the points. Raises EstimateError: they give no result."""

    def save_calibration(self, done: Finished[R]) -> CalibrationKeys:
        """Store a calibration for later runs, after all else that follows from the points.

        The engine calls it before it calls the run complete, so a run that was killed here does it once more.

        Returns keys to add to the outcome. Raises RecordError; Unstored: only the store cannot be written to.
        """
        return {}

    def report(self, result: R, lab: Lab) -> Report | None:
        """How to show the result; None: as a table of its points."""
        return None

    def check_result(self, result: R) -> None:
        """Refuse a result that permits no conclusion; the engine calls it after the result was shown.

        By default at least one point must be valid, if points say whether they are. Raises EstimateError.
        """
        if judged := [point for point in result.points if isinstance(point, Judged)]:
            check_some_valid(judged)


def until_full(
    steps: Sequence[S],
    points: Sequence[P],
    part: Callable[[S], Hashable],
    full: Callable[[S, Sequence[P]], bool],
) -> Generator[int, None, str]:
    """The course of a run whose steps come in parts, such as samples, each of which ends once it has enough points.

    Args:
        steps: all steps; those of a part follow each other.
        points: the points so far, as `course` is given them.
        part: the part to which a step belongs.
        full: whether the part of a step needs no further point, by the points that this part has.
    """
    now, begun, ended = object(), 0, False
    for number, step in enumerate(steps):
        if part(step) != now:
            now, begun, ended = part(step), len(points), False
        ended = ended or full(step, points[begun:])
        if not ended:
            yield number
    return ""
