"""Exciters, which drive the stack: a generator with an amplifier, or one device that is both, such as a drive."""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.kinds import AmplifierSettings
from palpate.instrument.bench.role_maps import WATCHDOG, ExciterMap
from palpate.instrument.contracts.contract import Pdo, Value
from palpate.instrument.contracts.declaration import MOST_CYCLIC
from palpate.instrument.contracts.own import LARGEST_PEAK, SETTINGS, SHAKER_AMPLIFIER, SIGNAL_GENERATOR
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    LinkError,
    RangeError,
    SafetyError,
    SettingsLost,
    Unfed,
)


class WatchdogGuard(Protocol):
    """The device of an exciter that switches the output off when its watchdog is not fed.

    Attributes:
        name: its name.
        owned: whether only its owner feeds the watchdog; else any request does.
    """

    name: str
    owned: bool

    def claim(self) -> bool:
        """Become or stay the owner. Returns False if another program owns it and is alive."""

    def release(self) -> None:
        """Give the ownership up, which switches the output off."""

    def feed(self) -> None:
        """Feed the watchdog, with a second attempt if it is not confirmed."""

    def live(self) -> None:
        """Feed the watchdog from the heartbeat's thread, with a single attempt."""

    def get(self, name: str) -> float:
        """The value of a field; "watchdog" is the time-out [s]."""


class Exciter(ABC):
    """Drives the stack, and can be switched off.

    The driver of a lab's own single-device exciter inherits from this and from `ModbusDevice` or `CanopenDevice`.

    Attributes:
        guard: its device with a watchdog, whose contract has a field `watchdog`. None: nothing switches the exciter off
            when this program is killed; the bench file must then say `watchdog = "none"`.
        largest: greatest amplitude of its sine [V].
        unit: unit of its effort.
    """

    guard: WatchdogGuard | None = None
    largest: float = LARGEST_PEAK
    unit: str = "A"

    @property
    def members(self) -> tuple[Any, ...]:
        """Its devices, the guard first; a bench opens them before all other devices."""
        return (self,)

    @abstractmethod
    def sine(self, frequency: float, amplitude: float) -> None:
        """Drive with a sine of `frequency` [Hz] and peak `amplitude` [V], with a continuous phase."""

    @abstractmethod
    def drive(self) -> None:
        """Switch the outputs on, at zero amplitude. Raises DeviceError: a fault is latched."""

    @abstractmethod
    def rest(self) -> None:
        """Bring the outputs to zero."""

    @abstractmethod
    def check(self) -> object:
        """Check its state. Raises SafetyError: it has tripped, or is close to its limits."""

    @abstractmethod
    def effort(self) -> float:
        """Present peak of its effort, such as the current, in `unit`. Raises as `check` does."""

    @abstractmethod
    def effort_limit(self) -> float:
        """Peak effort above which it trips, in `unit`."""

    def halt(self) -> None:
        """Stop a bench that was left driving; only the first member is open at this time."""
        self.rest()

    def quiet(self) -> object:
        """Bring the outputs of its other members to zero; by default there are none."""
        return None

    def means(self) -> list[Callable[[], object]]:
        """All ways to switch it off, the safest first."""
        return [self.rest]


# --- the signal generator ------------------------------------------------------------------------------


class SignalGenerator(ModbusDevice):
    """Our signal generator, which a map does not describe: it counts the writes that it takes.

    If there are more than this driver has sent, another program writes to it.
    """

    contract = SIGNAL_GENERATOR

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._least = self._most = 0  # bounds of its count of writes, if no other program writes

    def connect(self) -> None:
        """As for every device; the count of writes starts here. Raises as `identify` does."""
        super().connect()
        self._count()

    def _count(self) -> int:
        """Read its count of writes, from which this driver counts on."""
        self._least = self._most = count = int(self.get("writes"))
        return count

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> bool:
        try:
            confirmed = super()._write(start, registers, values)
        except BenchError as error:
            if not (isinstance(error, DeviceError) and error.code):  # no refusal: the write may have been carried out
                self._most += 1
            raise
        self._most += 1
        if not confirmed:  # the value alone does not tell whether it was taken, if it is as before
            self._await_start(lambda: self.get("writes") >= self._most)
        self._least += 1
        return confirmed

    def differences(self) -> list[str]:
        """As for every device; also another program's writes, whose changes may have been taken back."""
        found = super().differences()  # before the count is read, so that no later write is missed
        least, most = self._least, self._most
        count = self._count()
        if found or least <= count <= most:
            return found
        return [
            f"{self.name}: counts {count} writes instead of {most}: another program writes to it, or it was switched "
            "off meanwhile"
        ]

    def restore(self) -> None:
        """As for every device."""
        self._count()
        super().restore()

    def sine(self, frequency: float, amplitude: float, offset: float = 0.0) -> None:
        """Set a sine of `frequency` [Hz], peak `amplitude` [V] and `offset` [V] in one write, with a continuous phase.

        Raises:
            RangeError: the frequency is outside 0 to 20 kHz, the amplitude outside 0 to 10 V, or amplitude + |offset|
                above 10 V; nothing is sent.
        """
        if amplitude + abs(offset) > LARGEST_PEAK:
            raise RangeError(
                f"signal generator: amplitude {amplitude:g} V + |offset| {abs(offset):g} V is above {LARGEST_PEAK:g} V;"
                " lower one of them"
            )
        self.set(frequency=frequency, amplitude=amplitude, offset=offset, waveform="sine")

    def output(self, on: bool) -> None:
        """Close or open the output relay."""
        self.set(output="on" if on else "off")

    def read(self) -> tuple[float, float, float]:
        """Frequency [Hz], amplitude [V] and offset [V], as the device holds them."""
        frequency, amplitude, offset = self.get_many("frequency", "amplitude", "offset")
        return frequency, amplitude, offset


# --- the shaker amplifier ------------------------------------------------------------------------------


HOTTEST = 85.0  # degC at which the driver stops; the amplifier itself trips at 90
ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_BUSY = 2, 3, 6  # Modbus exception codes
SWITCHED_OFF = {"enable": "off"}


@dataclass(frozen=True, slots=True)
class AmplifierState:
    """State of the amplifier.

    Attributes:
        current: RMS output current [A].
        voltage: RMS output voltage [V].
        temperature: temperature of the heat sink [°C].
        faults: names of the present faults.
        faults_latched: names of the latched faults.
        enabled: whether the output stage is on.
    """

    current: float
    voltage: float
    temperature: float
    faults: frozenset[str]
    faults_latched: frozenset[str]
    enabled: bool


class ShakerAmplifier(ModbusDevice):
    """Our shaker amplifier, which a map does not describe: an owner gives it orders, and feeds its watchdog.

    If it is `owned`, only the program that has claimed it can write settings and feed its watchdog. Else it takes
    settings from any program, and any request feeds its watchdog.
    """

    contract = SHAKER_AMPLIFIER

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        return cls(place.link, place.unit, place.clock, owned=place.settings.watchdog_fed_by == "owner")

    def __init__(self, link: ModbusLink, unit: int, clock: Clock, *, owned: bool = True) -> None:
        super().__init__(link, unit, clock)
        self.owned = owned
        self._token = 0
        self._counters = {False: 0, True: 0}  # counter of the signs of life (False), and of the orders (True)
        self._turn = threading.Lock()  # heartbeat and driving thread send in turns, so that counters rise on the wire

    def claim(self) -> bool:
        """Become or stay the owner. Returns False if another program owns it and has fed the watchdog in time.

        Raises:
            DeviceError: the amplifier knows no owners.
            LinkError: it does not answer.
        """
        if not self.owned:
            return True
        if self._token:
            try:
                self.feed()
                return True
            except (BenchInUse, SettingsLost):
                self._token = 0
        try:
            self._token, self._counters = int(self.get("ticket")), {False: 0, True: 0}
        except DeviceError as error:
            if error.code != ILLEGAL_ADDRESS:
                raise
            raise DeviceError(
                f"{self.name}: has no owners, so whoever reads it keeps its output on though this program has died; "
                'if that cannot be helped, write watchdog_fed_by = "any request" in its section of the bench file'
            ) from None
        patience, self._timing["busy"] = self._timing["busy"], 0.0  # so it answers to all but the owner: asked later
        try:
            self.feed()
        except BenchInUse:
            self._token = 0
            return False
        finally:
            self._timing["busy"] = patience
        return True

    def feed(self) -> None:
        """Feed the watchdog; without a confirmation it is sent a second time, which does no harm.

        Raises:
            BenchInUse: another program has claimed the amplifier.
            SettingsLost: the amplifier has no owner, because it was switched off.
            LinkError, DeviceError: it does not answer.
        """
        self._asked(self.live)

    def live(self) -> None:
        """Feed the watchdog with a single attempt. Raises as `feed` does."""
        if self._token:
            self._ordered(lambda: self._as_owner({}))
        else:
            self._ordered(lambda: self._read(("status",)))

    def release(self) -> None:
        """Switch the output off and give the ownership up. Raises LinkError, DeviceError."""
        token, self._token = self._token, 0
        if token:
            self.set(release=token)

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> bool:
        if not self._token or not values.keys() <= SETTINGS.keys() or values == SWITCHED_OFF:
            return super()._write(start, registers, values)
        confirmed = True
        for name, register in zip(sorted(values, key=SETTINGS.__getitem__), registers, strict=True):
            confirmed &= self._as_owner({"order": name, "order_value": register}, {name: values[name]})
        return confirmed

    def _as_owner(self, order: Mapping[str, Value], meant: Mapping[str, Value] | None = None) -> bool:
        """Write token and counter, followed by an `order`; errors name the setting `meant` by the order.

        Returns whether the write is confirmed, or else acknowledged.
        """
        with self._turn:
            self._counters[bool(order)] += 1
            block = {"token": self._token, "counter": self._counters[bool(order)], **order}
            data = b"".join(self.contract.encode(name, value) for name, value in block.items())
            registers = [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]
            try:
                return super()._write(self.contract["token"].address, registers, meant or block)
            except DeviceError as error:
                if error.code == DEVICE_BUSY:
                    raise BenchInUse(
                        f"{self.name}: belongs to another program, which feeds its watchdog; wait for that to end, or "
                        "look for who else knows its address"
                    ) from None
                if error.code == ILLEGAL_VALUE:
                    raise SettingsLost(f"{self.name}: does not know this program any more; look at it") from None
                raise

    def set_up(self, settings: AmplifierSettings, watchdog: float) -> None:
        """As for every device. A latched fault of the watchdog is cleared, because every killed run leaves it.

        Raises SafetyError: the amplifier has tripped on another fault.
        """
        if self.read().faults_latched == {"watchdog"}:
            self.clear_faults()
        self.check()
        self.configure(settings.gain, settings.current_limit, watchdog)

    def configure(self, gain: float, current_limit: float, watchdog: float) -> None:
        """Set the voltage gain [V/V], the peak current at which it trips [A], and the watchdog's time-out [s]."""
        self.set(gain=gain, current_limit=current_limit)
        self.set(watchdog=watchdog)

    def enable(self) -> None:
        """Switch the output stage on. Raises DeviceError: a fault is latched."""
        self.set(enable="on")

    def disable(self) -> None:
        """Switch the output stage off."""
        self.set(enable="off")

    def clear_faults(self) -> None:
        """Clear the latched faults whose cause is gone."""
        self.set(clear_faults=1)

    def read(self) -> AmplifierState:
        """The present state. Raises LinkError, LinkTimeout, DeviceError."""
        current, voltage, temperature, faults, latched, status = self.get_many(
            "output_current", "output_voltage", "temperature", "faults", "faults_latched", "status"
        )
        return AmplifierState(
            current,
            voltage,
            temperature,
            self.contract.set_bits("faults", faults),
            self.contract.set_bits("faults_latched", latched),
            "enabled" in self.contract.set_bits("status", status),
        )

    def check(self) -> AmplifierState:
        """The present state, if it is safe.

        Raises:
            SafetyError: a fault is latched, and the output is off; or the current limit is passed, or the heat sink is
                within 5 K of the temperature at which the device trips.
        """
        state = self.read()
        if state.faults_latched:
            what = f"{self.name}: tripped on {', '.join(sorted(state.faults_latched))}; the output is off"
            if state.faults_latched == {"watchdog"}:
                raise Unfed(
                    what,
                    "It heard nothing of this program for too long: was that stopped (Ctrl-Z), did this machine sleep, "
                    "was a cable out? The next run clears the fault",
                )
            raise SafetyError(f"{what}. Remove the cause, then clear the faults")
        limit = float(self._settings.get("current_limit", math.inf))
        if state.temperature > HOTTEST or math.sqrt(2) * state.current > limit:
            raise SafetyError(
                f"{self.name}: heat sink at {state.temperature:g} degC, {math.sqrt(2) * state.current:.3g} A peak; "
                f"limits are {HOTTEST:g} degC and {limit:g} A. Outputs go off; let it cool, or ask for smaller loads"
            )
        return state


# --- the kinds of exciters -----------------------------------------------------------------------------


QUIET = 10.0, 0.0  # Hz, V: a sine with no amplitude


class Amplified(Exciter):
    """An exciter of a generator and an amplifier."""

    def __init__(self, source: Any, amplifier: Any) -> None:
        """Make an exciter of two devices.

        Args:
            source: the generator, with `sine` and `output`.
            amplifier: the amplifier, with `enable`, `disable` and `check`. With a watchdog it is the `WatchdogGuard`,
                too.
        """
        self._source, self._amplifier = source, amplifier
        self.guard = amplifier if amplifier.contract.has("watchdog") else None

    @property
    def members(self) -> tuple[Any, ...]:
        return self._amplifier, self._source

    def sine(self, frequency: float, amplitude: float) -> None:
        self._source.sine(frequency, amplitude)

    def drive(self) -> None:
        self._source.sine(*QUIET)
        self._amplifier.enable()
        self._source.output(True)

    def rest(self) -> None:
        self._source.sine(*QUIET)
        self._source.output(False)
        self._amplifier.disable()

    def halt(self) -> None:
        self._amplifier.disable()

    def quiet(self) -> None:
        self._source.output(False)
        self._source.sine(*QUIET)

    def means(self) -> list[Callable[[], object]]:
        return [self._amplifier.disable, lambda: self._source.output(False), lambda: self._source.sine(*QUIET)]

    def check(self) -> AmplifierState:
        state: AmplifierState = self._amplifier.check()
        return state

    def effort(self) -> float:
        """Peak of the output current [A]."""
        return math.sqrt(2) * self.check().current

    def effort_limit(self) -> float:
        """Peak output current at which the amplifier trips [A]."""
        limit: float = self._amplifier.get("current_limit")
        return limit


# --- A sine as a list of set-points that a bus sends over and over -------------------------------------

FEWEST = 20  # set-points of a period
CLOSEST = 2e-5  # greatest error of the frequency, relative
LONGEST_US = 1_000_000  # between two set-points


@dataclass(frozen=True)
class SetPointGrid:
    """Times of the set-points of some whole periods: `count` of them, `step_us` apart, which are `periods`."""

    count: int
    step_us: int
    periods: int

    @property
    def length_ns(self) -> int:
        """Time that the list takes."""
        return 1000 * self.count * self.step_us

    @property
    def frequency(self) -> float:
        """Frequency of the sine [Hz]."""
        return 1e9 * self.periods / self.length_ns

    def sine(self, peak: float) -> list[float]:
        """The set-points of a sine."""
        return [peak * math.sin(2 * math.pi * self.periods * number / self.count) for number in range(self.count)]


def grid(frequency: float, fastest: float, who: str) -> SetPointGrid:
    """The times of set-points whose sine is closest to a frequency.

    Args:
        frequency: frequency of the sine [Hz].
        fastest: shortest time between two set-points [s].
        who: name of the device, for the message.

    Raises RangeError: the frequency is too high or too low, or no list has it.
    """
    highest, lowest = 1 / (FEWEST * fastest), 1e6 / (MOST_CYCLIC * LONGEST_US)
    if not lowest <= frequency <= highest:
        raise RangeError(
            f"{who}: frequency = {frequency:g} Hz is outside {lowest:.3g} to {highest:g} Hz, which {FEWEST} to "
            f"{MOST_CYCLIC} set-points of a period reach, {1e3 * fastest:g} ms or more apart; give one inside"
        )
    best = min(_lists(frequency, fastest), key=lambda each: abs(each.frequency - frequency))
    if abs(best.frequency - frequency) > CLOSEST * frequency:
        raise RangeError(
            f"{who}: frequency = {frequency:.10g} Hz: no list of set-points, which come every whole microsecond, has "
            f"it; the nearest has {best.frequency:.10g} Hz"
        )
    return best


def _lists(frequency: float, fastest: float) -> Iterator[SetPointGrid]:
    """All lists near a frequency, those of few periods first, and of these the finest first."""
    for periods in range(1, MOST_CYCLIC // FEWEST + 1):
        for count in range(MOST_CYCLIC, FEWEST * periods - 1, -1):
            step_us = round(1e6 * periods / (frequency * count))
            if fastest * (1 - 1e-9) <= 1e-6 * step_us <= 1e-6 * LONGEST_US:
                yield SetPointGrid(count, step_us, periods)


# --- a drive that follows set-points -------------------------------------------------------------------

NODE_BITS = 16  # bits of 1016h below those of the node id that is watched
OFF = 0.0


class StreamedExciter(CanopenDevice, Exciter):
    """A drive that follows set-points, by its map's table `[role.exciter]`.

    Its amplitude is that of an input of 10 V; see `ExciterSettings.full_scale`.
    """

    owned = True  # no request feeds its watchdog, only a heartbeat of this program's node id
    unit = "%"
    _map: ExciterMap
    _full_scale: float  # %, peak of the effort at the greatest amplitude
    _stream: Pdo  # that holds a set-point
    _master: int  # node id of this program

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        """Make the driver of a drive whose kind has a table for the role."""
        made = super().at(place)
        assert place.kind is not None
        made._map, made._full_scale = place.kind.table(ExciterMap), 100 * place.settings.full_scale
        made._stream = made.contract.taken(made._map.stream)
        made.orders = made.orders | frozenset(made._stream.fields)
        made._master = int(made.contract.raw(WATCHDOG, OFF)) >> NODE_BITS
        made.guard = made
        return made

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._timeout = OFF
        self._mine = False  # whether this program owns it
        self._enabled = False  # whether it should be driving
        self._grid: SetPointGrid | None = None  # of the set-points that the bus sends now; None: it sends none
        self._begun_ns = 0
        self._peak = 0.0  # %

    def connect(self) -> None:
        """As every node; raises LinkError as well if its bus cannot send set-points on time."""
        self.link.check_cyclic()
        super().connect()

    def set_up(self, settings: Any, watchdog: float) -> None:
        self._timeout = watchdog
        self.give(**self._map.set_up)

    def check_section(self, settings: Any, frequency: float) -> None:
        """As for every device: its map tells all that limits its frequency."""
        self.check_frequency(frequency)

    def check_frequency(self, frequency: float) -> None:
        """Raises RangeError: no list of set-points has this frequency [Hz]."""
        grid(frequency, self._map.fastest, self.name)

    # --- what switches it off ------------------------------------------------------------------------------

    def claim(self) -> bool:
        """Become or stay the owner; a drive that another program has enabled is not free until its watchdog acts."""
        if not self._mine and self._drives():
            if self.held(WATCHDOG) <= 0:
                raise DeviceError(
                    f"{self.name}: is switched on, and watches nobody's heartbeat; end the program that uses it, or "
                    "switch the drive off",
                    device=self.name,
                )
            return False
        self._mine = True
        return True

    def release(self) -> None:
        """Switch it off, and own it no longer."""
        self._switch_off()
        self._mine = False

    def feed(self) -> None:
        """Let the drive hear a heartbeat; there is no answer."""
        self._ordered(self.live)

    def live(self) -> None:
        """Let the drive hear a heartbeat, from whatever thread."""
        self.link.beat(self._master)

    # --- the role ------------------------------------------------------------------------------------------

    def sine(self, frequency: float, amplitude: float) -> None:
        """Drive with a sine. A running one ends where it crosses zero upwards, where the new one begins.

        Raises RangeError: the amplitude is above 10 V, or the bus cannot send a sine of this frequency.
        """
        if not 0 <= amplitude <= self.largest:
            raise RangeError(f"{self.name}: amplitude = {amplitude:g} V is outside 0 to {self.largest:g} V")
        new = grid(frequency, self._map.fastest, self.name)
        peak = self._full_scale * amplitude / self.largest
        (name,) = self._stream.fields
        frames = [self.contract.packed(self._stream, {name: value}) for value in new.sine(peak)]
        if self._grid is not None:
            left = -(self.clock.now_ns() - self._begun_ns) % self._grid.length_ns
            self.clock.wait(1e-9 * left)
        if not peak:
            self._still()
            return
        self._ordered(self.start)  # again, because another program may have told the node another state meanwhile
        self._ordered(lambda: self.link.begin_cycle(self._stream.cob_id(self.id), frames, new.step_us))
        self._grid, self._begun_ns, self._peak = new, self.clock.now_ns(), peak
        self._asked(self._barrier)  # the drive has got what was sent before

    def drive(self) -> None:
        """Switch the output on, at a set-point of zero. Raises DeviceError: a fault is latched."""
        self._clear_loss()
        self.start()
        self._still()
        self.live()  # from its first heartbeat on it is watched
        self.set(WATCHDOG, self._timeout)
        self.live()
        self.command(self._map.enable)
        self._enabled = True

    def rest(self) -> None:
        """Bring the set-point to zero, switch the output off, and let it watch nothing any more."""
        self._enabled = False
        self._still()
        self._switch_off()
        self.set(WATCHDOG, OFF)

    def halt(self) -> None:
        self._switch_off()

    def means(self) -> list[Any]:
        return [self._switch_off, self._still]

    def check(self) -> None:
        """Raises SafetyError: it has a fault, or has switched itself off."""
        field, bit = self._map.fault
        if bit in self.contract.set_bits(field, self.get(field)):
            error = self.held(self._map.error)
            if int(error) == self._map.lost:
                raise Unfed(
                    f"{self.name}: did not hear this program, and has switched its output off",
                    "Find the cause, and run again",
                )
            raise SafetyError(
                f"{self.name}: has the fault 0x{int(error):04X}, and has switched its output off; find the cause, and "
                "run again"
            )
        if self._enabled and not self._drives():
            raise SafetyError(f"{self.name}: its output was switched off; find out by whom, and run again")

    def effort(self) -> float:
        """Present peak of the set-points [%]."""
        self.check()
        return self._peak

    def effort_limit(self) -> float:
        return self._full_scale

    def restore(self) -> None:
        super().restore()
        self._grid = None  # a drive that has started anew follows set-points again after `drive`

    # --- parts ---------------------------------------------------------------------------------------------

    def _drives(self) -> bool:
        """Whether its output is on. Raises LinkError, DeviceError."""
        done = self.contract.command(self._map.enable).done
        assert done is not None
        return done.holds(self.contract[done.field].to_raw(self.held(done.field)))

    def _clear_loss(self) -> None:
        """Clear the fault that a program was no longer heard, which holds after that program was killed.

        Raises DeviceError: another fault is latched.
        """
        field, bit = self._map.fault
        if bit not in self.contract.set_bits(field, self.get(field)):
            return
        if (error := int(self.held(self._map.error))) != self._map.lost:
            raise DeviceError(
                f"{self.name}: has the fault 0x{error:04X}; find its cause, then switch the drive off and on",
                device=self.name,
            )
        self.command(self._map.reset)

    def _still(self) -> None:
        """End the stream, and send a set-point of zero once."""
        self._grid, self._peak = None, 0.0
        try:
            self.link.end_cycle(self._stream.cob_id(self.id))
        finally:
            self.send(self._stream.name, **dict.fromkeys(self._stream.fields, 0.0))
        self._asked(self._barrier)

    def _switch_off(self) -> None:
        """Switch the output off. An order that is not confirmed is given once more: it cannot do harm.

        A node that another program has stopped (NMT) answers nothing until it is told another state.
        """
        try:
            self.command(self._map.disable)
        except LinkError as error:
            self.noticed(f"{error}; switched off once more")
            with suppress(LinkError):
                self.stop()
            self.command(self._map.disable)
