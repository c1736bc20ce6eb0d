"""Commands in processes of their own that get a signal at a chosen moment; for tests and benchmarks."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from typing import Self

# Reads command lines, each a JSON list, and forks a process for each, with everything imported and used once. That says
# "tick" at each wait, "point" with the number of points when it reports them, and "off" with its outputs at the end.
# Asked by SIGUSR1, it says "left" with the amplifier's output now, and after the watchdog's time in a bench that nobody
# speaks to: at the next wait, when no request is under way, a copy of the process lets that time pass.
SERVER = """
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
with tempfile.TemporaryDirectory() as folder, contextlib.suppress(SystemExit):
    sys.argv = ["palpate", "sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--out", folder + "/first"]
    main()

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

@contextlib.contextmanager
def progress(self):
    yield lambda done, total, what: say("point", done)
Output.progress = progress

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


class Commands:
    """A context manager: the process that forks commands, one at a time."""

    def __init__(self) -> None:
        pipe, null = subprocess.PIPE, subprocess.DEVNULL
        self._process = subprocess.Popen(
            [sys.executable, "-c", SERVER], stdin=pipe, stdout=pipe, stderr=null, text=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

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
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(arguments), file=self._process.stdin, flush=True)
        child, said, reported, ticks, sent, outputs = 0, 0, 0, 0, False, None
        driven = left = None
        for line in self._process.stdout:
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
