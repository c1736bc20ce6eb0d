"""A campaign: procedures in the order in which they need each other, with calibrations only when they are due.

    # nightly.toml
    name = "nightly"
    scene = "thesis_single"            # or bench = "lab.toml"

    [step.cell]
    procedure = "calibrate-load-cell"
    due = "30 d"                       # only where the last one on this bench is older

    [step.sweep]
    procedure = "sweep-loads"
    needs = ["cell"]
    settings = { samples = "1,2", loads = "2 N, 3 N" }

Nothing of the file is executed: a step is a procedure by its name, and its settings are texts as on the command line.
The state of a campaign is the list of its runs, which is on disk before each of them begins. So a campaign that was
killed anywhere goes on: complete runs stay, the one that was begun is resumed, the others follow.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from graphlib import CycleError, TopologicalSorter
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field

from palpate.instrument.config import Config, Name, check, read_data
from palpate.instrument.durable import make_folder, put_whole
from palpate.instrument.errors import ConfigError, PalpateError, RecordError, UnknownName, UsageError, quoted
from palpate.instrument.uncertainty.decision import PASS
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.procedure import Procedure, expected_of
from palpate.procedures.engine.resume import go_on
from palpate.procedures.engine.run import open_and_run, prepared
from palpate.procedures.engine.settings import asked_of, made
from palpate.procedures.engine.verdict import Judgement, judge, read_limits
from palpate.procedures.lab.about import FILE as ABOUT
from palpate.procedures.lab.about import completed
from palpate.procedures.lab.calibrations import is_unstored
from palpate.procedures.lab.chosen import Chosen, choose
from palpate.procedures.lab.run_table import bench_of
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.events import Listener
from palpate.procedures.records.record import locked, new_run_folder
from palpate.procedures.records.run import Run, list_runs, storing
from palpate.procedures.steps.pause import NOBODY

STATE = "campaign.json"
FOLDER = "campaigns"  # in the store
AGE = re.compile(r"(\d+(?:\.\d+)?) ?(h|d|weeks?)")
HOURS = {"h": 1, "d": 24, "week": 168, "weeks": 168}  # of a unit
STEP = re.compile(r"[a-z][a-z0-9_]{0,39}")


def _age(text: str) -> str:
    _hours(text)
    return text


def _hours(text: str) -> float:
    """An age in hours. Raises ValueError: it is none."""
    if (found := AGE.fullmatch(text)) is None:
        raise ValueError(f'{text!r} is no age; write hours, days or weeks, such as "12 h", "30 d" or "2 weeks"')
    return float(found[1]) * HOURS[found[2]]


def _setting(value: object) -> object:
    """A setting as a file may give it. Raises ValueError: it is another one, or a list with others than texts."""
    texts = isinstance(value, list) and all(isinstance(each, str) for each in value)
    if texts or isinstance(value, str | bool | int):
        return value
    raise ValueError(f'{quoted(value)} is no setting; write it in quotes as on the command line, such as "2.5 N"')


class CampaignStep(Config):
    """A `[step.NAME]` table.

    It is carried out where `due`, `every` or `drift` says so, where a step that it needs was, or always without these.
    """

    procedure: Name
    needs: tuple[str, ...] = ()
    settings: dict[str, Annotated[str | bool | int | tuple[str, ...], BeforeValidator(_setting)]] = Field(
        default_factory=dict
    )
    due: Annotated[str, AfterValidator(_age)] | None = None  # greatest age of the last run of the procedure
    every: int | None = Field(default=None, ge=1, strict=True)  # number of other runs on the bench since then
    drift: float | None = Field(default=None, gt=0, lt=1, strict=True)  # relative change between the last two runs
    of: str | None = None  # of which number of their results
    limits: str | None = None  # file by which its result is judged, beside this file


class CampaignFile(Config):
    """The keys of a campaign file."""

    file: ClassVar[str] = "campaign"

    name: Name
    scene: str | None = None
    bench: str | None = None
    seed: int | None = Field(default=None, ge=0, strict=True)
    about: dict[str, str] = Field(default_factory=dict)
    step: dict[str, CampaignStep] = Field(min_length=1)


def _one_name(text: str) -> str:
    if not text or Path(text).name != text:
        raise ValueError(f"{text!r} is no folder of the store")
    return text


class StepState(Config):
    """What was decided about a step: `run` is the folder of its run in the store; None: it was not due."""

    why: str
    run: Annotated[str, AfterValidator(_one_name)] | None = None


class CampaignState(Config):
    """The content of STATE."""

    file_sha256: str
    store: str
    steps: dict[str, StepState]


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """A step of a campaign.

    Attributes:
        name: its name.
        procedure: the procedure, with its settings.
        due: whether it is carried out.
        why: why it is, or is not, for people.
        seconds: expected bench time [s]; 0 where it is not due.
        u: expected relative standard uncertainty of its result; None: none is predicted.
        person: what a person has to do for it; empty: nothing.
    """

    name: str
    procedure: Procedure[Any, Any, Any]
    due: bool
    why: str
    seconds: float
    u: float | None
    person: str

    def summary(self) -> dict[str, Any]:
        """The step for JSON."""
        values = {name: getattr(self, name) for name in ("name", "due", "why", "seconds", "u", "person")}
        return {**values, "procedure": self.procedure.name}


class Campaign:
    """A campaign and what is stored of it.

    Attributes:
        file: the file's content.
        folder: where its state is kept; None: it was not begun, and gets a new folder in the store then.
        chosen: the bench of all steps.
    """

    def __init__(self, path: Path, store: Path, out: Path | None = None, assume_mounted: bool = False) -> None:
        """Read a campaign, or one that was begun in `out`; nothing is written yet.

        Raises:
            ConfigError, UnknownName: the file is wrong. UsageError: `out` holds another campaign.
            RecordError: what is stored in `out` cannot be read.
        """
        self.file = check(read_data(path), CampaignFile, str(path))
        self._store, self._path = store, path
        bench = None if self.file.bench is None else path.absolute().parent / self.file.bench
        about = dict(self.file.about)
        if not (store / ABOUT).exists():  # else the lab says which keys there are
            about.setdefault("campaign", self.file.name)
        about = completed(about, store)
        self.chosen: Chosen = choose(bench, self.file.scene, self.file.seed, None, None, assume_mounted, about=about)
        self.chosen.check_beside()
        self._limits = {
            name: read_limits(path.absolute().parent / step.limits)
            for name, step in self.file.step.items()
            if step.limits is not None
        }
        self._procedures = {name: self._made(name, step) for name, step in self.file.step.items()}
        self.order = _ordered(self.file.step, str(path))
        text = self.file.model_dump_json()
        self._hash = sha256(text.encode()).hexdigest()
        self.folder = out
        self._runs = {} if out is None else self._stored(out)

    def _made(self, name: str, step: CampaignStep) -> Procedure[Any, Any, Any]:
        where = f"{self._path}: step.{name}"
        if not STEP.fullmatch(name):
            raise ConfigError(f"{where}: {quoted(name)} is no name; give small letters, digits and _, such as sweep_2")
        if (step.drift is None) != (step.of is None):
            raise ConfigError(f'{where}: drift and of belong together, as drift = 0.01 and of = "sensitivity_mV_per_N"')
        try:
            kind = procedure_class(step.procedure)
            options = {each.option.removeprefix("--").replace("-", "_"): each for each in asked_of(kind)}
            if unknown := sorted(step.settings.keys() - options.keys()):
                raise UnknownName(f"setting of {step.procedure}", unknown[0], options)
            values = {
                options[key].name: options[key].value(_as_typed(given, options[key].setting.repeated))
                for key, given in step.settings.items()
            }
            if lacking := [key for key, each in options.items() if each.required and each.name not in values]:
                raise ConfigError(f"settings: {lacking[0]} is missing, which {step.procedure} needs; give it")
            return made(kind, values)
        except PalpateError as error:
            raise ConfigError(f"{where}: {error}") from error

    def _stored(self, folder: Path) -> dict[str, StepState]:
        path = folder / STATE
        if not path.exists():
            return {}
        try:
            state = check(json.loads(path.read_text(encoding="utf-8")), CampaignState, str(path))
        except (OSError, ValueError, ConfigError) as error:
            raise RecordError(f"{path} cannot be read ({error}); give another --out to begin anew") from None
        if state.file_sha256 != self._hash or state.steps.keys() - self.file.step.keys():
            raise UsageError(f"{folder} holds a campaign of another file; give another --out")
        if state.store != str(self._store.absolute()):
            raise UsageError(
                f"{folder} was begun with the runs in {state.store}; set $PALPATE_STORE to that folder, or give"
                " another --out"
            )
        return dict(state.steps)

    def _store_state(self, folder: Path) -> None:
        state = CampaignState(file_sha256=self._hash, store=str(self._store.absolute()), steps=self._runs)
        with storing(folder / STATE):
            put_whole(folder / STATE, state.model_dump_json(indent=2))

    def planned(self) -> list[PlannedStep]:
        """All steps in order, with what was decided or would be decided now; nothing is sent.

        Raises UsageError, RangeError, UnknownName: a step is impossible on this bench.
        """
        return [step for step, _ in self._course(None)]

    def _planned(self, name: str, renewed: Sequence[str]) -> PlannedStep:
        procedure = self._procedures[name]
        due, why = self._due(name, renewed)
        try:
            plan = prepared(procedure, self.chosen.target, by_store=False)[1]
            ahead = plan.predicted
            if name in self._limits:
                self._limits[name].open_names(procedure.point, [each.name for each in expected_of(plan)])
        except PalpateError as error:
            error.add_note(f"this is step {name} of {self._path}")
            raise
        person = ""
        if due and self.chosen.description is not None:
            person = ", ".join(part for part in (procedure.manual_work, "confirms what is mounted") if part)
        return PlannedStep(name, procedure, due, why, ahead.seconds if due else 0.0, ahead.u, person)

    def _due(self, name: str, renewed: Sequence[str]) -> tuple[bool, str]:
        """Whether a step is carried out, and why, for people. Once it was decided it stays so."""
        if name in self._runs:
            return self._runs[name].run is not None, self._runs[name].why
        step = self.file.step[name]
        if step.due is None and step.every is None and step.drift is None:
            return True, "in each campaign"
        if renewed:
            return True, f"{' and '.join(renewed)} is done anew"
        runs = list(self._complete())
        of_it = [run for run in runs if run.procedure == step.procedure]
        if not of_it:
            return True, "there is none on this bench yet"
        return _decided(step, of_it, runs, datetime.now(UTC))

    def _complete(self) -> Iterator[Run]:
        """The complete runs in the store on the bench of the campaign, the newest first."""
        for each in list_runs(self._store):
            if each.status == "complete" and each.simulated == (self.chosen.scene is not None):
                run = Run.open(each.folder)
                if bench_of(run.header) == self._bench:
                    yield run

    @property
    def _bench(self) -> str:
        scene, description = self.chosen.scene, self.chosen.description
        return scene.name if scene is not None else description.name if description is not None else ""

    def carried_out(
        self, listener: Callable[[], AbstractContextManager[Listener]]
    ) -> Iterator[tuple[PlannedStep, Judgement | None]]:
        """Carry out what is left to do: each step once it is done, with its verdicts; None: it has no limits.

        A step that needs one whose verdict is not "pass" is left out.

        Args:
            listener: makes a listener for a run.

        Raises what a run and `judge` raise; the error then tells how the campaign goes on. UsageError: another process
        carries it out.
        """

        if self.folder is None:
            self.folder = new_run_folder(self._store / FOLDER, self.file.name, datetime.now(UTC))
        folder = self.folder

        def do(step: PlannedStep) -> None:
            try:
                self._carry_out(step, folder, listener)
            except BaseException as error:
                words = ["palpate", "campaign", str(self._path), "--out", str(folder)]
                words += ["--assume-mounted"] * self.chosen.assume_mounted
                error.add_note(f"this was step {step.name} of the campaign; go on with: {shlex.join(words)}")
                raise

        with storing(folder):
            make_folder(folder)
        with locked(folder):
            self._runs = self._stored(folder)
            yield from self._course(do)

    def _course(self, do: Callable[[PlannedStep], None] | None) -> Iterator[tuple[PlannedStep, Judgement | None]]:
        """Each step in order, with its verdicts once it is complete; `do`: carries it out; None: nothing is done."""
        renewed: set[str] = set()
        bad: list[str] = []
        for name in self.order:
            needs = self.file.step[name].needs
            step, judged = self._planned(name, sorted(renewed & set(needs))), None
            if stopping := [each for each in needs if each in bad]:
                bad.append(name)
                yield replace(step, due=False, why=f"{stopping[0]} did not pass", seconds=0.0), None
                continue
            if step.due:
                renewed.add(name)
            if do is not None:
                do(step)
            run = self._complete_run(name)
            if run is not None and name in self._limits:
                judged = judge(run, self._limits[name])
                if judged.outcome != PASS:
                    bad.append(name)
            if run is not None and do is None:
                step = replace(step, due=False, why=f"{run.folder.name} is complete", seconds=0.0, person="")
            yield step, judged

    def _complete_run(self, step: str) -> Run | None:
        """The run of a step, if nothing is left to do of it."""
        folder = self.folder_of(step)
        if folder is None or not is_run(folder):
            return None
        run = Run.open(folder)
        return None if run.status != "complete" or self._unstored(step, folder) else run

    def _unstored(self, step: str, folder: Path) -> bool:
        return is_unstored(folder, self._procedures[step].calibrates)

    def folder_of(self, step: str) -> Path | None:
        """Folder of a step's run; None: it has none."""
        name = self._runs[step].run if step in self._runs else None
        return None if name is None else self._store / name

    def _carry_out(
        self, step: PlannedStep, state: Path, listener: Callable[[], AbstractContextManager[Listener]]
    ) -> None:
        """Do what is left of a step; `state`: the folder of the campaign's state."""
        if step.name not in self._runs:
            name = f"{self.file.name}-{step.name}"
            begun = new_run_folder(self._store, name, datetime.now(UTC)).name if step.due else None
            self._runs[step.name] = StepState(why=step.why, run=begun)
            self._store_state(state)
        folder = self.folder_of(step.name)
        if folder is None:
            return
        if not folder.is_dir():
            raise RecordError(f"the run of step {step.name} is gone: {folder}; put it back, or give another --out")
        with listener() as heard:
            if not is_run(folder):
                open_and_run(step.procedure, self.chosen, out=folder, listener=heard)
                return
            run = Run.open(folder)
            if run.status != "complete" or self._unstored(step.name, folder):
                procedure = type(step.procedure).recorded(run)
                assumed = self.chosen.assume_mounted
                go_on(
                    procedure, run, bench=None, accept_change=False, assume_mounted=assumed, listener=heard,
                    pause=NOBODY,
                )  # fmt: skip


def _as_typed(given: str | bool | int | tuple[str, ...], repeated: bool) -> str | bool | tuple[str, ...]:
    """A setting of the file as it is typed on the command line."""
    if isinstance(given, tuple):
        return given if repeated else ",".join(given)
    return given if isinstance(given, str | bool) else str(given)


def _ordered(steps: Mapping[str, CampaignStep], where: str) -> list[str]:
    """The names of the steps, each behind those that it needs. Raises ConfigError: that cannot be."""
    for name, step in steps.items():
        for needed in step.needs:
            if needed not in steps:
                raise ConfigError(f"{where}: step.{name}: needs: {UnknownName('step', needed, steps)}")
    try:
        return list(TopologicalSorter({name: step.needs for name, step in steps.items()}).static_order())
    except CycleError as error:
        circle = " needs ".join(reversed(error.args[1]))
        raise ConfigError(f"{where}: {circle}, so none of them can be the first; take one of these needs out") from None


def _decided(step: CampaignStep, of_it: Sequence[Run], runs: Sequence[Run], now: datetime) -> tuple[bool, str]:
    """Whether a step is due by what is stored: its own runs and all others, the newest first; and why, for people."""
    last = of_it[0]
    kept = []
    if step.due is not None:
        age = now - last.started
        if age < timedelta(0):
            return True, f"the last one, of {last.started:%Y-%m-%d %H:%M}, is later than this computer's clock"
        if age >= timedelta(hours=_hours(step.due)):
            return True, f"the last one, of {last.started:%Y-%m-%d}, is older than {step.due}"
        kept.append(f"the last one, of {last.started:%Y-%m-%d %H:%M}, is younger than {step.due}")
    if step.every is not None:
        since = sum(run.started >= last.started and run.procedure != step.procedure for run in runs)
        if since >= step.every:
            return True, f"{since} runs since the last one"
        kept.append(f"{since} of {step.every} runs since the last one")
    if step.drift is not None and step.of is not None:
        values = [_number(run, step.of) for run in of_it[:2]]
        if len(values) == 2:
            change = abs(values[0] / values[1] - 1) if values[1] else float("inf")
            reason = f"{step.of} changed by {100 * change:.2g} % between the last two"
            if change > step.drift:
                return True, reason
            kept.append(reason)
    return False, "; ".join(kept) or "one is stored"


def _number(run: Run, name: str) -> float:
    """A number of a run's results. Raises ConfigError: there is none of that name."""
    numbers = {key: value for key, value in _flat(run.summary) if isinstance(value, int | float)}
    if name not in numbers:
        raise ConfigError(f"of = {name!r}: {UnknownName(f'number in the results of {run.folder.name}', name, numbers)}")
    return float(numbers[name])


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value
