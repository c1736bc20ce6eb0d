"""Opens a bench, real or simulated, and the record of a run on it: here drivers and simulators meet."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from palpate.drivers.bench import Bench
from palpate.drivers.clock import BenchClock, WallClock
from palpate.drivers.logs.bus_log import BusLog, check_log
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.bench.operator import Operator
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.contracts import contracts_digest
from palpate.instrument.errors import RecordError, UsageError
from palpate.instrument.models.evidence import of_experiment, ratio_by
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.arithmetic import arithmetic
from palpate.procedures.commands.options import Choice, result_folder
from palpate.procedures.lab.calibrations import films_of, load_cell_of
from palpate.procedures.lab.operator import ASSUME, ConsoleOperator, Mounting, assume, check_somebody, weaker
from palpate.procedures.lab.software import commit, versions
from palpate.procedures.records.encoding import as_json
from palpate.procedures.records.record import Recorder, put_file
from palpate.procedures.records.resumed import Resumed
from palpate.procedures.showing.terminal import say
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene, with_model
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from palpate.procedures.engine.replay import Replay

DEFAULT_SCENE = "thesis_single"


@dataclass(frozen=True, slots=True)
class Target:
    """What is known of a bench before it is opened: its sensor, its force limit in N, how many sensor nodes it has.

    `model`: by which a simulated one answers; None: it may be real.
    """

    design: Design
    force_limit: float
    nodes: int
    model: str | None = None


Check = Callable[[Target], object]
Calibrating = Literal["load cell", "films"]


@dataclass(frozen=True, slots=True)
class Session:
    """An open bench with the run that is being recorded on it; the design's sensitivities are those of `films`."""

    bench: Bench
    design: Design
    scene: Scene | None
    calibration: LoadCellCalibration
    films: FilmCalibration | None
    record: Recorder
    started: datetime
    wall_start: float
    mounting: Mounting
    replayed: bool = False

    @property
    def model(self) -> str | None:
        """The sensor model that the scene's force ratios come from; None: nothing is simulated."""
        return self.scene.model if self.scene else None

    def outcome(self) -> dict[str, Any]:
        """What every result says of itself."""
        return {
            "simulated": self.bench.simulated,
            "run": str(self.record.folder),
            "design": self.design.name,
            "scene": self.scene.name if self.scene else None,
            "model": self.model,
            "parameter_set": self.scene.file.parameters if self.scene else None,
            "evidence": None if self.model is None else of_experiment("force_ratio", ratio_by(self.model)).value,
            "seed": self.scene.seed if self.scene else None,
            "calibration": f"{self.calibration.source}{self.calibration.marks()}",
            "film_calibration": f"{self.films.source}{self.films.marks()}" if self.films else None,
            "calibration_files": calibration_files(self.calibration, self.films),
            "mounting": self.mounting,
            "bench_seconds": self.bench.clock.now_ns() / 1e9,
            "wall_seconds": time.monotonic() - self.wall_start,
        }


def calibration_files(load_cell: LoadCellCalibration, films: FilmCalibration | None) -> dict[str, Any]:
    """What a run says of the files of its calibrations."""
    return {"load_cell": load_cell.about(), "films": None if films is None else films.about()}


@contextmanager
def open_session(
    procedure: str,
    choice: Choice,
    settings: Mapping[str, object],
    check: Check,
    *,
    model: str | None = None,
    parameters: str | None = None,
    calibrating: Calibrating | None = None,
    resumed: Resumed | None = None,
    replay: Replay | None = None,
    by_hand: str = "",
) -> Iterator[Session]:
    """Open the bench and its run, a new one or one that goes on; on the way out outputs are off, then it is closed.

    A run that is `calibrating` the load cell needs no calibration of it; one of the films uses none of theirs. A replay
    has the bench, the calibrations and the date of its log. `by_hand` is what a person does in it beside mounting
    samples.

    Raises:
        UsageError: options that exclude each other, a folder that holds a run, whatever `check` refuses; nobody could
            confirm what is mounted; another bench than that of the run which is to go on.
        ConfigError, UnknownName: a bench, scene or calibration file is wrong.
        BenchError: a device cannot be opened or identified. RecordError: the folder cannot be written.
    """
    today, wall_start = datetime.now(UTC), time.monotonic()
    before = resumed or replay
    started = today if before is None else before.run.started
    given, chosen = _chosen(choice, model, parameters) if replay is None else (replay.wire.description, replay.scene)
    check(_target(given, chosen))
    mounting: Mounting = "simulated" if replay is None else replay.mounting
    if given is not None and replay is None:
        mounting = check_somebody(by_hand, given.sample_changer is not None, choice.assume_mounted)
    with ExitStack() as stack:
        folder = resumed.folder if resumed else stack.enter_context(places(choice, procedure, today))
        clock: BenchClock = WallClock(0 if resumed is None else resumed.bench_ns)
        operator: Operator = ConsoleOperator(assume if mounting == "assumed" else None)
        description = given
        if replay is not None:
            wire = stack.enter_context(replay.wire)
            description, clock, operator = wire.description, wire, ConsoleOperator(lambda _what, _word: None)
        elif chosen is not None:
            simulated = stack.enter_context(SimulatedBench(chosen))
            description, clock, operator = simulated.description, simulated.clock, simulated.operator
            today = started  # its calendar stands still
        assert description is not None
        opening = stack.enter_context(ExitStack())
        opened = Bench(description, clock, operator)
        opened.waits = lambda why: say(f"palpate: note: {why}", err=True)
        log = None
        if choice.log is not None:
            log = stack.enter_context(_logging(BusLog(opened, clock, choice.log, started), folder))
        if replay is not None:
            replay.wire.attach(opened)
        opening.enter_context(opened)
        design = get_design(description.design).with_pickup(description.pickup)
        if replay is not None:
            calibration, films = replay.calibration, replay.films
        else:
            calibration = THESIS_LOAD_CELL if calibrating == "load cell" else load_cell_of(opened, today.date())
            films = None if calibrating else films_of(opened, design, today.date())
        header = {
            "procedure": procedure,
            "simulated": opened.simulated,
            "started": started.isoformat(timespec="seconds"),
            "settings": dict(settings),
            "scene": None
            if chosen is None
            else {"name": chosen.name, "model": chosen.model, "why": chosen.why, "toml": chosen.to_toml()},
            "seed": None if chosen is None else chosen.seed,
            "bench": description.to_toml(),
            "mounting": mounting,
            "devices": {device.name: device.serial for device in opened.devices},
            "contracts": contracts_digest(),
            "calibration": calibration.model_dump(),
            "film_calibration": films.model_dump() if films else None,
            "calibration_files": calibration_files(calibration, films),
            "versions": versions(),
            "arithmetic": arithmetic(),
            "commit": commit(),
            **(replay.header if replay is not None else {}),
        }
        if log is not None:
            log.describe(as_json(header))
        if resumed is None:
            record = stack.enter_context(Recorder.create(folder, header))
        else:
            header["mounting"] = mounting = weaker(resumed.run.header.get("mounting"), mounting)
            resumed.begin(header)
            record = stack.enter_context(resumed)
        stack.enter_context(opening.pop_all())  # left before the record, whose disk may be slow
        opened.attend(record.event)
        for caution in opened.cautions:
            say(f"palpate: note: {caution}", err=True)
            record.event("caution", caution, opened.clock.now_ns())
        put_file(folder / "bench.toml", str(header["bench"]))
        if chosen is not None:
            put_file(folder / "scene.toml", chosen.to_toml())
        if films is not None:
            design = films.apply(design)
        try:
            replayed = replay is not None
            yield Session(opened, design, chosen, calibration, films, record, started, wall_start, mounting, replayed)
        except BaseException as error:
            if record.points:
                remedy = "" if replay else f"; go on with: palpate runs resume {record.folder}"
                error.add_note(f"points already taken are kept in {record.folder}{remedy}")
            raise


@contextmanager
def _logging(log: BusLog, folder: Path) -> Iterator[BusLog]:
    """A log; where its end alone fails, the error says where the run is."""
    ended = False
    try:
        with log:
            yield log
            ended = True
    except RecordError as error:
        if ended:
            error.add_note(f"the run is kept in {folder}; look at it with palpate runs show")
        raise


@contextmanager
def places(choice: Choice, procedure: str, started: datetime) -> Iterator[Path]:
    """The folder of a run; its log can be written, too. Raises UsageError, RecordError as `open_session`."""
    with result_folder(choice.out, procedure, started) as folder:
        if choice.log is not None:
            check_log(choice.log)
        yield folder


def target_of(choice: Choice, model: str | None = None) -> Target:
    """Of the bench that a command will open. Raises UsageError, ConfigError, UnknownName as `open_session`."""
    return _target(*_chosen(choice, model))


def _target(description: BenchDescription | None, scene: Scene | None) -> Target:
    if description is not None:
        design = get_design(description.design).with_pickup(description.pickup)
        return Target(design, description.force_limit, len(description.can.nodes))
    assert scene is not None
    design = scene.design.with_pickup(scene.pickup)
    return Target(design, BenchDescription.model_fields["force_limit"].default, scene.nodes, scene.model)


def _chosen(
    choice: Choice, model: str | None, parameters: str | None = None
) -> tuple[BenchDescription | None, Scene | None]:
    """The bench file, or the scene where none is given."""
    if choice.bench is None:
        if choice.assume_mounted:
            raise UsageError(f"{ASSUME}: a simulated bench mounts its samples itself; leave it out or give --bench")
        return None, _scene(choice.scene, choice.seed, model, parameters)
    given = {"--scene": choice.scene, "--seed": choice.seed, "--model": model}
    if extra := [option for option, value in given.items() if value is not None]:
        raise UsageError(f"{', '.join(extra)}: only a simulated bench has it; leave it out or leave out --bench")
    return read_bench(choice.bench), None


def _scene(name: str | None, seed: int | None, model: str | None, parameters: str | None) -> Scene:
    scene = read_scene(DEFAULT_SCENE if name is None else name)
    if seed is not None:
        scene = scene.with_seed(seed)
    return with_model(scene, model, parameters) if model is not None else scene
