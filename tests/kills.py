"""Commands in processes of their own that are killed, stopped, meddled with, or whose writes fail, at any moment."""

from __future__ import annotations

import json
import os
import pickle
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Self

from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.files import read_calibration
from palpate.instrument.errors import ConfigError
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.lab.calibrations import KEPT
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.damage import check
from palpate.procedures.records.record import MEASURED
from palpate.procedures.records.run import Run
from palpate.procedures.virtual.served_bench import Served, Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Mounted
from palpate.simulators.wire.device import Refused

# What both programs below begin with: a first sweep uses everything once; then they say how many points a run has.
SAYING = """
with tempfile.TemporaryDirectory() as folder, contextlib.suppress(SystemExit):
    sys.argv = ["palpate", "sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--out", folder + "/first"]
    main()

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

@contextlib.contextmanager
def progress(self):
    yield lambda done, total, what: say("point", done)
Output.progress = progress
"""

# Reads command lines, each a JSON list, and forks a process for each, with everything imported and used once. That says
# "tick" at each wait, "point" with the number of points when it reports them, and "off" with its outputs at the end.
# Asked by SIGUSR1, it says "left" with the amplifier's output now, and after the watchdog's time in a bench that nobody
# speaks to: at the next wait, when no request is under way, a copy of the process lets that time pass.
COMMAND = (
    """
import contextlib, json, os, signal, sys, tempfile
import canopen, matplotlib.figure, pymodbus, scipy.interpolate
from palpate.instrument.quantity import parse
from palpate.procedures.measurements import loads
from palpate.procedures.records import resumed as resume
from palpate.procedures.engine import conduct
from palpate.procedures.commands import main
from palpate.procedures.lab import open as session
from palpate.procedures.commands.options import Output
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.can_segment import CanSegment
from palpate.simulators.clock import VirtualClock

matplotlib.figure.Figure.savefig = lambda self, path, **options: open(path, "w").close()
parse("1 N", "N")
"""
    + SAYING
    + """
def volts():
    output = Told.bench.amplifier.voltage()
    return abs(output.mean) + sum(abs(output.amplitude))

asked = []
signal.signal(signal.SIGUSR1, lambda number, frame: asked.append(number))
wait = VirtualClock.wait
def ticking(self, duration):
    say("tick")
    if asked and Told.bench is not None:
        asked.clear()
        copy = os.fork()
        if not copy:
            driven = left = "nan"
            try:
                driven = volts()
                # without the CAN bus: it has locks that threads may have held
                self._simulated = [one for one in self._simulated if not isinstance(one, CanSegment)]
                wait(self, Told.bench.description.watchdog)
                left = volts()
            finally:
                say("left", driven, left)
                os._exit(0)
        os.waitpid(copy, 0)
        say("looked")  # the copy is gone, and with it what it held of the run's folder
    wait(self, duration)
VirtualClock.wait = ticking

class Told(SimulatedBench):
    bench = None
    def __enter__(self):
        Told.bench = super().__enter__()
        return self
    def __exit__(self, *error):
        generator = self.generator.settings
        say("off", json.dumps([self.amplifier.settings["enable"], generator["output"], generator["amplitude"]]))
        super().__exit__(*error)
session.simulated_bench = lambda scene: Told(scene, stepped=True)

for line in sys.stdin:
    child = os.fork()
    if not child:
        sys.argv = ["palpate", *json.loads(line)]
        main()
    say("pid", child)
    say("end", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
)


@contextmanager
def attended(path: str, answer: Callable[[str], int]) -> Iterator[None]:
    """A socket at which a client after the other asks for the bench's clock, a line a question."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()

        def attend() -> None:
            while True:
                try:
                    end, _ = listener.accept()
                except OSError:  # it is over
                    return
                with end, suppress(ConnectionError), end.makefile("r") as said:  # it may be killed at any moment
                    for line in said:
                        end.sendall(f"{answer(line.strip())}\n".encode())

        thread = threading.Thread(target=attend, name="clock of the bench", daemon=True)
        thread.start()
        try:
            yield
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join()


class Forking:
    """A context manager: a process that reads commands and forks one of its own for each; they may ask for a clock."""

    program: str
    errors: int | None = subprocess.DEVNULL
    path = ""

    def __enter__(self) -> Self:
        pipe = subprocess.PIPE
        with ExitStack() as stack:
            if self.path:
                stack.enter_context(attended(self.path, self.answer))
            self._process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", self.program], stdin=pipe, stdout=pipe, stderr=self.errors, text=True
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def answer(self, question: str) -> int:
        """The time of the clock [ns], after what is asked of it."""
        raise NotImplementedError

    def told(self, command: Sequence[str | int]) -> IO[str]:
        """Gives a command; the lines that the process says of it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(command), file=self._process.stdin, flush=True)
        return self._process.stdout


@dataclass(frozen=True, slots=True)
class End:
    """How a command ended.

    Attributes:
        status: exit status; of a signal its negative number.
        reported: how many points it had reported.
        ticks: how often it waited.
        outputs: enabled, relay and amplitude at the end, if it came to one.
        driven, left: amplifier's output when it was looked at, and after the watchdog's time, V.
    """

    status: int
    reported: int
    ticks: int
    outputs: tuple[bool, bool, float] | None
    driven: float | None
    left: float | None


class Commands(Forking):
    """The process that forks commands, one at a time."""

    program = COMMAND

    def run(self, *arguments: str) -> End:
        """The command, to its end."""
        return self.signalled(0, "never", 1, *arguments)

    def signalled(self, number: int, word: str, count: int, *arguments: str) -> End:
        """The command, which gets the signal `number` when it has said `word` for the `count`-th time."""
        return self._follow(arguments, word, count, number, None)

    def killed(self, ticks: int, delay: float, *arguments: str) -> End:
        """The command, killed at any moment: `delay` s of the wall after `ticks` waits and a look at the watchdog."""
        return self._follow(arguments, "tick", ticks, signal.SIGUSR1, delay)

    def _follow(self, arguments: tuple[str, ...], word: str, count: int, number: int, delay: float | None) -> End:
        child, said, reported, ticks, sent, outputs = 0, 0, 0, 0, False, None
        driven = left = None
        for line in self.told(arguments):
            kind, *rest = line.split(maxsplit=1)
            said += kind == word
            ticks += kind == "tick"
            match kind:
                case "pid":
                    child = int(rest[0])
                case "point":
                    reported = int(rest[0])
                case "off":
                    outputs = tuple(json.loads(rest[0]))
                case "left":
                    driven, left = map(float, rest[0].split())
                case "looked":
                    threading.Event().wait(delay)
                    os.kill(child, signal.SIGKILL)
                case "end":
                    return End(int(rest[0]), reported, ticks, outputs, driven, left)
            if child and said >= count and not sent:
                sent = True
                os.kill(child, number)
        raise AssertionError("the process that starts commands has ended")


# --- on a served bench -------------------------------------------------------------------------------

# Beside the sweeps stands who knows what truly lay under the probe at each of their points. The wire is that of
# `palpate serve`; of the client only the clock is not a wall's: its waits are told to the bench, whose clock goes on by
# them, so that no time is waited for.


SAMPLES = "123456"
POINTS = 2  # of a run, each of another sample
TICKS = 160  # waits of a whole run, about
MOST_BLOWS = 8  # of a round
LONGEST = 0.02  # s of the wall, from a wait to the signal
BEFORE = 1_500_000_000  # ns before the end of a point, in which the films were recorded
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

# Reads commands, a line each: where stderr goes, the socket of the bench's clock, and the words. Forks a process for
# each, with everything imported and used once; says its process id, each point that it reports, and how it ended.
CLIENT = (
    """
import contextlib, json, os, signal, socket, sys, tempfile, threading
import canopen, matplotlib.figure, pymodbus, scipy.interpolate
from palpate.procedures.measurements import loads
from palpate.procedures.records import resumed as resume
from palpate.procedures.engine import conduct
from palpate.procedures.commands import main
from palpate.procedures.lab import open as session
from palpate.procedures.commands.options import Output

matplotlib.figure.Figure.savefig = lambda self, path, **options: open(path, "w").close()
"""
    + SAYING
    + """
class BenchClock:
    goes_on = False
    stepper = None
    def __init__(self, begun=0):
        self._lock = threading.Lock()
        self._end = socket.socket(socket.AF_UNIX)
        self._end.connect(path)
        self._file = self._end.makefile("rw")
    def _ask(self, word):
        with self._lock:
            print(word, file=self._file, flush=True)
            return int(self._file.readline())
    def now_ns(self):
        return self._ask("now")
    def wait(self, duration):
        self._ask(repr(max(0.0, duration)))
session.WallClock = BenchClock

for line in sys.stdin:
    errors, path, *words = json.loads(line)
    child = os.fork()
    if not child:
        os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has jobs in the background ignore it
        sys.argv = ["palpate", *words]
        try:
            main()
        except SystemExit as end:
            sys.stderr.flush()
            os._exit(end.code or 0)  # at once: to take a forked interpreter down takes longer than the command
    say("pid", child)
    say("end", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
)


@dataclass(slots=True)
class Blow:
    """What befalls a command at one of its waits: a signal, or somebody's hand or order at the samples."""

    tick: int
    delay: float = 0.0
    number: signal.Signals | None = None
    by_hand: str = ""
    ordered: str = ""
    struck: bool = False


@dataclass
class Truth:
    """What lay under the probe, and since when."""

    times: list[int] = field(default_factory=lambda: [0])
    names: list[str] = field(default_factory=lambda: [""])

    def watch(self, sim: SimulatedBench) -> None:
        lay = sim.rig.lay

        def told(mounted: Mounted) -> None:
            lay(mounted)
            self.times.append(sim.clock.now_ns())
            self.names.append(mounted.sample.name if mounted.sample else "")

        sim.rig.lay = told  # type: ignore[method-assign]

    def during(self, start_ns: int, end_ns: int) -> set[str]:
        """All that lay there from one time to another; what changed at its end came after it."""
        first, last = bisect_right(self.times, start_ns) - 1, bisect_left(self.times, end_ns)
        return set(self.names[first:last])


class Client(Forking):
    """The process that forks commands, which wait by the clock of the bench."""

    program = CLIENT

    def __init__(self, served: Served, folder: Path) -> None:
        self._served, self._folder, self.path = served, folder, str(folder / "clock")
        self._blow = Blow(0)
        self._victim = 0
        self._ticks = 0

    def answer(self, word: str) -> int:
        clock = self._served.sim.clock
        if word != "now":
            self._ticks += 1
            if self._ticks == self._blow.tick:
                self._strike(self._blow)
            clock.wait(float(word))
        return clock.now_ns()

    def _strike(self, blow: Blow) -> None:
        sim = self._served.sim
        blow.struck = True
        if blow.number is not None:
            threading.Event().wait(blow.delay)
            os.kill(self._victim, blow.number)
        with sim.clock.lock:
            if blow.by_hand:
                sim.rig.mount(get_sample(blow.by_hand))
            if blow.ordered and sim.changer is not None:
                try:
                    sim.changer.write_text("order", blow.ordered)
                except Refused:  # as the other client is told
                    blow.struck = False

    def run(self, blow: Blow, *words: str) -> tuple[int, int, str]:
        """A command that meets a blow: its exit status (of a signal, negative), points it reported, and its stderr."""
        self._blow, self._ticks = blow, 0
        errors, points = self._folder / "stderr", 0
        for line in self.told([str(errors), self.path, *words]):
            kind, said = line.split()
            if kind == "pid":
                self._victim = int(said)
            elif kind == "point":
                points = max(points, int(said))
            else:
                return int(said), points, errors.read_text(encoding="utf-8")
        raise AssertionError("the process that starts commands has ended")


class Rounds:
    """Rounds on one served bench: a run is begun, struck, gone on with or begun anew, until it is whole."""

    def __init__(self, served: Served, client: Client, folder: Path, bench: Path) -> None:
        self._served, self._client, self._folder, self._bench = served, client, folder, bench
        self._truth = Truth()
        self._truth.watch(served.sim)

    def play(self, seed: int) -> Counter[str]:
        """One round, its blows drawn by `seed`; what happened in it, by name."""
        chance, found = random.Random(seed), Counter[str]()
        names = chance.sample(SAMPLES, POINTS)
        run = self._folder / "run"
        sweep = ("sweep", "loads", "--quiet", "--samples", ",".join(names), "--loads", "2 N", "--dwell", "0.2 s")
        words = (*sweep, "--bench", str(self._bench), "--out", str(run))
        blows = chance.randrange(2, MOST_BLOWS)
        while True:
            blow = _drawn(chance) if blows else Blow(0)
            blows -= bool(blows)
            status, reported, errors = self._client.run(blow, *words)
            self._count(found, blow, status, errors)
            complete = self._look(found, run, reported)
            found["silent"] += status == 0 and not complete
            if status == 0 or complete:  # a signal may have come after its end
                break
            if not is_run(run) or chance.random() < 0.3:
                shutil.rmtree(run, ignore_errors=True)
                words = (*sweep, "--bench", str(self._bench), "--out", str(run))
                found["begun anew"] += 1
            else:
                words = ("runs", "resume", str(run), "--quiet")
                found["resumed"] += 1
            if found["begun anew"] + found["resumed"] > MOST_BLOWS:
                found["never ended"] += 1
                break
        done = [point["sample"] for point in Run.open(run).points()] if is_run(run) else []
        found["incomplete"] += done != names
        shutil.rmtree(run, ignore_errors=True)
        return found

    def _count(self, found: Counter[str], blow: Blow, status: int, errors: str) -> None:
        if blow.number is not None:
            found["killed" if blow.number == signal.SIGKILL else "interrupted"] += blow.struck and status != 0
            self._served.sim.clock.wait(self._served.description.watchdog)
            output = self._served.sim.rig.coil_voltage()
            found["left on"] += bool(output.mean or output.amplitude.any())
        elif blow.struck:
            found["meddled with"] += 1
            told = "was ordered" in errors or "sample changer" in errors
            found["noticed"] += status != 0 and told
            found["failed otherwise"] += status != 0 and not told
        else:
            found["failed otherwise"] += status != 0

    def _look(self, found: Counter[str], run: Path, reported: int) -> bool:
        """Count what is wrong with the run on disk; returns whether it is complete."""
        if not is_run(run):
            found["lost"] += reported
            return False
        if faults := check(run).faults:
            found["damaged"] += len(faults)
            return False
        opened = Run.open(run)
        points = opened.points()
        found["lost"] += max(0, reported - len(points))
        for point in points:
            end = int(point["bench_ns"])
            seen = self._truth.during(end - BEFORE, end)
            found["wrong sample"] += seen != {point["sample"]}
        found["points looked at"] += len(points)
        return opened.status == "complete"


def _drawn(chance: random.Random) -> Blow:
    tick, delay = 1 + int(TICKS * chance.random() ** 2), LONGEST * chance.random()  # one that goes on has fewer
    kind = chance.random()
    if kind < 0.07:
        return Blow(1 + chance.randrange(TICKS), by_hand=chance.choice(SAMPLES))
    if kind < 0.14:
        return Blow(1 + chance.randrange(TICKS), ordered=chance.choice(SAMPLES))
    return Blow(tick, delay, chance.choice(SIGNALS))


@contextmanager
def rounds(folder: Path, scene: str = "thesis_single") -> Iterator[Rounds]:
    """A served bench with a sample changer, and a client; all of it ends with the block."""
    bench = folder / "bench.toml"
    samples = tuple(get_sample(name) for name in SAMPLES)
    wish = Wish(read_scene(scene), BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, samples, bench)
    with serving(wish) as served, Client(served, folder) as client:
        yield Rounds(served, client, folder, bench)


SERVED_FAULTS: Sequence[str] = (
    "wrong sample", "lost", "silent", "damaged", "incomplete", "never ended", "failed otherwise", "left on",
)  # fmt: skip
"""What must never happen."""


# --- calibrations ------------------------------------------------------------------------------------

# Is a calibration lost, or left unused without a word? A moment is a wait on the bench's clock, or what is asked of the
# disk in the folder of runs and store. On a served bench, the client's clock and hands are those of the bench.


QUICK = ("--loads", "2 N, 3 N, 4 N", "--dwell", "0.2 s")
COMMANDS = {
    "load cell": ("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N"),
    "films": ("calibrate", "films", *QUICK),
    "model": ("calibrate", "model", "--reference", "A: 30 kPa ± 2 %", *QUICK),
    "mountings": (
        *("measure", "modulus", "--sample", "4", "--relative-to-model", "--tolerance", "8 %"),
        *("--mountings", "3", "--load", "3 N"),
    ),
}
"""What calibrates, by the kind of its calibration."""

ERRORS = ("ENOSPC", "EROFS", "EACCES", "EIO")
CALIBRATION_FAULTS = ("lost", "silently unused", "other than uninterrupted", "failed without a word")
ANEW = "points must be taken in one run"

CALIBRATING = """
import builtins, contextlib, errno, io, json, os, pickle, signal, socket, sys, tempfile, threading
import canopen, matplotlib.figure, pymodbus, scipy.interpolate
from palpate.procedures.commands import main
from palpate.procedures.lab import open as session, operator
from palpate.procedures.engine import resume
from palpate.procedures.measurements.load_cell import certificate, report
from palpate.procedures.measurements import films, loads, references
from palpate.procedures.measurements.object_modulus import procedure as modulus
from palpate.simulators.clock import VirtualClock

matplotlib.figure.Figure.savefig = lambda self, path, **options: None
with tempfile.TemporaryDirectory() as folder, contextlib.suppress(SystemExit):
    os.environ["PALPATE_STORE"] = folder
    sys.argv = ["palpate", "sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s"]
    main()

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

moments = 0
def strike(root, number, how):
    def moment(path=None):
        global moments
        if path is not None and not os.fspath(path).startswith(root):
            return
        if path is None and how != "SIGKILL":
            return
        moments += 1
        if moments == number and how == "SIGKILL":
            os.kill(os.getpid(), signal.SIGKILL)
        if (moments == number or number < 0) and how.startswith("E"):
            raise OSError(getattr(errno, how), os.strerror(getattr(errno, how)), os.fspath(path))
    def listen(where, name, path_of):
        call = getattr(where, name)
        def called(*args, **options):
            path = path_of(*args)
            if path is not None:
                moment(path)
            return call(*args, **options)
        setattr(where, name, called)
    def opened(file, mode="r", *rest):
        return file if isinstance(file, (str, os.PathLike)) and set(mode) & set("wax+") else None
    def place(file, *rest):
        return os.path.abspath(file) if isinstance(file, (str, os.PathLike)) else None
    def handle(number, *rest):
        return os.readlink(f"/proc/self/fd/{number}")
    for name in ("fsync", "fdatasync", "pwrite", "ftruncate"):
        listen(os, name, handle)
    for name in ("replace", "mkdir", "unlink"):
        listen(os, name, place)
    listen(io, "open", opened)
    wait = session.WallClock.wait
    for clock in (VirtualClock, session.WallClock):
        def waiting(self, duration, wait=clock.wait):
            moment()
            wait(self, duration)
        clock.wait = waiting

class BenchClock:
    goes_on = False
    stepper = None
    def __init__(self, begun=0):
        self._lock = threading.Lock()
        self._end = socket.socket(socket.AF_UNIX)
        self._end.connect(path)
        self._file = self._end.makefile("rw")
        BenchClock.now = self
    def ask(self, *words):
        with self._lock:
            print(pickle.dumps(words).hex(), file=self._file, flush=True)
            return int(self._file.readline())
    def now_ns(self):
        return self.ask("now")
    def wait(self, duration):
        self.ask("wait", max(0.0, duration))

class Person(operator.ConsoleOperator):
    def __init__(self, ask=None):
        pass
    def __getattribute__(self, name):
        return lambda *given: BenchClock.now.ask(name, *given)

for line in sys.stdin:
    store, root, path, number, how, errors, *words = json.loads(line)
    child = os.fork()
    if not child:
        os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.environ["PALPATE_STORE"] = store
        if path:
            session.WallClock, session.ConsoleOperator, operator.at_terminal = BenchClock, Person, lambda: True
        strike(root, number, how)
        sys.argv = ["palpate", *words]
        status = 0
        try:
            main()
        except SystemExit as end:
            status = end.code or 0
        finally:
            sys.stderr.flush()
            say("moments", moments)
            os._exit(status)
    _, status = os.waitpid(child, 0)
    say("end", os.waitstatus_to_exitcode(status))
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended: exit status (of a signal, negative), what it said on stderr, its moments; 0: not told."""

    status: int
    errors: str
    moments: int


class Calibrating(Forking):
    """The process that forks commands, one at a time; on a served bench with its clock and hands."""

    program, errors = CALIBRATING, None

    def __init__(self, folder: Path, served: Served | None = None) -> None:
        self.folder, self._served = folder, served
        self.store = folder / "store"
        if served is not None:
            self.path = str(folder / "clock")

    @property
    def sim(self) -> Any:
        """The served bench."""
        assert self._served is not None
        return self._served.sim

    def answer(self, line: str) -> int:
        word, *given = pickle.loads(bytes.fromhex(line))  # noqa: S301 (our own child wrote it)
        if word == "wait":
            self.sim.clock.wait(*given)
        elif word != "now":
            getattr(self.sim.operator, "mount" if word == "mount_anew" else word)(*given)
        return int(self.sim.clock.now_ns())

    def run(self, number: int, how: str, *words: str, root: Path | None = None) -> Ended:
        """A command that meets a blow at one of its moments; at number 0 none, at -1 at each of them.

        Args:
            number: number of the moment, from 1.
            how: "SIGKILL", or the name of an error number, which the disk gives.
            words: the command.
            root: folder in which the disk is listened to; None: that of the runs and the store.
        """
        errors, moments = self.folder / "stderr", 0
        about = (str(self.store), str(root or self.folder), self.path, number, how, str(errors))
        for line in self.told([*about, *words]):
            kind, _, said = line.strip().partition(" ")
            if kind == "moments":
                moments = int(said)
            elif kind == "end":
                return Ended(int(said), errors.read_text(encoding="utf-8"), moments)
        raise AssertionError("the process that starts commands has ended")


def _plain(calibration: Calibration) -> dict[str, Any]:
    """A calibration without what tells one run from another."""
    return calibration.model_dump(exclude={"source", "created", "expires", "load_cell"})


class Calibrations:
    """Rounds of one calibration each, which is struck and then done to its end."""

    def __init__(self, commands: Calibrating, kind: str, bench: tuple[str, ...] = ()) -> None:
        self._commands, self._bench = commands, bench
        self._command = (*COMMANDS[kind], *bench, "--quiet", "--out")
        self._whole: tuple[str, dict[str, Any]] | None = None
        self.moments: dict[str, int] = {}
        for how in ("SIGKILL", "ENOSPC"):
            end, folder = self._begin(0, how)
            assert end.status == 0, end.errors
            self.moments[how] = end.moments
            self._whole = self._result(folder)
            shutil.rmtree(folder)

    def _begin(self, number: int, how: str, root: Path | None = None) -> tuple[Ended, Path]:
        shutil.rmtree(self._commands.store, ignore_errors=True)
        folder = self._commands.folder / "run"
        shutil.rmtree(folder, ignore_errors=True)
        if self._bench:  # what a killed run has left there
            self._commands.sim.operator.place_weight(0.0)
        return self._commands.run(number, how, *self._command, str(folder), root=root), folder

    def _result(self, folder: Path) -> tuple[str, dict[str, Any]]:
        return Run.open(folder).digest(), _plain(read_calibration(folder / KEPT))

    def _stored(self, folder: Path) -> bool:
        """Whether the store has the calibration of the run."""
        for file in (self._commands.store / "calibrations").glob("*.toml"):
            with suppress(ConfigError):
                if read_calibration(file).source == folder.name:
                    return True
        return False

    def play(self, number: int, how: str, chance: random.Random, root: Path | None = None) -> Counter[str]:
        """A calibration that meets a blow at one of its moments, and what came of it, by name."""
        found = Counter[str]()
        end, folder = self._begin(number, how, root)
        found["killed" if how == "SIGKILL" else "failed writes"] += end.status != 0
        found["failed without a word"] += end.status > 0 and "palpate: error: " not in end.errors
        found["silently unused"] += end.status == 0 and not self._stored(folder)
        if end.status == 0:
            return found
        if not is_run(folder):
            found["had not begun"] += 1
            return found
        if how == "SIGKILL" and chance.random() < 0.3:  # what goes on is killed as well
            again = self._commands.run(
                chance.randrange(1, self.moments[how]), how, "runs", "resume", str(folder), "--quiet"
            )
            found["killed again"] += again.status < 0
        self._finish(found, folder)
        return found

    def _finish(self, found: Counter[str], folder: Path) -> None:
        run = Run.open(folder)
        install = run.status == "complete" and (folder / KEPT).exists()
        done = self._commands.run(0, "SIGKILL", "runs", "install" if install else "resume", str(folder), "--quiet")
        found["installed" if install else "resumed"] += 1
        if self._bench and ANEW in done.errors:
            has_all = any(event["kind"] == MEASURED for event in run.events()) or run.status == "complete"
            found["lost" if has_all else "told to run anew, as points were missing"] += 1
            return
        stored = self._stored(folder)
        found["silently unused"] += done.status == 0 and not stored
        found["lost"] += not (stored and Run.open(folder).status == "complete")
        if stored and not self._bench:  # a served bench goes on meanwhile
            found["other than uninterrupted"] += self._result(folder) != self._whole


@contextmanager
def in_process(folder: Path, kind: str) -> Iterator[Calibrations]:
    """Rounds on simulated benches, each in the process of its command."""
    with Calibrating(folder) as commands:
        yield Calibrations(commands, kind)


@contextmanager
def served(folder: Path, kind: str) -> Iterator[Calibrations]:
    """Rounds of a client of one served bench."""
    file = folder / "bench.toml"
    wish = Wish(read_scene("thesis_single"), BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, (), file)
    with serving(wish) as bench, Calibrating(folder, bench) as commands:
        yield Calibrations(commands, kind, ("--bench", str(file)))
