"""Keeps a simulated bench served until it is told to end."""

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
from palpate.instrument.bench.description import LINE, BenchDescription
from palpate.instrument.errors import BenchError, PalpateError, RangeError, UsageError
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.sample import Sample, get_sample, parse_samples
from palpate.procedures.console.terminal import console, say
from palpate.procedures.records.run import storing
from palpate.procedures.virtual.person import Person, Traffic, status
from palpate.simulators.bench import Place, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.pace import Pacer

REFRESH = 0.25  # s of the wall between two looks at the input and at the status
CHUNK = 4096  # bytes
ENDINGS = (signal.SIGTERM, signal.SIGHUP)


@dataclass(frozen=True, slots=True)
class Wish:
    """What shall be served.

    Attributes:
        line: another name of the serial line's terminal.
        speed: of the bench's clock, to that of the wall.
        step: by which Enter moves the clock on, which stands still otherwise [s]; None: it follows the wall.
        samples: that its sample changer holds; without any it has none.
        out: where the bench file goes.
    """

    scene: Scene
    place: Place
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
        step: str | None,
        samples: str | None,
        out: Path | None,
    ) -> Self:
        """What texts ask for. Raises UsageError, RangeError, ConfigError, UnknownName: it cannot be served."""
        if not 0.001 <= speed <= 1000:
            raise RangeError(f"--speed {speed:g} is outside 0.001 to 1000")
        pause = None if step is None else parse(step, "s")
        if pause is not None and not 0 < pause <= 3600:
            raise RangeError(f"--step {step} is outside 0 to 1 h")
        if line is not None and (line.exists() or line.is_symlink()):
            raise UsageError(f"--line {line} exists already; give another name")
        interface, _, channel = can.partition(":")
        place = Place(listen, port or 0, interface, channel or None)
        chosen = read_scene(scene)
        held = () if samples is None else tuple(get_sample(name) for name in parse_samples(samples))
        return cls(chosen if seed is None else chosen.with_seed(seed), place, line, speed, pause, held, out)

    def summary(self, description: BenchDescription) -> dict[str, object]:
        """What is served, under public names."""
        return {
            "scene": self.scene.name,
            "seed": self.scene.seed,
            "speed": self.speed if self.step is None else 0.0,
            "bench_file": None if self.out is None else str(self.out),
            "bench": description.model_dump(mode="json"),
        }


@dataclass(frozen=True, slots=True)
class Served:
    """A bench that is served, the description by which it is found, and what ended its time before it was told to."""

    sim: SimulatedBench
    description: BenchDescription
    pacer: Pacer
    failures: list[BaseException]


@contextmanager
def serving(wish: Wish) -> Iterator[Served]:
    """Serve inside; the bench file and the name of the line are there.

    Raises:
        BenchError: a port is in use, or the CAN interface cannot be opened.
        RecordError: the bench file or the name of the line cannot be written.
    """
    failures: list[BaseException] = []
    with ExitStack() as stack:
        sim = stack.enter_context(SimulatedBench(wish.scene, wish.place, wish.samples))
        sim.amplifier.speed = wish.speed
        description = _description(sim, wish)
        if wish.line is not None:
            with storing(wish.line):
                wish.line.symlink_to(sim.line)
            stack.callback(wish.line.unlink, missing_ok=True)
        if wish.out is not None:
            with storing(wish.out):
                wish.out.write_text(description.to_toml(), encoding="utf-8")
        pacer = Pacer(sim.clock, wish.speed, failures.append, sim.servers.catch_up)
        if wish.step is None:
            stack.enter_context(pacer)
        yield Served(sim, description, pacer, failures)


def serve_until_told(wish: Wish, announce: Callable[[BenchDescription], None], shows_status: bool) -> None:
    """Serve until Ctrl-C, SIGTERM, SIGHUP or "quit"; `announce` is told once by what description clients find it.

    Raises:
        BenchError: as `serving`; or the scene failed while it was served. RecordError: as `serving`.
    """
    with taken(ENDINGS, _end), serving(wish) as served, ExitStack() as stack:
        announce(served.description)
        look = stack.enter_context(_page(served)) if shows_status else _unseen
        _attend(served, wish.step, look, [sys.stdin.fileno()] if sys.stdin is not None else [])


def _description(sim: SimulatedBench, wish: Wish) -> BenchDescription:
    named = {} if wish.line is None else {LINE: {"port": str(wish.line.absolute())}}
    return sim.description.moved(named)


def _attend(served: Served, step: float | None, look: Callable[[], None], typed: Sequence[int]) -> None:
    """Do what is typed, line by line, until "quit"; the end of the input ends nothing."""
    person = Person(served.sim)
    rest = b""
    try:
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
    except KeyboardInterrupt:
        return
    raise BenchError(f"the scene cannot go on: {served.failures[0]}") from served.failures[0]


def _carry_out(person: Person, text: str) -> None:
    try:
        say(person.do(text) or f"done: {text}", err=True)
    except PalpateError as error:  # of a mistyped line, which is no reason to stop
        say(f"palpate: {error}", err=True)


def _unseen() -> None:
    pass


@contextmanager
def _page(served: Served) -> Iterator[Callable[[], None]]:
    from rich.live import Live

    traffic = Traffic(served.sim)
    with Live(console=console(), auto_refresh=False) as live:

        def look() -> None:
            live.update(status(served.sim, traffic.rate(time.monotonic()), served.pacer.behind), refresh=True)

        yield look


def _end(_number: int, _frame: FrameType | None) -> None:
    """SIGTERM and SIGHUP end it as Ctrl-C does."""
    raise KeyboardInterrupt
