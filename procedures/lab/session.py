"""Records a run on an open bench: makes its folder, writes its header, and ends it safely."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from traceback import format_exception
from typing import TYPE_CHECKING, Any, NotRequired, TypedDict

from palpate.drivers.clock import WallClock
from palpate.drivers.roles import LoadIndicator, SensorNode
from palpate.instrument.additions import Addition
from palpate.instrument.arithmetic import arithmetic
from palpate.instrument.bench.description import recorded_bench
from palpate.instrument.bench.kinds import Role
from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.files import read_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.contracts import contracts_digest
from palpate.instrument.errors import ConfigError, PalpateError, RecordError, UsageError
from palpate.instrument.models.evidence import of_experiment, ratio_by
from palpate.procedures.console.terminal import say
from palpate.procedures.lab.about import added_by, commit, versions
from palpate.procedures.lab.before import BEFORE
from palpate.procedures.lab.calibrations import KEPT
from palpate.procedures.lab.lab import Lab, owner
from palpate.procedures.lab.logged import Used, load_cell_in, mounting_in, mountings_in, scene_in
from palpate.procedures.lab.open import Calibrating, OpenBench, driven_bench, lab_with
from palpate.procedures.lab.operator import ConsoleOperator, Mounting, weaker
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.events import Listener, unheard
from palpate.procedures.records.record import PAUSED, Recorder, put_file
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.resumed import Resumed, header_of
from palpate.procedures.records.run import Run
from palpate.procedures.steps.beside import BesideSummary, summed_up
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.instrument.models.response import RatioQuestion


class Promise(TypedDict):
    """What a run was predicted to take and to give, and what it took and gave; None: not known."""

    predicted_seconds: float | None
    predicted_u: float | None
    achieved_seconds: float | None
    achieved_u: float | None
    predicted_results: list[dict[str, Any]]
    achieved_results: list[dict[str, Any]]


class Outcome(Promise):
    """Keys that every result in JSON has: where it comes from and what it was computed with."""

    simulated: bool
    run: str
    design: str
    scene: str | None
    model: str | None
    parameter_set: str | None
    evidence: str | None
    seed: int | None
    calibration: str
    film_calibration: str | None
    calibration_files: dict[str, object]
    mounting: Mounting
    bench_seconds: float
    wall_seconds: float
    calibration_file: NotRequired[str]
    certificate: NotRequired[str]
    film_calibration_file: NotRequired[str]
    model_calibration_file: NotRequired[str]
    mounting_scatter_file: NotRequired[str]
    fidelity: NotRequired[float]
    left_out: NotRequired[list[str]]
    about: NotRequired[dict[str, str]]
    beside: NotRequired[list[BesideSummary]]


class Reduced(TypedDict, total=False):
    """Keys of a run whose scene was reduced by `--fidelity`: the fidelity, and the effects that it left out."""

    fidelity: float
    left_out: list[str]


class CalibrationKeys(TypedDict, total=False):
    """Keys that a calibration run adds to its outcome, or replaces there."""

    calibration: str
    film_calibration: str
    calibration_file: str
    certificate: str
    film_calibration_file: str
    model_calibration_file: str
    mounting_scatter_file: str


def reserved() -> frozenset[str]:
    """Names of values that palpate gives for every run, which no value of a result can have."""
    return frozenset({*Outcome.__annotations__, "points", "plot", "budgets", "verdict", "verdicts"})


@dataclass(frozen=True, slots=True)
class Session:
    """A run that is being recorded on an open bench.

    Attributes:
        opened: the open bench.
        lab: the same, with the calibrations of the run.
        record: the record of the run.
        mounting: how it is known what is mounted.
        begun: header with which the run began, if it goes on; empty: it is a new one.
    """

    opened: OpenBench
    lab: Lab
    record: Recorder
    mounting: Mounting
    begun: Mapping[str, Any] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it as `PastSession`, because nobody else can go on with it."""
        return PastSession, (self.folder, self.replayed, self.lab, self.mounting)

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.record.folder

    @property
    def replayed(self) -> bool:
        """Whether the run is replayed from a bus log."""
        return self.opened.chosen.logged is not None

    @property
    def bench(self) -> Bench:
        """The open bench."""
        return self.lab.bench

    @property
    def model(self) -> str | None:
        """Name of the sensor model that gives the scene's force ratios; None: nothing is simulated."""
        return self.opened.scene.model if self.opened.scene else None

    def outcome(self) -> Outcome:
        """The keys that the run's result has in JSON."""
        wall, scene = time.monotonic() - self.opened.wall_start, self.opened.scene
        begun = self.begun if self.begun else {"about": self.opened.chosen.about}
        return outcome_of(self.lab, self.folder, scene, self.mounting, begun, self.bench.clock.now_ns() / 1e9, wall)


def outcome_of(
    lab: Lab,
    folder: Path,
    scene: Scene | None,
    mounting: Mounting,
    begun: Mapping[str, Any],
    bench_seconds: float,
    wall_seconds: float,
) -> Outcome:
    """The keys that the result of a run has in JSON.

    Args:
        lab: the bench with the calibrations of the run.
        folder: folder of the run.
        scene: the scene that was simulated; None: nothing was simulated in this process.
        mounting: how it is known what is mounted.
        begun: the header with which the run began; of a new run only what it says about itself.
        bench_seconds, wall_seconds: how long it took.
    """
    model = scene.model if scene else None
    films = (
        None
        if lab.films is None
        else _calibration_text(lab, begun, lab.films, "film_calibration", SensorNode, lab.design.name)
    )
    found: Outcome = {
        "simulated": lab.bench.simulated,
        "run": str(folder),
        "design": lab.design.name,
        "scene": scene.name if scene else None,
        "model": model,
        "parameter_set": scene.file.parameters if scene else None,
        "evidence": None if model is None else of_experiment("force_ratio", ratio_by(model)).value,
        "seed": scene.seed if scene else None,
        "calibration": _calibration_text(lab, begun, lab.calibration, "calibration", LoadIndicator),
        "film_calibration": films,
        "calibration_files": _calibration_files(lab),
        "mounting": mounting,
        "bench_seconds": bench_seconds,
        "wall_seconds": wall_seconds,
        "predicted_seconds": None,
        "predicted_u": None,
        "achieved_seconds": None,
        "achieved_u": None,
        "predicted_results": [],
        "achieved_results": [],
    }
    if about := begun.get("about"):
        found["about"] = dict(about)
    if asked := lab.bench.description.beside:
        found["beside"] = summed_up(asked, Run.open(folder).points())
    return {**found, **_reduced(scene)}


def _calibration_text(
    lab: Lab, begun: Mapping[str, Any], calibration: Calibration, key: str, role: type[Any], *of: str
) -> str:
    """A calibration of a run for people, with what speaks against it; `key` names it in the header."""
    doubts = [] if calibration == THESIS_LOAD_CELL else calibration.doubts(owner(lab.bench, role, *of), lab.started)
    before = begun.get(key)
    if isinstance(before, dict) and before.get("source") != calibration.source:
        doubts.append(f"the run began with {before.get('source')}")
    text = f"{calibration.source}{calibration.marks()}"
    return f"{text} ({'; '.join(doubts)})" if doubts else text


def _reduced(scene: Scene | None) -> Reduced:
    """What was left out of a scene by `--fidelity`; empty if nothing was asked."""
    if scene is None or scene.file.fidelity is None:
        return {}
    return {"fidelity": scene.file.fidelity, "left_out": list(scene.file.left_out or ())}


def _calibration_files(lab: Lab) -> dict[str, object]:
    """What the record says about the files of the run's calibrations."""
    films = None if lab.films is None else lab.films.about()
    used: dict[str, object] = {"load_cell": lab.calibration.about(), "films": films}
    return used if lab.references is None else {**used, "model": lab.references.about()}


@dataclass(frozen=True, slots=True)
class PastSession:
    """What a pickled result keeps of its `Session`. Its bench is closed."""

    folder: Path
    replayed: bool
    lab: Lab
    mounting: Mounting


@contextmanager
def places(out: Path | None, log: Path | None, procedure: str, started: datetime) -> Iterator[Path]:
    """The folder of a new run; its log can be written, too. Raises as `result_folder` and `check_log` do."""
    with result_folder(out, procedure, started) as folder:
        if log is not None:
            from palpate.drivers.logs.bus_log import check_log

            check_log(log)
        yield folder


@contextmanager
def recording(
    opened: OpenBench,
    procedure: str,
    settings: Mapping[str, object],
    folder: Path,
    *,
    calibrating: Calibrating | None = None,
    question: RatioQuestion | None = None,
    manual_work: str = "",
    automated_by: Role | None = None,
    outside: Addition | None = None,
    planned: Mapping[str, object] | None = None,
    listener: Listener = unheard,
    resumed: Resumed | None = None,
) -> Iterator[Session]:
    """Begin a run on an open bench, or go on with one. If it fails, outputs are off before the record is closed.

    Args:
        opened: the open bench.
        procedure: name of the procedure.
        settings: settings of the procedure, for the record's header.
        folder: folder of the run.
        calibrating: what the run calibrates; None: nothing.
        question: what the run asks a sensor model, which may be calibrated by references; None: it asks none.
        manual_work: what a person does in addition to mounting samples, as "places the weights"; empty: nothing.
        automated_by: role of a device that does this work instead, if the bench has one; None: no device can.
        outside: where a procedure that is not palpate's own comes from; None: it is palpate's own.
        planned: what is told of the plan, for the record's header; None: there is none.
        listener: called with each event of a new run.
        resumed: the run to go on with, which has its listener; None: a new run.

    Raises:
        UsageError: the folder holds a run; nobody can confirm what is mounted; a resumed run began on another bench;
            an earlier run on this bench failed; or the bench's log holds a run already.
        ConfigError: a calibration is missing, damaged, expired, or belongs to another device.
        RecordError: the folder cannot be written.
    """
    if not opened.bench.is_open or (opened.runs and opened.log is not None):
        why = (
            "its log holds a run already"
            if opened.bench.is_open
            else "it is closed, as its block ended or a run failed"
        )
        raise UsageError(f"no other run can begin on this bench: {why}; open the bench anew")
    logged, scene = opened.chosen.logged, opened.scene
    mounting = opened.chosen.mounting(manual_work, automated_by, opened.bench.fills)
    started = datetime.now(UTC) if opened.runs else opened.started
    if resumed is not None:
        started = resumed.run.started
    lab = opened.lab(folder.name, started, calibrating, question)
    if resumed is not None:  # it was planned with what was stored when it began, not with what came of it
        lab = replace(lab, mountings=mountings_in(resumed.run.header, str(folder)))
        if calibrating == "load cell":
            lab = replace(lab, calibration=load_cell_in(resumed.run.header, str(folder)))
    header = {
        "procedure": procedure,
        "simulated": lab.bench.simulated,
        "started": started.isoformat(timespec="seconds"),
        "settings": dict(settings),
        **({} if planned is None else {"planned": dict(planned)}),
        "scene": None
        if scene is None
        else {
            "name": scene.name,
            "model": scene.model,
            "why": scene.why,
            **_reduced(scene),
            "toml": scene.to_toml(),
        },
        "seed": None if scene is None else scene.seed,
        **({"about": dict(opened.chosen.about)} if opened.chosen.about else {}),
        "bench": lab.bench.description.to_toml(),
        "mounting": mounting,
        "devices": {device.name: device.serial for device in lab.bench.devices},
        "contracts": contracts_digest(lab.bench.description.contracts),
        **({"maps": maps} if (maps := lab.bench.description.maps) else {}),
        "calibration": lab.calibration.model_dump(),
        "film_calibration": lab.films.model_dump() if lab.films else None,
        **({} if lab.references is None else {"model_calibration": lab.references.model_dump()}),
        **({} if lab.mountings is None else {"mounting_scatter": lab.mountings.model_dump()}),
        "calibration_files": _calibration_files(lab),
        "versions": versions() | added_by(lab.bench.description, scene, outside),
        "arithmetic": arithmetic(),
        "commit": commit(),
        **({} if outside is None else {"procedure_from": outside.package}),
        **(logged.header if logged is not None else {}),
    }
    before = None if opened.history is None else opened.history.begin()
    if before is not None:
        header[BEFORE] = asdict(before)
        if before.unknown:
            say(f"palpate: note: this run cannot be resumed if it is interrupted: {before.unknown}", err=True)
    begun_ns = 0 if opened.history is None else opened.history.now_ns
    opened.runs.append(folder)
    with ExitStack() as stack:
        if opened.log is not None:
            opened.log.describe(as_json(header))
        if resumed is None:
            record = stack.enter_context(Recorder.create(folder, header, listener))
        else:
            header["mounting"] = mounting = weaker(resumed.run.header.get("mounting"), mounting)
            resumed.begin(header)
            record = stack.enter_context(resumed)
        failing = stack.enter_context(ExitStack())  # ends before the record does, because its disk may be slow
        failing.push(lab.bench)
        lost = logged is not None or (before is not None and before.unknown)
        with _kept(record, lab.bench, "" if lost else f"; go on with: palpate runs resume {record.folder}"):
            lab.bench.attend(record.event)
            lab.bench.sampled = partial(record.tell, "trace")
            for caution in lab.bench.cautions:
                say(f"palpate: note: {caution}", err=True)
                record.event("caution", caution, lab.bench.clock.now_ns())
            put_file(folder / "bench.toml", str(header["bench"]))
            if scene is not None:
                put_file(folder / "scene.toml", scene.to_toml())
            yield Session(opened, lab, record, mounting, {} if resumed is None else resumed.run.header)
        failing.pop_all()
        lab.bench.incidents.hold()
        if opened.history is not None:
            paused = [each["bench_ns"] for each in Run.open(folder).events() if each["kind"] == PAUSED]
            opened.history.end(header, begun_ns, paused, folder)


@contextmanager
def _kept(record: Recorder, bench: Bench, remedy: str) -> Iterator[None]:
    """Add to an error of the block what is kept of the run, and keep the traceback of a defect in it.

    Args:
        record: the record of the run.
        bench: its open bench.
        remedy: how to go on with the run, as the end of a message; empty: it cannot go on.
    """
    try:
        yield
    except BaseException as error:
        if bench.elsewhere:
            raise
        if isinstance(error, Exception) and not isinstance(error, PalpateError):  # a defect, also of a package
            with suppress(RecordError):  # the exception that is being raised says more
                record.event("traceback", "".join(format_exception(error)), bench.clock.now_ns())
            error.add_note(f"the traceback is kept in {record.folder}; look at it with palpate runs show")
        if record.points:
            error.add_note(f"points already taken are kept in {record.folder}{remedy}")
        elif not isinstance(error, Exception):  # Ctrl-C or a signal
            error.add_note(f"no point was taken; the begun run is kept in {record.folder}{remedy}")
        raise


# --- The bench of a recorded run, as its record tells it, to evaluate its points anew. Nothing is opened or sent


def recorded_lab(run: Run) -> Lab:
    """The bench of a run with the calibrations that it used.

    Raises:
        ConfigError: the package of a device, the sensor's design or a calibration is not known here.
        RecordError: the run has not the header of a procedure on a bench.
    """
    header, where = header_of(run), str(run.folder)
    bench = driven_bench(recorded_bench(header["bench"], f"{where}: its bench file"), WallClock(), ConsoleOperator())
    for device in bench.devices:
        if device.name not in header["devices"]:
            bench.leave_out(device, UsageError("the run did not use it"))
        else:
            device.serial, device.simulated = header["devices"][device.name], run.simulated
    indicator = bench.maybe(LoadIndicator)
    with suppress(ConfigError):  # only a load cell's calibration tells what its indicator told then
        kept = read_calibration(run.folder / KEPT, LoadCellCalibration)
        if indicator is not None:
            indicator.resolution_mV, indicator.gage_factor = kept.resolution_mV, kept.gage_factor
    return lab_with(bench, Used.of(header, where), run.folder.name, run.started)


def recorded_outcome(run: Run, lab: Lab) -> Outcome:
    """What the result of a recorded run has in JSON; its time here is not known.

    Raises ConfigError: its scene is wrong.
    """
    header, summary = run.header, run.summary
    seconds: Any = summary.get("bench_seconds", math.nan)
    found = outcome_of(lab, run.folder, scene_in(header, run.folder), mounting_in(header), header, seconds, math.nan)
    promise: Any = {key: summary[key] for key in Promise.__annotations__ if key in summary}
    kept = str(run.folder / KEPT)
    return {
        **found,
        **promise,
        "calibration_file": kept,
        "film_calibration_file": kept,
        "model_calibration_file": kept,
        "certificate": str(run.folder / "certificate.md"),
    }
