"""Sweeps of another process on a served bench that are killed, stopped, meddled with and gone on with.

Beside them stands who knows what truly lay under the probe at each of their points.

The wire is that of `palpate serve`: TCP, a pseudo-terminal, CAN on multicast. Of the client only the clock is not a
wall's: its waits are told to the bench, whose clock goes on by them, so that no time is waited for.
"""

from __future__ import annotations

import json
import os
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
from typing import Self

from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.damage import check
from palpate.procedures.records.run import Run
from palpate.procedures.virtual.served_bench import Served, Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Mounted
from palpate.simulators.wire.device import Refused

SAMPLES = "123456"
POINTS = 2  # of a run, each of another sample
TICKS = 160  # waits of a whole run, about
MOST_BLOWS = 8  # of a round
LONGEST = 0.02  # s of the wall, from a wait to the signal
BEFORE = 1_500_000_000  # ns before the end of a point, in which the films were recorded
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

# Reads commands, a line each: where stderr goes, the socket of the bench's clock, and the words. Forks a process for
# each, with everything imported and used once; says its process id, each point that it reports, and how it ended.
FORKS = """
import contextlib, json, os, signal, socket, sys, tempfile, threading
import canopen, matplotlib.figure, pymodbus, scipy.interpolate
from palpate.procedures.measurements import loads
from palpate.procedures.records import resumed as resume
from palpate.procedures.engine import conduct
from palpate.procedures.commands import main
from palpate.procedures.lab import open as session
from palpate.procedures.commands.options import Output

matplotlib.figure.Figure.savefig = lambda self, path, **options: open(path, "w").close()
with tempfile.TemporaryDirectory() as folder, contextlib.suppress(SystemExit):
    sys.argv = ["palpate", "sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--out", folder + "/first"]
    main()

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

@contextlib.contextmanager
def progress(self):
    yield lambda done, total, what: say("point", done)
Output.progress = progress

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


def forking(program: str, errors: int | None = subprocess.DEVNULL) -> subprocess.Popen[str]:
    """A process that reads commands, and forks one of its own for each."""
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, stderr=errors, text=True)


class Client:
    """A context manager: the process that forks commands, and the clock of the bench that they wait by."""

    def __init__(self, served: Served, folder: Path) -> None:
        self._served, self._folder = served, folder
        self._blow = Blow(0)
        self._victim = 0
        self._ticks = 0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._path = str(self._folder / "clock")
            stack.enter_context(attended(self._path, self._answer))
            self._forks = stack.enter_context(forking(FORKS))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _answer(self, word: str) -> int:
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
        assert self._forks.stdin is not None
        assert self._forks.stdout is not None
        self._blow, self._ticks = blow, 0
        errors, points = self._folder / "stderr", 0
        print(json.dumps([str(errors), self._path, *words]), file=self._forks.stdin, flush=True)
        for line in self._forks.stdout:
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


FAULTS: Sequence[str] = (
    "wrong sample", "lost", "silent", "damaged", "incomplete", "never ended", "failed otherwise", "left on",
)  # fmt: skip
"""What must never happen."""
