"""Drivers of load indicators, which read the load cell: that of makers' devices, by their maps, and that of ours."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device
from palpate.drivers.devices.either_bus import EitherBus
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.kinds import IndicatorSettings
from palpate.instrument.bench.role_maps import LoadIndicatorMap, LoadIndicatorSettings, LowPass, says
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import FLOATS, swapped
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.instrument.errors import DeviceError, RangeError

# -------------------------------------------------------------------------------------------------------
# The order of the words of a reading, which many devices let their users choose: told by what the readings mean

TINY = 1e-9  # of the unit of a display; a float of this size is no load
MOST_STEPS = 1e8  # of a display, that a float can tell: far more than a converter has
MOST_COUNTS = 1 << 24  # of an integer: a converter of 24 bits


class WordOrder:
    """Whether readings of one field come in the order of words that its map says, as far as they tell.

    A reading that would be no load in the order of the map is refused. One that would be no load in the other order
    tells that the order is right. Until there was one, a reading that could be a load in both orders is in doubt.

    Attributes:
        proved: whether the order is known to be right.
    """

    def __init__(self, contract: Contract, name: str, step: float) -> None:
        """Nothing is told yet.

        Args:
            contract: the device's contract.
            name: the field.
            step: step of the display, in the field's unit.
        """
        self._contract, self._field, self._step = contract, contract[name], step
        several = contract.bus == "modbus" and self._field.width > 1
        self.proved = not several or _proved(contract, name)

    def doubt(self, value: float, beside: dict[str, float], device: str) -> str:
        """Why it is not known that a reading is right; empty: it is known, or the reading is the same in both orders.

        Args:
            value: the reading, a number.
            beside: what the device tells of its scale.
            device: name of the device, for messages.

        Raises DeviceError: it is no load.
        """
        f = self._field
        read = f"{device}: {f.name} reads {value:.6g} {f.unit}".rstrip()
        other = self._otherwise(value, beside)
        if not self._can_be(value, beside):
            remedy = (
                f"so its words come in the other order ({other:.6g} {f.unit}".rstrip()
                + "); set the device to the order of its map, or use a map for its order"
                if other is not None
                else "which is no load; check type, address and scale of the field in its map, and the display's "
                "resolution"
            )
            raise DeviceError(
                f"{read}, {remedy}. If it says that there is no reading, give it as `missing`", device=device
            )
        if self.proved or value in (0, other):
            return ""
        if other is None:
            self.proved = True
            return ""
        return (
            f"{read}, with its words in the other order {other:.6g} {f.unit}".rstrip()
            + ": which is right is not told yet; compare with the display, or change the load until a reading tells"
        )

    def _can_be(self, value: float, beside: dict[str, float]) -> bool:
        """Whether a value can be a load."""
        f = self._field
        if value == 0:
            return True
        if self._contract.misread(f.name, value):
            return False
        if f.type in FLOATS:
            return TINY <= abs(value) <= MOST_STEPS * self._step
        return abs(value - f.offset) <= MOST_COUNTS * abs(self._contract.step(f.name, beside))

    def _otherwise(self, value: float, beside: dict[str, float]) -> float | None:
        """The load in the other order of words; None: in this order there is none."""
        name = self._field.name
        signs = {self._field.sign[0]: 0.0} if self._field.sign else {}
        with suppress(struct.error, OverflowError, ValueError):
            data = swapped(self._contract.pack(name, value, beside), words=True, octets=False)
            found = self._contract.decode(name, data, beside | signs)
            return found if found == found and self._can_be(found, beside) else None
        return None


def _proved(contract: Contract, name: str) -> bool:
    """Whether a device is known by a number of several words in the same order, which reads otherwise in another."""
    words = contract[name].words
    if contract.has("probe") and contract["probe"].words == words:
        return True
    for mark in contract.marks:
        f = contract[mark.field]
        if f.type != "text" and f.width > 1 and f.words == words:
            data = contract.encode(f.name, mark.value)
            if data != swapped(data, words=True, octets=False):
                return True
    return False


# -------------------------------------------------------------------------------------------------------
# How well readings follow a force that changes: what a filter and too few readings take off a peak-to-peak
# value

LARGEST_LOSS = 0.05  # of a peak-to-peak value, beyond which a frequency is refused
POLLS = 64  # readings from which a peak-to-peak value is made up
GOLDEN = (math.sqrt(5) - 1) / 2  # fraction whose multiples are spread most evenly over a cycle


@dataclass(frozen=True, slots=True)
class Following:
    """What readings can follow.

    Attributes:
        filter: the low-pass through which they go.
        rate: readings in a second [1/s].
        polled: whether extremes are found among readings that are asked for, not among all that are made.
    """

    filter: LowPass
    rate: float
    polled: bool = False

    def loss(self, frequency: float) -> float:
        """The part of a peak-to-peak value that is lost at a frequency [Hz], at most.

        The readings next to the extremes are half a reading's interval away from them, at most.
        """
        seldom = 1 - math.cos(min(math.pi * frequency / self.rate, math.pi / 2))
        return 1 - self.filter.passes(frequency) * (1 - seldom)

    def relative_u(self, frequency: float) -> float:
        """Relative standard uncertainty of a peak-to-peak value that is not corrected for what is lost.

        The loss lies between nothing and its greatest value. Of polled readings, at phases spread over the cycle, those
        nearest to the extremes take off pi²/N² on the average, and scatter by as much.
        """
        lost = self.loss(frequency) / math.sqrt(3)
        return math.hypot(lost, math.pi**2 / POLLS**2) if self.polled else lost

    def highest(self) -> float:
        """The highest frequency that is not refused [Hz], rounded down to three digits."""
        low, high = 0.0, self.filter.corner + self.rate
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if self.loss(middle) <= LARGEST_LOSS else (low, middle)
        digits = 2 - math.floor(math.log10(low))
        return round(math.floor(low * 10.0**digits) / 10.0**digits, digits)


def pauses(window: float, readings: int = POLLS) -> Iterator[float]:
    """Pauses between so many polled readings over a window [s], in step with no frequency."""
    mean = window / (readings - 1)
    return (mean * (0.5 + number * GOLDEN % 1.0) for number in range(1, readings))


# -------------------------------------------------------------------------------------------------------
# The filter of a load indicator's readings: whether it is as it was, and which frequencies get through


class ReadingFilter:
    """The low-pass through which the readings of a load indicator go.

    Attributes:
        level: raw value of the field that sets it; None: no field does, or neither section nor device told it yet.
    """

    def __init__(self, device: Device, role: LoadIndicatorMap, settings: LoadIndicatorSettings) -> None:
        self._device, self._role, self._settings = device, role, settings
        self._table = role.filter
        self.level: float | None = settings.filter

    def set_up(self) -> None:
        """Write the level of the section, and read the one that the device has. Raises LinkError, DeviceError."""
        if self._table is not None:
            if self._settings.filter is not None:
                self._device.give(**{self._table.field: self._settings.filter})
            self.level = self._device.get(self._table.field)

    @property
    def told_by_section(self) -> bool:
        """Whether the section tells the filter, so that the device need not be asked."""
        return self._table is None or self._settings.filter is not None

    @property
    def following(self) -> Following:
        """What the readings can follow. Raises RangeError: nothing tells the filter."""
        name, rate = self._device.name, self._settings.rate or self._role.rate
        if self._table is not None:
            low_pass = self._table.levels.get(f"{self.level:g}")
            if low_pass is None:
                raise RangeError(
                    f"{name}: {self._table.field} reads {self.level:g}, of which the map tells no cut-off "
                    f"frequency; write filter = one of {', '.join(self._table.levels)} in its section"
                )
        elif self._settings.bandwidth is None:
            raise RangeError(
                f"{name}: no field tells the filter of its readings, so it is not known which forces they "
                'follow; write bandwidth = "NUMBER Hz" in its section, as set at the device'
            )
        else:
            low_pass = LowPass(corner=self._settings.bandwidth)
        return Following(low_pass, rate, polled=not self._role.extremes)

    def check_kind(self) -> None:
        """Raises RangeError: another kind of filter is set than that of which the map tells the frequencies."""
        contract = self._device.contract
        for name, needed in self._table.needs.items() if self._table else ():
            if (found := self._device.get(name)) != needed:
                raise RangeError(
                    f"{self._device.name}: {name} reads {contract.choice(name, found)}; the map tells cut-off "
                    f"frequencies for {contract.choice(name, needed)} alone; set it so at the device"
                )

    def check_frequency(self, frequency: float) -> None:
        """Raises RangeError: a peak-to-peak reading would lose too much at this frequency [Hz]."""
        following = self.following
        if (loss := following.loss(frequency)) <= LARGEST_LOSS:
            return
        levels = self._table.levels if self._table else {}
        able = [
            level
            for level, low_pass in levels.items()
            if Following(low_pass, following.rate, following.polled).loss(frequency) <= LARGEST_LOSS
        ]
        now = f"{self._table.field} = {self.level:g}: " if self._table else ""
        faster = "" if self._table else "set the device faster and write its bandwidth and rate in its section, or "
        remedy = f"write filter = {able[0]} in its section, or " if able else faster
        raise RangeError(
            f"{self._device.name}: its readings ({now}{following.filter.corner:g} Hz, {following.rate:g} a second) "
            f"lose up to {100 * loss:.2g} % of a force at {frequency:g} Hz, {100 * LARGEST_LOSS:g} % are allowed; "
            f"{remedy}drive at up to {following.highest():g} Hz"
        )

    def changed(self) -> str:
        """Which part of it is not as it was, so that the load would be taken for less than it is; empty: none."""
        return ", ".join(f"{n} has changed" for n, value in self._fields().items() if self._device.get(n) != value)

    def changes(self) -> list[str]:
        """What somebody has changed that a recovery does not write again, as texts for people."""
        found = []
        for name, value in self._fields().items():
            restored = self._table is not None and name == self._table.field and self._settings.filter is not None
            if not restored and (now := self._device.get(name)) != value:
                found.append(f"{self._device.name}: {name} is {now:g}, was {value:g}")
        return found

    def _fields(self) -> dict[str, float | None]:
        """What the fields of the filter must read."""
        return {self._table.field: self.level, **self._table.needs} if self._table else {}


# --- the driver ----------------------------------------------------------------------------------------

LOOKS = 6  # readings beside those of extremes, which tell that the display still moves
MOVED = 4  # steps of the display that a load must move by, so that not all of these readings can be equal
UNSTEADY, STUCK = "not stable", "display not updated"  # why a reading is not used
AGAIN = 3  # readings that must agree where no bit says that the load is stable


@dataclass(frozen=True, slots=True)
class IndicatorReading:
    """A reading; see `palpate.drivers.roles.Reading`.

    Attributes:
        reading_mV: the reading.
        resolution_mV: step of the display.
        unsteady: why the reading is not stable; empty: it is.
        sick: why no load can be read; empty: it can be read.
        difference: whether it is the difference of two loads, so that it holds no zero.
        u_mV: standard uncertainty from how it was made, beside that of the display.
        doubt: why it is not known that its words come in the order of the map; empty: it is known.
    """

    reading_mV: float
    resolution_mV: float
    unsteady: str
    sick: str
    difference: bool = False
    u_mV: float = 0.0
    doubt: str = ""

    @property
    def stable(self) -> bool:
        return not self.unsteady

    @property
    def valid(self) -> bool:
        return self.stable and not self.sick and math.isfinite(self.reading_mV)


def _range(values: list[float]) -> float:
    """The greatest less the least; NaN if one of them is missing, which might have been either."""
    return max(values) - min(values) if all(map(math.isfinite, values)) else math.nan


class MappedLoadIndicator(EitherBus):
    """A load indicator of a maker.

    Its own unit becomes the mV of the load cell by the setting `span`. What it lacks is made up here: without fields of
    extremes a peak-to-peak value comes from polled readings, and without a bit for it a reading is stable if repeated
    ones agree. A frequency that its readings cannot follow is refused.
    """

    resolution_mV = math.nan
    gage_factor = math.nan
    _settings_of: LoadIndicatorSettings
    _filter: ReadingFilter
    _orders: dict[str, WordOrder]
    _window: float | None = None
    _time_constant = 0.1
    _relative_u = 0.0
    _moving = False  # whether the load has moved since it is read peak to peak
    _step = math.nan  # of its display, in its unit
    _doubt = ""  # of the readings since it was last told what to read

    @property
    def _map(self) -> LoadIndicatorMap:
        assert self.kind is not None
        return self.kind.table(LoadIndicatorMap)

    def set_up(self, settings: LoadIndicatorSettings, watchdog: float) -> None:
        """As for every device; the filter and the display's step are read.

        Raises:
            RangeError: the section sets a filter that the device cannot have, lacks a key that it needs, or has one
                that the device tells itself.
            LinkError, DeviceError: the device does not answer, or reads no step.
        """
        self._take(settings)
        self._filter.set_up()
        self._step = self._shown_step()
        self.resolution_mV = self._step * settings.span
        names = (self._map.reading, *self._map.extremes)
        self._orders = {name: WordOrder(self.contract, name, self._step) for name in names}

    def _take(self, settings: LoadIndicatorSettings) -> None:
        """Take in its section.

        Raises RangeError: a key is missing, tells what the device tells itself, or is no level of the filter.
        """
        table = self._map.filter
        readable = {"bandwidth": bool(table), "resolution": bool(self._map.step)}
        if double := [key for key, read in readable.items() if read and getattr(settings, key) is not None]:
            raise RangeError(f"{self.name}: the device itself tells its {double[0]}; leave it out of its section")
        if settings.filter is not None and (table is None or str(settings.filter) not in table.levels):
            valid = ", ".join(table.levels) if table else "none, as no field of its map sets one: set it there"
            raise RangeError(f"{self.name}: filter = {settings.filter} is no level of its filter; valid: {valid}")
        if not self._map.step and settings.resolution is None:
            raise RangeError(
                f"{self.name}: no field tells the step of its display; write resolution = NUMBER in its section "
                f"({self.contract[self._map.reading].unit or 'in the unit of the display'})"
            )
        self._settings_of, self.gage_factor = settings, settings.gage_factor
        self._filter = ReadingFilter(self, self._map, settings)

    def _shown_step(self) -> float:
        """Step of the display, in its unit. Raises LinkError, DeviceError."""
        role = self._map
        if not role.step:
            assert self._settings_of.resolution is not None  # `_take`
            return self._settings_of.resolution
        value = self.get(role.step)
        step = role.steps.get(f"{value:g}", math.nan) if role.steps else value
        if not step > 0:
            raise DeviceError(f"{self.name}: {role.step} reads {value:g}, which is no step of a display; check the map")
        return step

    def check_section(self, settings: LoadIndicatorSettings, frequency: float) -> None:
        """As for every device; a filter that is not set by the section is known to the device alone."""
        self._take(settings)
        if self._filter.told_by_section:
            self._filter.check_frequency(frequency)

    def check_frequency(self, frequency: float) -> None:
        """As for every device. Raises RangeError: a peak-to-peak reading would lose too much at this frequency [Hz]."""
        self._filter.check_kind()
        self._filter.check_frequency(frequency)
        self._relative_u = self._filter.following.relative_u(frequency)

    def track(self, time_constant: float) -> None:
        """From now on read the load. Its own filter stays; `time_constant` [s] is how long repeated readings take."""
        self._window, self._time_constant, self._moving, self._doubt = None, time_constant, False, ""

    def peak_to_peak(self, window: float) -> None:
        """From now on read the peak-to-peak load over `window` [s], which each reading then takes."""
        self._window, self._moving, self._doubt = window, False, ""

    def clear_tare(self) -> None:
        """Take the tare off, if the device has a command for it."""
        if self._map.clear_tare:
            self.command(self._map.clear_tare)

    def sick(self) -> str:
        """As for every device."""
        found = self._faults(self._status())
        return f"{found}; check the bridge and its wires" if found else ""

    def read(self) -> IndicatorReading:
        """Read the load, or the peak-to-peak load. Raises LinkError, DeviceError."""
        if self._window is None:
            return self._tracked()
        return self._over(self._window)

    def _tracked(self) -> IndicatorReading:
        role = self._map
        value, status = self._load()
        if not role.stable:
            return self._made(value, self._faults(status), self._scatter(value))
        return self._made(value, self._faults(status), "" if says(self._bits(status), role.stable) else UNSTEADY)

    def _scatter(self, first: float) -> str:
        """What tells that repeated readings differ by more than a step of the display; empty: they do not."""
        values = [first]
        for _ in range(AGAIN - 1):
            self.clock.wait(self._time_constant)
            values.append(self._load()[0])
        if _range(values) <= self._step * (1 + 1e-6):
            return ""
        unit = self.contract[self._map.reading].unit
        remedy = "" if self._map.step else "; if the load rests, write a resolution that is no finer than their scatter"
        return f"{AGAIN} readings differ by {_range(values):.2g} {unit}, one step is {self._step:g} {unit}{remedy}"

    def _over(self, window: float) -> IndicatorReading:
        """The greatest less the least load over a window [s] that begins now."""
        extremes = self._map.extremes
        if extremes:
            self.command(self._map.clear)
        first, status = self._load()
        values, sick = [first], self._faults(status)
        for pause in pauses(window, LOOKS) if extremes else pauses(window):
            self.clock.wait(pause)
            load, status = self._load()
            values.append(load)
            sick = sick or self._faults(status)
        value = _range(values)
        if extremes:
            found = self.get_many(*extremes)
            for name, extreme in zip(extremes, found, strict=True):
                self._look(name, extreme)
            value = found[0] - (found[1] if len(extremes) > 1 else 0.0)
        if not sick and self._frozen(value, values):
            sick = STUCK
        u_mV = self._relative_u * abs(value) * self._settings_of.span
        return self._made(value, sick, self._filter.changed(), difference=True, u_mV=u_mV)

    def _frozen(self, value: float, values: list[float]) -> bool:
        """Whether the display stands still although the load moves, or has moved since it is read peak to peak."""
        self._moving = self._moving or abs(value) > MOVED * self._step
        return self._moving and max(values) == min(values)

    def _load(self) -> tuple[float, list[float]]:
        """The load in the device's unit, and its status if it has one."""
        role = self._map
        value, *status = self.get_many(role.reading, *([role.status] if role.status else []))
        self._look(role.reading, value)
        return value, status

    def _look(self, name: str, value: float) -> None:
        """Look whether a field reads a load. A doubt is an incident, once until it is told anew what to read.

        Raises DeviceError: it is none.
        """
        if math.isnan(value):
            return
        doubt = self._orders[name].doubt(value, dict(self._scales.beside(name)), self.name)
        if doubt and not self._doubt:
            self.noticed(doubt)
            self._doubt = doubt

    def _status(self) -> list[float]:
        return [self.get(self._map.status)] if self._map.status else []

    def _bits(self, status: list[float]) -> frozenset[str]:
        return self.contract.set_bits(self._map.status, status[0]) if status else frozenset()

    def _faults(self, status: list[float]) -> str:
        if not status:
            return ""
        set_ = self._bits(status)
        return ", ".join(meaning for bit, meaning in self._map.faults.items() if says(set_, bit))

    def _made(
        self, value: float, sick: str, unsteady: str, difference: bool = False, u_mV: float = 0.0
    ) -> IndicatorReading:
        """A reading from a value in the device's unit."""
        span = self._settings_of.span
        proved = all(order.proved for order in self._orders.values())
        doubt = "" if proved else self._doubt
        return IndicatorReading(value * span, self.resolution_mV, unsteady, sick, difference, u_mV, doubt)

    def differences(self) -> list[str]:
        """As for every device; also a filter, or a step of the display, that somebody has changed."""
        found = super().differences() + self._filter.changes()
        if self._map.step and (step := self._shown_step()) != self._step:
            raise DeviceError(
                f"{self.name}: {self._map.step} says {step:g} {self.contract[self._map.reading].unit}".rstrip()
                + f", said {self._step:g} before, so the display has changed; set it back, or start anew",
                device=self.name,
            )
        return found


# --- ours ----------------------------------------------------------------------------------------------

COMMAND_POLL = 0.01  # s between two polls of a command
COMMAND_POLLS = 100  # greatest number of these polls
DISPLAY = ("status", "decimals", "reading", "reading_float", "updates")  # adjacent fields, read together
UPDATES = 65536  # updates of the display after which their count starts again at 0
COUNTED_NS = 1_000_000_000_000  # ns in which the count grows by less than half of that, so that its order is clear
RENEWAL_NS = 300_000_000  # ns within which the display must have been updated, as it is ten times a second


class StrainIndicator(ModbusDevice):
    """Our strain indicator, which a map does not describe: it finds peak-to-peak values itself, over a window.

    It holds each reading twice, and counts how often its display is renewed, by which an old reply is known.
    """

    contract = STRAIN_INDICATOR
    orders = frozenset({"command"})

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._renewed: tuple[int, float] | None = None
        self.gage_factor = math.nan  # until it is configured
        self.resolution_mV = math.nan
        """Step of the display at the last reading [mV]."""

    def identify(self) -> None:
        """As for every device; after a restart of the indicator its count of updates may be lower than before."""
        super().identify()
        self._renewed = None

    def set_up(self, settings: IndicatorSettings, watchdog: float) -> None:
        """As for every device."""
        self.configure(settings.gage_factor, 1e3 * settings.full_scale)

    def sick(self) -> str:
        """As for every device."""
        sick = self.read().sick
        return f"{sick}; check the bridge and its wires" if sick else ""

    def configure(self, gage_factor: float, full_scale_mV: float) -> None:
        """Set the gage factor, and the reading above which overload is flagged [mV]."""
        self.set(gage_factor=gage_factor, full_scale=full_scale_mV)
        self.gage_factor = gage_factor

    def track(self, time_constant: float) -> None:
        """Follow the load through a one-pole filter with this time constant [s]."""
        self.set(filter=time_constant, mode="track")

    def peak_to_peak(self, window: float) -> None:
        """Read the peak-to-peak load over the last `window` [s]."""
        self.set(filter=window, mode="peak_to_peak")

    def read(self) -> IndicatorReading:
        """Read the display. The device holds the reading twice, and both must agree.

        Raises:
            DeviceError: the integer and the floating-point reading differ, or the count of updates is lower than at the
                last reading, so that the reply is an old one.
        """
        values = self._asked(self._fresh)
        if self._renewed is not None and values[-1] == self._renewed[1]:
            values = self._asked(self._fresh)  # it may be the reply to the last read; this one has another length
        status, decimals, integer, floating, updates = values
        bits = self.contract.set_bits("status", status)
        step = self.resolution_mV = 10.0**-decimals
        reading = integer * step
        if "bridge_open" in bits:
            reading = math.nan
        elif not abs(reading - floating) <= step + 1e-6 * abs(reading):
            raise DeviceError(
                f"{self.name}: reading is {reading:g} mV as an integer and {floating:g} mV as a float, so it is not "
                "used; check the indicator's firmware"
            )
        faults = {"bridge open": "bridge_open" in bits, "overload": "overload" in bits, STUCK: self._stale(updates)}
        sick = ", ".join(fault for fault, raised in faults.items() if raised)
        return IndicatorReading(reading, step, "" if "stable" in bits else UNSTEADY, sick)

    def _fresh(self) -> list[float]:
        values = list(map(self._value, DISPLAY, self._read(DISPLAY)))
        if self._renewed is not None and self.clock.now_ns() - self._renewed[0] < COUNTED_NS:
            before, now = self._renewed[1], values[-1]
            if (now - before) % UPDATES > UPDATES / 2:
                self.link.distrust()
                raise DeviceError(
                    f"{self.name}: its display was updated {now:g} times, but {before:g} times at the reading before; "
                    "the reply is late, or the indicator was restarted, so it is not used"
                )
        return values

    def _stale(self, updates: float) -> bool:
        now = self.clock.now_ns()
        if self._renewed is None or updates != self._renewed[1]:
            self._renewed = now, updates
        return now - self._renewed[0] > RENEWAL_NS

    def clear_tare(self) -> None:
        self.command("clear_tare")

    def command(self, name: str) -> None:
        """Give an order, and wait until it is done. Raises as `set`, and DeviceError: it was refused or is not done."""
        if not self.set(command=name):
            self._await_start(lambda: self.contract.choice("command", self.get("command")) != "idle")
        for _ in range(COMMAND_POLLS):
            pending, last, result = self.get_many("command", "last_command", "command_result")
            if self.contract.choice("command", pending) == "idle":
                break
            self.clock.wait(COMMAND_POLL)
        else:
            raise DeviceError(
                f"{self.name}: {name} was not carried out within {COMMAND_POLL * COMMAND_POLLS:g} s; repeat it, or "
                "restart the indicator"
            )
        outcome = self.contract.choice("command_result", result)
        if self.contract.choice("last_command", last) != name or outcome != "done":
            raise DeviceError(f"{self.name}: {name} ended in {outcome}; wait for a stable reading and repeat it")
