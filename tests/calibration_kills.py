"""Calibrations that are killed, or whose writes fail, at any moment: is one lost, or left unused without a word?

A moment is a wait on the bench's clock, or what is asked of the disk in the folder of runs and store. Commands run in
processes that are forked for them, with everything imported. On a served bench, the client's clock and hands are those
of the bench, so that no time is waited for.
"""

from __future__ import annotations

import json
import pickle
import random
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.files import read_calibration
from palpate.instrument.errors import ConfigError
from palpate.procedures.lab.calibrations import KEPT
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.record import MEASURED
from palpate.procedures.records.run import Run
from palpate.procedures.virtual.served_bench import Served, Wish, serving
from palpate.simulators.bench import BenchAddresses
from palpate.simulators.planning.settle import read_scene
from tests.served_kills import attended, forking

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
FAULTS = ("lost", "silently unused", "other than uninterrupted", "failed without a word")
ANEW = "points must be taken in one run"

FORKS = """
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
class End:
    """How a command ended: exit status (of a signal, negative), what it said on stderr, its moments; 0: not told."""

    status: int
    errors: str
    moments: int


class Commands:
    """A context manager: the process that forks commands, one at a time; on a served bench with its clock and hands."""

    def __init__(self, folder: Path, served: Served | None = None) -> None:
        self.folder, self._served = folder, served
        self.store = folder / "store"
        self._path = ""

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if self._served is not None:
                self._path = str(self.folder / "clock")
                stack.enter_context(attended(self._path, self._answer))
            self._forks = stack.enter_context(forking(FORKS, errors=None))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def sim(self) -> Any:
        """The served bench."""
        assert self._served is not None
        return self._served.sim

    def _answer(self, line: str) -> int:
        word, *given = pickle.loads(bytes.fromhex(line))  # noqa: S301 (our own child wrote it)
        if word == "wait":
            self.sim.clock.wait(*given)
        elif word != "now":
            getattr(self.sim.operator, "mount" if word == "mount_anew" else word)(*given)
        return int(self.sim.clock.now_ns())

    def run(self, number: int, how: str, *words: str, root: Path | None = None) -> End:
        """A command that meets a blow at one of its moments; at number 0 none, at -1 at each of them.

        Args:
            number: number of the moment, from 1.
            how: "SIGKILL", or the name of an error number, which the disk gives.
            words: the command.
            root: folder in which the disk is listened to; None: that of the runs and the store.
        """
        assert self._forks.stdin is not None
        assert self._forks.stdout is not None
        errors, moments = self.folder / "stderr", 0
        about = (str(self.store), str(root or self.folder), self._path, number, how, str(errors))
        print(json.dumps([*about, *words]), file=self._forks.stdin, flush=True)
        for line in self._forks.stdout:
            kind, _, said = line.strip().partition(" ")
            if kind == "moments":
                moments = int(said)
            elif kind == "end":
                return End(int(said), errors.read_text(encoding="utf-8"), moments)
        raise AssertionError("the process that starts commands has ended")


def _plain(calibration: Calibration) -> dict[str, Any]:
    """A calibration without what tells one run from another."""
    return calibration.model_dump(exclude={"source", "created", "expires", "load_cell"})


class Rounds:
    """Rounds of one calibration each, which is struck and then done to its end."""

    def __init__(self, commands: Commands, kind: str, bench: tuple[str, ...] = ()) -> None:
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

    def _begin(self, number: int, how: str, root: Path | None = None) -> tuple[End, Path]:
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
def in_process(folder: Path, kind: str) -> Iterator[Rounds]:
    """Rounds on simulated benches, each in the process of its command."""
    with Commands(folder) as commands:
        yield Rounds(commands, kind)


@contextmanager
def served(folder: Path, kind: str) -> Iterator[Rounds]:
    """Rounds of a client of one served bench."""
    file = folder / "bench.toml"
    wish = Wish(read_scene("thesis_single"), BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, (), file)
    with serving(wish) as bench, Commands(folder, bench) as commands:
        yield Rounds(commands, kind, ("--bench", str(file)))
