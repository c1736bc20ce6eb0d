"""Opens a bench, real or simulated: here drivers and simulators meet."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Literal

from palpate.drivers.bench import Bench
from palpate.drivers.clock import BenchClock, WallClock
from palpate.drivers.fitted import check_alone, check_drivable
from palpate.drivers.logs.bus_log import BusLog, check_log
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.bench.kinds import KINDS, Role
from palpate.instrument.bench.operator import Operator
from palpate.instrument.calibration.load_cell_fit import THESIS_LOAD_CELL
from palpate.instrument.contracts.sensor_node import CHANNELS
from palpate.instrument.errors import RecordError, UsageError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.console.terminal import say
from palpate.procedures.lab.calibrations import films_of, load_cell_of
from palpate.procedures.lab.lab import Lab, Target, with_kinds
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.operator import ASSUME, ConsoleOperator, Mounting, assume, check_somebody
from palpate.procedures.lab.software import packages_of
from palpate.procedures.records.resumed import Resumed
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene, with_model
from palpate.simulators.scenes.scene import Scene

DEFAULT_SCENE = "thesis_single"

Calibrating = Literal["load cell", "films"]


@dataclass(frozen=True, slots=True)
class Chosen:
    """Which bench to open: that of a bench file, the simulated bench of a scene, or that of a logged run.

    Attributes:
        description: content of the bench file; None: the bench is simulated.
        scene: the scene; None: the bench is real.
        assume_mounted: True: nobody is asked to confirm what was mounted or placed by hand.
        operator: does the work by hand; None: the person at the console.
        logged: the logged run to replay; None: the bench answers itself.
    """

    description: BenchDescription | None
    scene: Scene | None
    assume_mounted: bool = False
    operator: Operator | None = None
    logged: LoggedRun | None = None

    @classmethod
    def of_log(cls, logged: LoggedRun) -> Chosen:
        """The bench whose answers a log holds."""
        return cls(logged.wire.description, logged.scene, logged=logged)

    @property
    def target(self) -> Target:
        """What is known of the bench before it is opened. Raises ConfigError, UnknownName."""
        if self.description is not None:
            design = get_design(self.description.design).with_pickup(self.description.pickup)
            nodes = self.description.filling("sensor_node")
            channels = nodes[0].kind.channels if nodes else CHANNELS
            drivable = partial(check_drivable, self.description)
            target = Target(design, self.description.force_limit, len(nodes), channels=channels, drivable=drivable)
            return with_kinds(target, self.description.kind_in)
        assert self.scene is not None
        design = self.scene.design.with_pickup(self.scene.pickup)
        force_limit = BenchDescription.model_fields["force_limit"].default
        given = [guest.kind for guest in self.scene.devices if guest.table.get("role") == "sensor_node"]
        count, channels = (len(given), given[0].channels) if given else (self.scene.nodes, CHANNELS)
        target = Target(design, force_limit, count, self.scene.model, channels, drivable=self._check_guests)
        return with_kinds(target, self.scene.kind_in)

    def _check_guests(self, frequency: float) -> None:
        """Check by the scene alone that its additional devices can work with a load of a frequency [Hz].

        Raises RangeError, ConfigError: a device cannot, or its section lacks a key.
        """
        assert self.scene is not None
        for guest in self.scene.devices:
            check_alone(guest.name, guest.kind, guest.settings, frequency)

    def check_names(self) -> None:
        """Raises ConfigError: a device, the design or an effect has a name that an installed package uses as well."""
        if self.description is not None:
            packages_of({each.kind.name for each in self.description.devices}, {self.description.design}, ())
        elif self.scene is not None:
            kinds = {*KINDS, *(guest.kind.name for guest in self.scene.devices)}
            packages_of(kinds, {self.scene.design.name}, self.scene.effects)

    def mounting(
        self, manual_work: str, automated_by: Role | None = None, fills: Callable[[Role], object] | None = None
    ) -> Mounting:
        """How a run will know what is mounted. Raises UsageError as `check_somebody` does.

        Args:
            manual_work: what a person does in addition to mounting samples, as "places the weights"; empty: nothing.
            automated_by: role of a device that does this work instead, if the bench has one; None: no device can.
            fills: whether a device fills a role; None: whether the bench file lists one.
        """
        if self.logged is not None:
            return self.logged.mounting
        if self.description is None:
            return "simulated"
        if self.operator is not None:
            return "confirmed"
        fills = fills or self.description.filling
        if automated_by is not None and fills(automated_by):
            manual_work = ""
        return check_somebody(manual_work, bool(fills("sample_changer")), self.assume_mounted)


def choose(
    bench: Path | None,
    scene: str | None = None,
    seed: int | None = None,
    model: str | None = None,
    parameters: str | None = None,
    assume_mounted: bool = False,
    operator: Operator | None = None,
) -> Chosen:
    """The bench of a bench file or, if none is named, the simulated bench of a scene.

    Raises:
        UsageError: the options exclude each other.
        ConfigError, UnknownName: the bench file or the scene is wrong.
    """
    if bench is None:
        if assume_mounted:
            raise UsageError(f"{ASSUME}: a simulated bench mounts its samples itself; leave it out or give --bench")
        return Chosen(None, _scene(scene, seed, model, parameters))
    given = {"--scene": scene, "--seed": seed, "--model": model}
    if extra := [option for option, value in given.items() if value is not None]:
        raise UsageError(f"{', '.join(extra)}: only for a simulated bench; leave this out, or leave out --bench")
    return Chosen(read_bench(bench), None, assume_mounted, operator)


def _scene(name: str | None, seed: int | None, model: str | None, parameters: str | None) -> Scene:
    scene = read_scene(DEFAULT_SCENE if name is None else name)
    if seed is not None:
        scene = scene.with_seed(seed)
    return with_model(scene, model, parameters) if model is not None else scene


@dataclass(frozen=True, slots=True)
class OpenBench:
    """An open bench, on which runs are recorded one after the other.

    Attributes:
        bench: the open bench.
        chosen: which bench it is.
        today: date by which calibrations expire.
        started: when its first run began.
        wall_start: `time.monotonic()` when it was opened [s].
        log: log of its traffic; None: no log is written.
        runs: folders of the runs so far.
    """

    bench: Bench
    chosen: Chosen
    today: date
    started: datetime
    wall_start: float
    log: BusLog | None
    runs: list[Path] = field(default_factory=list)
    _taking: Lock = field(default_factory=Lock, init=False, repr=False)

    @property
    def scene(self) -> Scene | None:
        """The simulated scene; None: nothing is simulated in this process."""
        return self.chosen.scene

    @property
    def target(self) -> Target:
        """The limits against which procedures check their settings."""
        return self.chosen.target

    def lab(self, run: str, started: datetime, calibrating: Calibrating | None = None) -> Lab:
        """The bench with the calibrations that are stored now; a logged run has its own calibrations.

        Args:
            run: name of the run.
            started: when the run began.
            calibrating: what the run calibrates. The load cell then needs no stored calibration, and no stored
                calibration of the films is used.

        Raises:
            ConfigError: a calibration is missing, damaged, expired, or belongs to another device.
        """
        description, logged = self.bench.description, self.chosen.logged
        design = get_design(description.design).with_pickup(description.pickup)
        if logged is not None:
            calibration, films = logged.calibration, logged.films
        else:
            calibration = THESIS_LOAD_CELL if calibrating == "load cell" else load_cell_of(self.bench, self.today)
            films = None if calibrating else films_of(self.bench, design, self.today)
        return Lab(self.bench, films.apply(design) if films else design, calibration, films, run, started)


@contextmanager
def one_run(bench: OpenBench) -> Iterator[None]:
    """While this context lasts, no other run can begin on the bench. Raises UsageError: a run is being taken on it."""
    if not bench._taking.acquire(blocking=False):
        raise UsageError("no other run can begin on this bench before the one that it takes now has ended")
    try:
        yield
    finally:
        bench._taking.release()


@contextmanager
def open_bench(
    *,
    scene: str | Path | None = None,
    bench: str | Path | None = None,
    seed: int | None = None,
    model: str | None = None,
    log: str | Path | None = None,
    operator: Operator | None = None,
    assume_mounted: bool = False,
) -> Iterator[OpenBench]:
    """Open the bench of a bench file, or the simulated bench of a scene. Its outputs are off when the context ends.

    Args:
        scene: name or file of the scene to simulate; None, without a `bench`: thesis_single.
        bench: bench file of a real bench.
        seed: seed of the simulated scene; None: the scene's own.
        model: sensor model of the simulated scene; None: the scene's own.
        log: file for the traffic: .pcapng holds all of it; .blf and .asc hold CAN, with the rest in a .pcapng file
            beside them.
        operator: does the work by hand that no device of a real bench does; None: the person at the console is asked.
        assume_mounted: True: nobody is asked to confirm work by hand, and records say so.

    Raises:
        UsageError: arguments exclude each other, or the log exists already.
        ConfigError, UnknownName: a bench file or scene file is wrong.
        BenchError: a device cannot be opened or identified.
    """
    named = None if scene is None else str(scene)
    chosen = choose(None if bench is None else Path(bench), named, seed, model, None, assume_mounted, operator)
    if log is not None:
        check_log(Path(log))
    with opened(chosen, None if log is None else Path(log)) as opened_bench:
        yield opened_bench


@contextmanager
def opened(
    chosen: Chosen, log: Path | None = None, resumed: Resumed | None = None, started: datetime | None = None
) -> Iterator[OpenBench]:
    """Open a chosen bench.

    Args:
        chosen: which bench.
        log: file for its traffic; None: no log.
        resumed: the run to go on with, whose bench time continues; None: a new run.
        started: when the first run began; None: now, or when the resumed or logged run began.

    Raises:
        ConfigError: an installed package has a device, design or effect with the name of one that is used.
        BenchError: a device cannot be opened or identified. RecordError: the log cannot be written.
    """
    chosen.check_names()
    now, wall_start = datetime.now(UTC), time.monotonic()
    before = resumed or chosen.logged
    started = started or (now if before is None else before.run.started)
    runs: list[Path] = []
    with ExitStack() as stack:
        clock: BenchClock = WallClock(0 if resumed is None else resumed.bench_ns)
        operator = chosen.operator or ConsoleOperator(assume if chosen.assume_mounted else None)
        description = chosen.description
        if chosen.logged is not None:
            wire = stack.enter_context(chosen.logged.wire)
            description, clock, operator = wire.description, wire, ConsoleOperator(lambda _what, _word: None)
        elif chosen.scene is not None:
            simulated = stack.enter_context(SimulatedBench(chosen.scene))
            description, clock, operator = simulated.description, simulated.clock, simulated.operator
            now = started  # a simulated bench stays on the date of its run
        assert description is not None
        bench = Bench(description, clock, operator)
        bench.waits = lambda why: say(f"palpate: note: {why}", err=True)
        traffic = None
        if log is not None:
            traffic = stack.enter_context(_logging(BusLog(bench, clock, log, started), runs))
        if chosen.logged is not None:
            chosen.logged.wire.attach(bench)
        stack.enter_context(bench)
        yield OpenBench(bench, chosen, now.date(), started, wall_start, traffic, runs)


@contextmanager
def _logging(log: BusLog, runs: list[Path]) -> Iterator[BusLog]:
    """A bus log. If only closing it fails, the error names the folders of the runs, which are complete."""
    ended = False
    try:
        with log:
            yield log
            ended = True
    except RecordError as error:
        if ended:
            for folder in runs:
                error.add_note(f"the run is kept in {folder}; look at it with palpate runs show")
        raise
