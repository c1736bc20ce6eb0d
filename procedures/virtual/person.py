"""The console of a served bench: its status page, and typed commands for work by hand and for faults."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from palpate.instrument.contracts.own import bus_load
from palpate.instrument.errors import RangeError, UsageError
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.sample import get_sample
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.rig import SimulatedOperator

if TYPE_CHECKING:
    from rich.table import Table

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


def status(sim: SimulatedBench, rate: float, behind: float) -> Table:
    """The status page of a served bench at this moment.

    Args:
        sim: the bench.
        rate: Modbus transactions per second.
        behind: time that the bench's clock has lost against the wall clock [s].
    """
    from rich.table import Table

    with sim.clock.lock:
        states, sync = {node.id: sim.can.states[node.id] for node in sim.nodes}, sim.can.sync_rate
        active = sum(state == "OPERATIONAL" for state in states.values())
        load = bus_load(active, sync, sim.bitrate) if sync else 0.0
        rows = {
            "bench time": f"{sim.clock.now_ns() / 1e9:.1f} s" + (f", {behind:.1f} s behind" if behind >= 1 else ""),
            **_exciter(sim),
            **_measured(sim),
            **{guest.name: guest.kind.contract.title for guest in sim.scene.devices},
            "sensor nodes": ", ".join(f"{number} {state.lower()}" for number, state in states.items()),
            "CAN bus": f"{100 * load:.0f} % of {show(sim.bitrate, 'bit/s')} at worst",
            "Modbus": f"{rate:.0f} transactions/s",
        }
    table = Table(title=f"SIMULATED {sim.description.name}", show_header=False, box=None, padding=(0, 1))
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _on(value: float) -> str:
    return "on" if value else "off"
