"""Opens a bench, real or simulated: here drivers and simulators meet."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from threading import Lock
from types import FrameType
from typing import TYPE_CHECKING, Literal, NoReturn

from palpate.drivers.clock import WallClock
from palpate.drivers.roles import SensorNode
from palpate.drivers.safe_end import taken
from palpate.instrument.bench.operator import Operator
from palpate.instrument.errors import BenchError, RecordError, UsageError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.console.terminal import say
from palpate.procedures.lab.about import completed
from palpate.procedures.lab.before import History
from palpate.procedures.lab.calibrations import (
    check_nameable,
    films_of,
    known_load_cell,
    load_cell_of,
    model_of,
    mountings_of,
)
from palpate.procedures.lab.chosen import Chosen, choose
from palpate.procedures.lab.lab import Lab, Target, owner
from palpate.procedures.lab.logged import Used
from palpate.procedures.lab.operator import ConsoleOperator, assume
from palpate.procedures.lab.store import store
from palpate.procedures.records.resumed import Resumed
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.drivers.clock import BenchClock
    from palpate.drivers.logs.bus_log import BusLog
    from palpate.instrument.bench.description import BenchDescription
    from palpate.instrument.models.response import RatioQuestion
    from palpate.instrument.sensor.design import Design
    from palpate.simulators.bench import SimulatedBench
    from palpate.simulators.clock import VirtualClock

Calibrating = Literal["load cell", "films"]


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
        history: what was done on a simulated bench so far; None: it is real, or a log answers in its place.
    """

    bench: Bench
    chosen: Chosen
    today: date
    started: datetime
    wall_start: float
    log: BusLog | None
    runs: list[Path] = field(default_factory=list)
    history: History | None = None
    _taking: Lock = field(default_factory=Lock, init=False, repr=False)

    def __reduce__(self) -> NoReturn:
        raise UsageError(
            "an open bench cannot be pickled, as for another process; open one there, or pickle results and runs"
        )

    @property
    def scene(self) -> Scene | None:
        """The simulated scene; None: nothing is simulated in this process."""
        return self.chosen.scene

    @property
    def target(self) -> Target:
        """The limits against which procedures check their settings."""
        return self.chosen.target

    def lab(
        self,
        run: str,
        started: datetime,
        calibrating: Calibrating | None = None,
        question: RatioQuestion | None = None,
        used: Used | None = None,
    ) -> Lab:
        """The bench with the calibrations that are stored now; a logged run has its own calibrations.

        Args:
            run: name of the run.
            started: when the run began.
            calibrating: what the run calibrates. The load cell then needs no calibration that holds: the last one, or
                the thesis', says what to expect of it. No stored calibration of the films is used.
            question: what the run asks a sensor model, which may be calibrated by references; None: it asks none.
            used: calibrations to use instead of the stored ones; None: the stored ones.

        Raises:
            ConfigError: a calibration is missing, damaged, expired, or belongs to another device.
            RangeError: no model answers the question.
        """
        description = self.bench.description
        if self.chosen.logged is not None:
            used = self.chosen.logged.used
        if calibrating and used is None:
            check_nameable(self.bench, "load_indicator" if calibrating == "load cell" else "sensor_node")
        if used is None:
            design, references, mountings = designed(description), None, None
            weighing = calibrating == "load cell"
            calibration = known_load_cell(self.bench) if weighing else load_cell_of(self.bench, self.today)
            films = None if calibrating else films_of(self.bench, design, self.today)
            if question is not None:
                references = model_of(self.bench, question, films, self.today)
                mountings = mountings_of(owner(self.bench, SensorNode, design.name), self.today)
            used = Used(calibration, films, references, mountings)
        return lab_with(self.bench, used, run, started)


def designed(description: BenchDescription) -> Design:
    """The design of a bench's sensor, with what the bench adds to its signals."""
    return get_design(description.design).with_pickup(description.pickup).with_noise(description.noise)


def lab_with(bench: Bench, used: Used, run: str, started: datetime) -> Lab:
    """A bench with these calibrations, for the run of a name that began at a time."""
    design, films = designed(bench.description), used.films
    calibrated = films.apply(design) if films else design
    return Lab(bench, calibrated, used.calibration, films, run, started, used.references, used.mountings)


@contextmanager
def one_run(bench: OpenBench) -> Iterator[None]:
    """While this context lasts, no other run can begin on the bench.

    Raises UsageError: a run is being taken on it. BenchError: another process has opened it.
    """
    bench.bench.check_process()
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
    about: Mapping[str, str] | None = None,
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
        about: what each run says about itself, such as operator, object, batch, ticket; `about.toml` in the folder of
            the runs may ask for some, or name all that there are.

    Raises:
        UsageError: arguments exclude each other, the log exists already, or `about` is not what the lab asks.
        ConfigError, UnknownName: a bench file or scene file is wrong.
        BenchError: a device cannot be opened or identified.
    """
    named = None if scene is None else str(scene)
    completed_about = completed(about or {}, store())
    chosen = choose(
        None if bench is None else Path(bench), named, seed, model, None, assume_mounted, operator, completed_about
    )
    if log is not None:
        from palpate.drivers.logs.bus_log import check_log

        check_log(Path(log))
    with opened(chosen, None if log is None else Path(log)) as opened_bench:
        yield opened_bench


# These two import the libraries of the buses, which a plan does not need.


def simulated_bench(scene: Scene) -> SimulatedBench:
    """The simulated bench of a scene, which is not running yet; it answers in the waits of its client."""
    from palpate.simulators.bench import SimulatedBench

    return SimulatedBench(scene, stepped=True)


def driven_bench(description: BenchDescription, clock: BenchClock, operator: Operator) -> Bench:
    """The bench that a file describes, which is not open yet."""
    from palpate.drivers.bench import Bench

    return Bench(description, clock, operator)


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
    simulated: SimulatedBench | None = None
    with ExitStack() as stack:
        clock: BenchClock = WallClock(0 if resumed is None else resumed.bench_ns)
        operator = chosen.operator or ConsoleOperator(assume if chosen.assume_mounted else None)
        description = chosen.description
        if chosen.logged is not None:
            wire = stack.enter_context(chosen.logged.wire)
            description, clock, operator = wire.description, wire, ConsoleOperator(lambda _what, _word: None)
        elif chosen.scene is not None:
            simulated = stack.enter_context(simulated_bench(chosen.scene))
            simulated.clock.pace = chosen.pace
            description, clock, operator = simulated.description, simulated.clock, simulated.operator
            now = started  # a simulated bench stays on the date of its run
        assert description is not None
        bench = driven_bench(description, clock, operator)
        bench.waits = lambda why: say(f"palpate: note: {why}", err=True)
        traffic = None
        if simulated is not None:
            stack.enter_context(_interrupting(simulated.clock))
        if log is not None:
            from palpate.drivers.logs.bus_log import BusLog

            traffic = stack.enter_context(_logging(BusLog(bench, clock, log, started), runs))
        if chosen.logged is not None:
            chosen.logged.wire.attach(bench)
        stack.enter_context(bench)
        history = None if simulated is None else History(simulated)
        yield OpenBench(bench, chosen, now.date(), started, wall_start, traffic, runs, history)


@contextmanager
def _interrupting(clock: VirtualClock) -> Iterator[None]:
    """Inside, Ctrl-C also ends what the simulation computes in another thread, should that take long.

    An error of the simulation is raised in place of what the driver makes of it.
    """
    before = signal.getsignal(signal.SIGINT)

    def interrupt(number: int, frame: FrameType | None) -> None:
        clock.give_up_soon()
        if not callable(before):
            raise KeyboardInterrupt
        before(number, frame)

    with taken((signal.SIGINT,), interrupt):
        try:
            yield
        except BenchError as error:
            if clock.failure is None or error is clock.failure:
                raise
            for note in getattr(error, "__notes__", ()):
                clock.failure.add_note(note)
            raise clock.failure from (clock.failure.__cause__ or error)


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
