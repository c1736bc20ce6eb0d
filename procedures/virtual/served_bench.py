"""Serves a simulated bench to other programs until it is told to end."""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Self

from palpate.drivers.safe_end import taken
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import LINE
from palpate.instrument.errors import BenchError, PalpateError, RangeError, UsageError
from palpate.instrument.own_process import Ends
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.procedures.console.terminal import console, say
from palpate.procedures.records.run import storing
from palpate.procedures.records.run_folder import RECORD
from palpate.procedures.virtual.person import Person, TransactionRate, status
from palpate.simulators.bench import NAMED, BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.loop import Pacer

REFRESH = 0.25  # s of wall time between two updates of the status page
OUT = "a file in a writable folder with --out"
CHUNK = 4096  # bytes read from the input at once
ENDINGS = (signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True, slots=True)
class Wish:
    """What to serve, and how.

    Attributes:
        scene: the scene to simulate.
        place: addresses on which the bench is served.
        line: a symbolic link to make to the serial line's terminal; None: no link.
        speed: speed of the bench's clock relative to the wall clock.
        step: time by which Enter moves the clock on, which else stands still [s]; None: it follows the wall clock.
        samples: samples in the sample changer; without any there is no changer.
        out: file to which the bench file is written; None: standard output.
    """

    scene: Scene
    place: BenchAddresses
    line: Path | None
    speed: float
    step: float | None
    samples: tuple[Sample, ...]
    out: Path | None

    @classmethod
    def asked(
        cls,
        scene: str,
        *,
        seed: int | None,
        listen: str,
        port: int | None,
        can: str,
        line: Path | None,
        speed: float,
        step: float | None,
        samples: Sequence[str] | None,
        out: Path | None,
    ) -> Self:
        """Read the arguments of the command. Raises UsageError, RangeError, ConfigError, UnknownName: one is wrong."""
        if not 0.001 <= speed <= 1000:
            raise RangeError(f"--speed {speed:g} is outside 0.001 to 1000; give one inside")
        if step is not None and not 0 < step <= 3600:
            raise RangeError(f"--step {step:g} s is outside 0 to 1 h")
        if line is not None and (line.exists() or line.is_symlink()):
            raise UsageError(f"--line {line} exists already; give another name")
        if out is not None:
            _check_unused(out)
        interface, _, channel = can.partition(":")
        place = BenchAddresses(listen, port or 0, interface, channel or None)
        chosen = read_scene(scene)
        held = () if samples is None else tuple(get_sample(name) for name in samples)
        return cls(chosen if seed is None else chosen.with_seed(seed), place, line, speed, step, held, out)

    def summary(self, description: BenchDescription) -> dict[str, object]:
        """The served bench, for JSON."""
        return {
            "scene": self.scene.name,
            "seed": self.scene.seed,
            "speed": self.speed if self.step is None else 0.0,
            "bench_file": None if self.out is None else str(self.out),
            "bench": description.model_dump(mode="json"),
        }


def _check_unused(out: Path) -> None:
    """Look at what is there already.

    Raises:
        UsageError: the file exists, and is not the bench file of a bench that was served before.
        RecordError: it cannot be looked at.
    """
    written = f'name = "{NAMED}'.encode()
    with storing(out, OUT):
        if (out.parent / RECORD).exists():
            raise UsageError(f"{out} belongs to a run; choose another --out")
        if out.is_file() and not out.read_bytes().startswith(written):
            raise UsageError(f"{out} exists, and palpate serve did not write it; choose another --out")


@dataclass(frozen=True, slots=True)
class Served:
    """A bench that is being served.

    Attributes:
        sim: the bench.
        description: its bench file, with which clients find it.
        pacer: moves its clock on.
        failures: errors that stopped the clock.
    """

    sim: SimulatedBench
    description: BenchDescription
    pacer: Pacer
    failures: list[BaseException]


@contextmanager
def serving(wish: Wish) -> Iterator[Served]:
    """Serve a bench inside the context; its bench file and the link to its serial line are written on entering.

    Raises:
        BenchError: a port is in use, or the CAN interface cannot be opened.
        RecordError: the bench file or the link cannot be written.
    """
    failures: list[BaseException] = []
    with Ends() as stack:
        sim = stack.enter_context(SimulatedBench(wish.scene, wish.place, wish.samples))
        sim.set_speed(wish.speed)
        sim.clock.served = True
        description = _description(sim, wish)
        if wish.line is not None:
            with storing(wish.line, "a name in a writable folder with --line"):
                wish.line.symlink_to(sim.line)
            stack.callback(wish.line.unlink, missing_ok=True)
        if wish.out is not None:
            with storing(wish.out, OUT):
                wish.out.write_text(description.to_toml(), encoding="utf-8")
        pacer = Pacer(sim.clock, wish.speed, failures.append, sim.servers.catch_up)
        if wish.step is None:
            stack.enter_context(pacer)
        yield Served(sim, description, pacer, failures)


def serve_until_told(wish: Wish, announce: Callable[[BenchDescription], None], shows_status: bool) -> None:
    """Serve until Ctrl-C, SIGTERM, SIGHUP or "quit".

    Args:
        wish: what to serve.
        announce: gets the description by which clients find the bench, once.
        shows_status: whether a page on the terminal shows the bench.

    Raises:
        BenchError: the bench cannot be served (see `serving`), or the simulation failed while it was served.
        RecordError: a file cannot be written (see `serving`).
    """
    interrupts = taken([signal.SIGINT], _end, ignored=True)  # `serve &` in a script begins with it ignored
    with interrupts, taken(ENDINGS, _end), serving(wish) as served, ExitStack() as stack:
        try:
            announce(served.description)
            look = stack.enter_context(_page(served)) if shows_status else _unseen
            _attend(served, wish.step, look, [sys.stdin.fileno()] if sys.stdin is not None else [])
        except KeyboardInterrupt:
            return


def _description(sim: SimulatedBench, wish: Wish) -> BenchDescription:
    named = {} if wish.line is None else {LINE: {"port": str(wish.line.absolute())}}
    return sim.description.moved(named).patient()


def _attend(served: Served, step: float | None, look: Callable[[], None], typed: Sequence[int]) -> None:
    """Carry out typed lines until "quit"; when the input ends, the bench is still served."""
    person = Person(served.sim)
    rest = b""
    while not served.failures:
        ready, _, _ = select.select(typed, [], [], REFRESH)
        if not ready:
            look()
            continue
        chunk = os.read(ready[0], CHUNK)
        if not chunk:
            typed = []
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            text = line.decode(errors="replace").strip()
            if text == "quit":
                return
            if text:
                _carry_out(person, text)
            elif step is not None:
                served.sim.clock.wait(step)
    raise BenchError(
        f"the simulation has failed: {served.failures[0]}; serve the bench again, or change the scene"
    ) from served.failures[0]


def _carry_out(person: Person, text: str) -> None:
    try:
        say(person.do(text) or f"done: {text}", err=True)
    except PalpateError as error:  # a mistyped line is no reason to stop serving
        say(f"palpate: {error}", err=True)


def _unseen() -> None:
    pass


@contextmanager
def _page(served: Served) -> Iterator[Callable[[], None]]:
    from rich.live import Live

    traffic = TransactionRate(served.sim)
    with Live(console=console(), auto_refresh=False) as live:

        def look() -> None:
            live.update(status(served.sim, traffic.rate(time.monotonic()), served.pacer.behind), refresh=True)

        yield look


def _end(_number: int, _frame: FrameType | None) -> None:
    """End on SIGTERM and SIGHUP as on Ctrl-C."""
    raise KeyboardInterrupt
