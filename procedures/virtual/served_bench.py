"""Serves a simulated bench to other programs until it is told to end, with a console for work by hand and faults."""

from __future__ import annotations

import math
import os
import select
import shlex
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from palpate.drivers.safe_end import taken
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import LINE
from palpate.instrument.contracts.own import bus_load
from palpate.instrument.errors import BenchError, PalpateError, RangeError, UsageError
from palpate.instrument.own_process import Ends
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.procedures.console.terminal import console, say
from palpate.procedures.records.chain import RECORD
from palpate.procedures.records.events import Event
from palpate.procedures.records.run import storing
from palpate.simulators.bench import NAMED, BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import SimulatedOperator
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.loop import Pacer

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.procedures.live.feed import Feed


# --- The console of a served bench: its status page, and typed commands for work by hand and for faults

HANDLING = """mount SAMPLE, lay SAMPLE|none, probe X Y, tooth N, weight MASS, turn DEGREES, warm KELVIN, \
fault PLACE KIND [NAME=VALUE ...], clear PLACE [KIND], clear all, faults, quit"""


class _AtOnce:
    """A clock on which work by hand takes no time: the person at a served bench has taken the time already."""

    def __init__(self, sim: SimulatedBench) -> None:
        self.lock: AbstractContextManager[Any] = sim.clock.lock

    def wait(self, duration: float) -> None:
        pass


class Person:
    """Carries out typed commands: one of HANDLING in each line."""

    def __init__(self, sim: SimulatedBench) -> None:
        operator = SimulatedOperator(sim.rig, _AtOnce(sim))
        self._sim = sim
        self._verbs: dict[str, Callable[[list[str]], str | None]] = {
            "mount": lambda words: operator.mount(get_sample(_one(words))),
            "lay": lambda words: operator.lay_on_support(None if words == ["none"] else get_sample(_one(words))),
            "probe": lambda words: operator.place_probe(*(parse(word, "m") for word in _several(words, 2))),
            "tooth": lambda words: operator.press_tooth(_number(_one(words), len(sim.scene.design.teeth)) - 1),
            "weight": lambda words: operator.place_weight(_within("weight", " ".join(words), "kg", 0, HEAVIEST)),
            "turn": lambda words: operator.turn_load_cell(_within("turn", _one(words), "", 0, 360)),
            "warm": lambda words: operator.set_temperature(_within("warm", " ".join(words), "K", -WARMEST, WARMEST)),
            "fault": self._give,
            "clear": self._clear,
            "faults": lambda words: self._listed(_several(words, 0)),
        }

    def do(self, line: str) -> str | None:
        """Carry out a line; returns the answer, or None if there is none but that it is done.

        Raises:
            UsageError, ConfigError: the line is no command, or describes no possible fault.
            BenchError: the probe is not home.
            RangeError, UnknownName: a value is outside its range, or a name does not exist.
        """
        try:
            verb, *words = shlex.split(line)
        except ValueError as error:  # a quotation mark without its partner
            raise UsageError(f"{line!r} cannot be read ({error}); close the quotation marks") from None
        if verb not in self._verbs:
            raise UsageError(f"{line!r} is no command of the bench's console; type one of: {HANDLING}")
        return self._verbs[verb](words)

    def _give(self, words: list[str]) -> None:
        if len(words) < PLACE_AND_KIND:
            raise UsageError(f"fault: needs a PLACE and a KIND; type one of: {HANDLING}")
        on, kind, *given = words
        table: dict[str, Any] = {"on": on, "kind": kind}
        for word in given:
            name, equals, value = word.partition("=")
            if not equals or name in table:
                raise UsageError(f"fault: {word!r} is no NAME=VALUE, or is given twice; type it like lasts='2 s'")
            table[name] = _number_or_text(value)
        self._sim.injection.give_by_hand(table)

    def _clear(self, words: list[str]) -> str:
        if not 0 < len(words) <= PLACE_AND_KIND:
            raise UsageError(f"clear: needs a PLACE and perhaps a KIND, or all; type one of: {HANDLING}")
        return "\n".join(f"cleared: {given.summary()}" for given in self._sim.injection.clear(*words))

    def _listed(self, _words: list[str]) -> str:
        return "\n".join(given.summary() for given in self._sim.injection.given) or "no fault is given"


PLACE_AND_KIND = 2  # number of words
HEAVIEST = 100.0  # kg
WARMEST = 200.0  # K, above or below the temperature at the start


def _within(what: str, text: str, unit: str, low: float, high: float) -> float:
    """The value of a quantity. Raises QuantityError: it cannot be read. RangeError: it is outside `low` to `high`."""
    value = parse(text, unit)
    if not low <= value <= high:
        raise RangeError(f"{what} {text}: is outside {low:g} to {high:g} {unit}".rstrip() + "; give one inside")
    return value


def _number(text: str, most: int) -> int:
    """Number of a tooth, from 1. Raises QuantityError: it cannot be read. RangeError: there is no such tooth."""
    value = parse(text, "", "1")
    if value not in range(1, most + 1):
        raise RangeError(f"tooth {text}: there is no such tooth; give {f'1 to {most}' if most > 1 else 1}")
    return int(value)


def _number_or_text(text: str) -> float | int | str:
    """A value as in TOML, because the keys of a `[[fault]]` table are numbers or texts."""
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            pass
    return text


def _one(words: list[str]) -> str:
    return _several(words, 1)[0]


def _several(words: list[str], count: int) -> list[str]:
    if len(words) != count:
        needed = {0: "no argument", 1: "1 argument"}.get(count, f"{count} arguments")
        raise UsageError(f"this command takes {needed}, not {len(words)}; type one of: {HANDLING}")
    return words


class TransactionRate:
    """Counts the Modbus transactions per second between two calls."""

    def __init__(self, sim: SimulatedBench) -> None:
        self._sim = sim
        self._before = (0.0, 0)

    def rate(self, now: float) -> float:
        """Transactions per second since the last call; `now` is wall time [s]."""
        (then, before), count = self._before, self._sim.servers.transactions
        self._before = (now, count)
        return (count - before) / (now - then) if then else 0.0


def _exciter(sim: SimulatedBench) -> dict[str, str]:
    """The lines of the status page about generator and amplifier; none if another kind of device drives."""
    if not {"signal_generator", "shaker_amplifier"} <= sim.devices.keys():
        return {}
    generator, amplifier = sim.generator.settings, sim.amplifier
    contract = amplifier.contract
    faults = {name: contract.set_bits(name, amplifier.read(name)) for name in ("faults", "faults_latched")}
    return {
        "generator": f"{_on(generator['output'])}, {show(generator['amplitude'], 'V')} at "
        f"{show(generator['frequency'], 'Hz')}",
        "amplifier": f"{_on(amplifier.settings['enable'])}, {show(amplifier.read('output_current'), 'A')}, "
        f"{amplifier.read('temperature'):.1f} °C",
        "faults": ", ".join(sorted(faults["faults"])) or "none",
        "latched": ", ".join(sorted(faults["faults_latched"])) or "none",
    }


def _measured(sim: SimulatedBench) -> dict[str, str]:
    """The lines of the status page about our own indicator and positioner, unless others stand in for them."""
    lines = {}
    if "strain_indicator" in sim.devices:
        reading = sim.indicator.read("reading_float")
        lines["indicator"] = "bridge open" if math.isnan(reading) else f"{reading:g} mV"
    if "positioner" in sim.devices:
        lines["positioner"] = show(sim.positioner.read("position"), "m")
    return lines


def state_of(sim: SimulatedBench, rate: float, behind: float) -> dict[str, str]:
    """The state of a served bench at this moment, as texts by what they are about.

    Args:
        sim: the bench.
        rate: Modbus transactions per second.
        behind: time that the bench's clock has lost against the wall clock [s].
    """
    with sim.clock.lock:
        states, sync = {node.id: sim.can.states[node.id] for node in sim.nodes}, sim.can.sync_rate
        active = sum(state == "OPERATIONAL" for state in states.values())
        load = bus_load(active, sync, sim.bitrate) if sync else 0.0
        return {
            "bench time": f"{sim.clock.now_ns() / 1e9:.1f} s" + (f", {behind:.1f} s behind" if behind >= 1 else ""),
            **_exciter(sim),
            **_measured(sim),
            **{guest.name: guest.kind.contract.title for guest in sim.scene.devices},
            "sensor nodes": ", ".join(f"{number} {state.lower()}" for number, state in states.items()),
            "CAN bus": f"{100 * load:.0f} % of {show(sim.bitrate, 'bit/s')} at worst",
            "Modbus": f"{rate:.0f} transactions/s",
        }


def status(sim: SimulatedBench, rows: Mapping[str, str]) -> Table:
    """The status page of a served bench in this state."""
    from rich.table import Table

    table = Table(title=f"SIMULATED {sim.description.name}", show_header=False, box=None, padding=(0, 1))
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _on(value: float) -> str:
    return "on" if value else "off"


# --- the served bench ----------------------------------------------------------------------------------

REFRESH = 0.25  # s of wall time between two updates of the status page
OUT = "a file in a writable folder with --out"
MOST_SHOWN = 1000  # samples of each film on a live page
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


def serve_until_told(
    wish: Wish, announce: Callable[[BenchDescription], None], shows_status: bool, feed: Feed | None = None
) -> None:
    """Serve until Ctrl-C, SIGTERM, SIGHUP or "quit".

    Args:
        wish: what to serve.
        announce: gets the description by which clients find the bench, once.
        shows_status: whether a page on the terminal shows the bench.
        feed: what live pages are told by; None: there are none.

    Raises:
        BenchError: the bench cannot be served (see `serving`), or the simulation failed while it was served.
        RecordError: a file cannot be written (see `serving`).
    """
    interrupts = taken([signal.SIGINT], _end, ignored=True)  # `serve &` in a script begins with it ignored
    with interrupts, taken(ENDINGS, _end), serving(wish) as served, ExitStack() as stack:
        try:
            announce(served.description)
            look = stack.enter_context(_shown(served, shows_status, feed)) if shows_status or feed else _unseen
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
def _shown(served: Served, on_terminal: bool, feed: Feed | None) -> Iterator[Callable[[], None]]:
    """A function that shows the bench as it is now, on the terminal and on live pages."""
    sim, traffic = served.sim, TransactionRate(served.sim)
    pages = None if feed is None else _LivePages(sim, feed)
    with ExitStack() as stack:
        terminal = None
        if on_terminal:
            from rich.live import Live

            terminal = stack.enter_context(Live(console=console(), auto_refresh=False))

        def look() -> None:
            rows = state_of(sim, traffic.rate(time.monotonic()), served.pacer.behind)
            if terminal is not None:
                terminal.update(status(sim, rows), refresh=True)
            if pages is not None:
                pages.show(rows)

        yield look


class _LivePages:
    """What live pages show of a served bench: its state, and what its films gave to the nodes last."""

    def __init__(self, sim: SimulatedBench, feed: Feed) -> None:
        self._sim, self._feed = sim, feed
        self._films = [film.name for film in sim.scene.design.films]
        self._next_ns = self._period_ns = 0
        self._volts = np.empty((len(self._films), 0))
        self._fresh = False
        sim.can.tap = self._take

    def _take(self, time_ns: npt.NDArray[np.int64], volts: npt.NDArray[np.float64], period_ns: int) -> None:
        before = self._volts if (time_ns[0], period_ns) == (self._next_ns, self._period_ns) else self._volts[:, :0]
        self._volts = np.hstack([before, volts])[:, -MOST_SHOWN:]
        self._next_ns, self._period_ns, self._fresh = int(time_ns[-1]) + period_ns, period_ns, True

    def show(self, rows: Mapping[str, str]) -> None:
        """Tell the pages; `rows`: the state. Of the films only if nodes have sampled since."""
        scene, bench = self._sim.scene, self._sim.description.name
        bench_data = {"bench": bench, "scene": scene.name, "seed": scene.seed, "simulated": True}
        faults = [given.summary() for given in self._sim.injection.given]
        self._feed.tell("bench", {**bench_data, "devices": list(rows.items()), "faults": faults})
        with self._sim.clock.lock:
            fresh, self._fresh = self._fresh, False
            voltage, period_ns = self._volts, self._period_ns
            begun_ns = self._next_ns - voltage.shape[1] * period_ns
        if fresh:
            self._feed(Event("trace", begun_ns, {"rate": 1e9 / period_ns, "films": self._films, "voltage": voltage}))


def _end(_number: int, _frame: FrameType | None) -> None:
    """End on SIGTERM and SIGHUP as on Ctrl-C."""
    raise KeyboardInterrupt
