"""The base of all drivers: it repeats reads that failed, and leaves a broken device alone."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from palpate.drivers.clock import Clock
from palpate.drivers.links.modbus import BASIC, EXTENDED, REGULAR, read_identity
from palpate.instrument.contracts.contract import NOTHING, Command, Condition, Contract, Mark, Value
from palpate.instrument.contracts.field import told_text
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, UsageError

if TYPE_CHECKING:
    from palpate.drivers.links.can import CanLink
    from palpate.drivers.links.modbus import ModbusLink
    from palpate.instrument.bench.kinds import DeviceKind


# --- Memory that endures a limited number of writes: it is never written in a loop ---------------------

MOST, WITHIN = 10, 3600.0  # writes of one field in this time [s]: 10,000 writes then last for six weeks without a pause


class Wear:
    """The writes of a device's fields whose memory wears."""

    def __init__(self, device: str, contract: Contract, clock: Clock) -> None:
        self._device, self._contract, self._clock = device, contract, clock
        self._written: dict[str, deque[int]] = {f.name: deque(maxlen=MOST) for f in contract.fields if f.endures}

    def of(self, names: Collection[str]) -> list[str]:
        """Those of some fields that wear."""
        if not self._written:
            return []
        return [name for name in names if name in self._written]

    def count(self, names: Collection[str]) -> None:
        """Count a write that is about to be sent. Raises DeviceError: too many were; it must not be sent."""
        now = self._clock.now_ns()
        for name in names:
            times = self._written[name]
            if len(times) == MOST and now - times[0] < 1e9 * WITHIN:
                raise DeviceError(
                    f"{self._device}: {name} was written {MOST} times within {WITHIN:g} s, and its memory endures "
                    f"{self._contract[name].endures} writes, so it is not written; write it once, before the run, or "
                    f"wait {WITHIN - 1e-9 * (now - times[0]):.0f} s",
                    device=self._device,
                )
        for name in names:
            self._written[name].append(now)


# -------------------------------------------------------------------------------------------------------
# Scales and units that a device tells by other fields; they must stay as they were when it was identified


class ReadableDevice(Protocol):
    """A device that can be asked for a number."""

    name: str
    contract: Contract

    def get(self, name: str) -> float: ...


class ScalingWatch:
    """What a device has told of its scales and units."""

    def __init__(self, device: ReadableDevice) -> None:
        self._device = device
        fields = device.contract.fields
        self._scales = tuple(dict.fromkeys(f.scaling.told_by for f in fields if f.scaling))
        self._units = {f.unit_in: f.unit for f in fields if f.unit_in}
        self._values_read: dict[str, float] = {}
        self._scaled = {f.name: f.scaling.told_by for f in fields if f.scaling}

    def check(self) -> None:
        """Ask for all of them again. Raises DeviceError: one has changed, or the unit is another than the contract's.

        LinkError: the device does not answer.
        """
        for name in self._scales:
            self.take(name, self._device.get(name))
        for name, unit in self._units.items():
            device = self._device
            found = device.contract.choice(name, device.get(name))
            if found != unit:
                raise DeviceError(
                    f"{device.name}: {name} is {found!r}, the contract reads {unit!r}; set the device to {unit}, or "
                    "use a map for its unit",
                    device=device.name,
                )

    def take(self, name: str, value: float) -> None:
        """Take in what a field reads. Raises DeviceError: it tells a scale, and has changed."""
        if name not in self._scales:
            return
        before = self._values_read.setdefault(name, value)
        if value != before:
            raise DeviceError(
                f"{self._device.name}: {name} is {value:g}, was {before:g} before, so the scale of its readings has "
                f"changed; set it to {before:g} again, or start anew",
                device=self._device.name,
            )

    def scale(self, name: str) -> float:
        """What the field of a scale reads, as it was when it was asked for first. Raises as `check`."""
        if name not in self._values_read:
            self.take(name, self._device.get(name))
        return self._values_read[name]

    def beside(self, name: str) -> Mapping[str, float]:
        """What is needed beside a field's value in order to write it. Raises as `check`."""
        if name not in self._scaled:
            return NOTHING
        told_by = self._scaled[name]
        return {told_by: self.scale(told_by)}

    def encode(self, name: str, value: Value) -> bytes:
        """Wire bytes of a setting. Raises RangeError, and as `check`."""
        contract = self._device.contract
        return contract.encode(name, value, self.beside(name)) if name in self._scaled else contract.encode(name, value)

    def holds(self, name: str, data: bytes, value: Value) -> bool:
        """Whether the bytes of a field hold a setting. Raises as `check`."""
        wanted = self.encode(name, value)
        contract = self._device.contract
        if contract[name].part is None:
            return data == wanted
        return contract.decode(name, data) == contract.decode(name, wanted)


# -------------------------------------------------------------------------------------------------------
# Orders with a handshake: what must come before, what says that they are done, and what must be cleared

POLL, POLLS = 0.01, 100  # least time between two looks at a device [s]; number of looks at a command that takes longer


class Ordered(Protocol):
    """A device that takes orders: its fields can be written and read."""

    name: str
    contract: Contract
    clock: Clock

    def give(self, **values: Value) -> None: ...

    def held(self, name: str) -> float: ...


def carry_out(device: Ordered, name: str) -> None:
    """Give a command once, with those that must come before it, and wait until each is done.

    Raises:
        UnknownName: the contract has no such command; nothing is sent.
        DeviceError: the device refuses one, or has not done it in time; the message names command, state and limit.
        LinkError, LinkTimeout: one is not confirmed; it may have been carried out.
    """
    for each in _in_order(device.contract, name):
        _give(device, each)


def _in_order(contract: Contract, name: str) -> list[Command]:
    """A command behind all that must come before it, each once."""
    found: dict[str, Command] = {}

    def add(wanted: str) -> None:
        command = contract.command(wanted)
        for before in command.after:
            if before not in found:
                add(before)
        found[wanted] = command

    add(name)
    return list(found.values())


def _give(device: Ordered, command: Command) -> None:
    device.give(**{command.field: command.value})
    failure = _await(device, command) if command.done or command.failed else ""
    if command.clear is not None:
        device.give(**{command.field: command.clear})
    if failure:
        raise DeviceError(f"{device.name}: {failure}", device=device.name)


def _await(device: Ordered, command: Command) -> str:
    """Wait until a command is done; returns the text of its refusal, or an empty one.

    Raises DeviceError: it is neither done nor refused in time.
    """
    fields = dict.fromkeys(each.field for each in (command.failed, command.done) if each)
    until = device.clock.now_ns() + round(1e9 * command.seconds)
    while True:
        states = {name: _raw(device, name) for name in fields}  # each once, because some devices clear it when read
        if command.failed and command.failed.holds(states[command.failed.field]):
            return f"refuses the command {command.name!r}: {_shown(command.failed, states)}"
        if command.done and command.done.holds(states[command.done.field]):
            return ""
        left = 1e-9 * (until - device.clock.now_ns())
        if left <= 0:
            break
        device.clock.wait(min(max(POLL, command.seconds / POLLS), left))
    if command.done is None:
        return ""
    wanted = " or ".join(map(str, command.done.values))
    raise DeviceError(
        f"{device.name}: the command {command.name!r} was not done within {command.seconds:g} s: "
        f"{_shown(command.done, states)}, should read {wanted}; look at the device",
        device=device.name,
    )


def _shown(condition: Condition, states: dict[str, float]) -> str:
    masked = "" if condition.mask is None else f" (of which 0x{condition.mask:X} counts)"
    return f"{condition.field} reads {states[condition.field]:.10g}{masked}"


def _raw(device: Ordered, name: str) -> float:
    """What a field reads, as a raw value; NaN if it has no reading."""
    value = device.held(name)
    return device.contract[name].to_raw(value) if math.isfinite(value) else value


# --- the base of the drivers ---------------------------------------------------------------------------

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class DevicePlace:
    """What a driver gets from its bench.

    Attributes:
        link: the link of the device.
        unit: its Modbus unit id, or its CANopen node id.
        settings: the settings of its kind, from its section of the bench file.
        clock: the bench's clock.
        kind: its device kind; None: that of the driver's own contract.
        inventory: its label, which stands for the serial number of a device that tells none; "" otherwise.
    """

    link: Any
    unit: int
    settings: Any
    clock: Clock
    kind: DeviceKind | None = None
    inventory: str = ""


class Device:
    """One device of a bench.

    A read changes nothing, so it is tried up to `read_attempts` times until the answer is valid; `noticed` is called
    with each failure. A write is sent once.

    A driver for one map has a class attribute `contract`. One for many maps has none: it gets that of its place's kind.
    """

    contract: Contract
    link: ModbusLink | CanLink
    kind: DeviceKind | None = None
    inventory = ""
    orders: frozenset[str] = frozenset()  # fields that make the device do something

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        """Make the driver of a device, not connected yet; one whose constructor takes more arguments overrides this."""
        driver: Any = cls
        return cls._fitted(driver(place.link, place.unit, place.clock, *cls._own(place)), place)

    def __init__(self, where: str, clock: Clock, contract: Contract | None = None) -> None:
        """Make a driver, not connected yet.

        Args:
            where: its place, for people.
            clock: the bench's clock.
            contract: None: that of the class.
        """
        if contract is not None:
            self.contract = contract
        self.name = f"{self.contract.title} {where}"
        self.clock = clock
        self.orders = self.orders | {command.field for command in self.contract.commands}
        self._settings: dict[str, Value] = {}  # those that were written, by name
        self._scales = ScalingWatch(self)
        self._wear = Wear(self.name, self.contract, clock)
        self.serial = ""
        self.simulated = False
        self.broken = ""  # why it is no longer used; empty: it is used
        self.read_attempts = 1
        self.noticed: Callable[[str], object] = lambda _incident: None
        self.afterwards: Callable[[], object] = lambda: None  # called after each request

    @classmethod
    def _fitted(cls, made: Self, place: DevicePlace) -> Self:
        """A driver with what its place says of it."""
        made.kind, made.inventory = place.kind, place.inventory
        return made

    @classmethod
    def _own(cls, place: DevicePlace) -> tuple[Contract, ...]:
        """The contract of its place's kind, if the class has none. Raises UsageError: there is neither."""
        if hasattr(cls, "contract"):
            return ()
        if place.kind is None:
            raise UsageError(f"{cls.__name__} has no contract of its own; give its place a kind")
        return (place.kind.contract,)

    def get(self, name: str) -> float:
        """Physical value of a field, in the contract's unit; NaN: it has no reading. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def get_many(self, *names: str) -> list[float]:
        """Physical values of several fields, as `get`."""
        return [self.get(name) for name in names]

    def held(self, name: str) -> float:
        """Value of a field, which may be outside the limits. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def get_text(self, name: str) -> str:
        """Content of a text field. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def give(self, /, **values: Value) -> None:
        """Write fields, once: in one request on Modbus, in which they must stand together; one by one on CANopen.

        Raises RangeError, UsageError before anything is sent; LinkError, DeviceError.
        """
        raise NotImplementedError

    def command(self, name: str) -> None:
        """Give an order of the contract, and wait until it is done; see `palpate.drivers.devices.device`."""
        carry_out(self, name)

    def identify(self) -> None:
        """Check that the contract's device answers, and the same one as before. Raises IdentityError, LinkError."""
        raise NotImplementedError

    def connect(self) -> None:
        """Get ready to use the device; its link is open. Raises as `identify` does."""
        self.identify()

    def set_up(self, settings: Any, watchdog: float) -> None:
        """Write the settings of its section, and the bench's watchdog time-out [s]. Raises LinkError, DeviceError."""

    def check_section(self, settings: Any, frequency: float) -> None:
        """Check by its section of the bench file alone that it can work with a load of a frequency [Hz].

        It is called before the device is opened. Raises RangeError, ConfigError: it cannot, or the section lacks a key.
        """

    def check_frequency(self, frequency: float) -> None:
        """Check that it can work with a load of this frequency [Hz], before anything moves. Raises RangeError."""

    def sick(self) -> str:
        """Why it cannot be used although it answers and holds its settings; empty: it can be used."""
        return ""

    def differences(self) -> list[str]:
        """The settings that it no longer holds, as texts for people. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def restore(self) -> None:
        """Write lost settings again. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def notices(self) -> list[str]:
        """Its reports since the last call, as texts for people."""
        return []

    def _same(self, serial: str) -> str:
        """Check that a serial number is the same as before, and return it. Raises IdentityError: it is another one."""
        if self.serial not in ("", serial):
            raise IdentityError(
                f"{self.name}: has serial number {serial or 'none'}, had {self.serial} before; put the first one back, "
                "or run again"
            )
        return serial

    def _value(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> float:
        """Physical value of a field from its bytes. Raises DeviceError: it is outside the limits, or no choice."""
        value = self._decoded(name, data, beside)
        if fault := self.contract.misread(name, value):
            raise DeviceError(
                f"{self.name}: reads {fault}; not used. Set it within its limits, or look at its firmware"
            )
        return value

    def _decoded(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> float:
        """Physical value of a field from its bytes, within its limits or not. Raises DeviceError: there is none."""
        try:
            return self.contract.decode(name, data, beside)
        except KeyError:
            raise DeviceError(
                f"{self.name}: tells a scale of {name} that the contract does not know ({dict(beside)}); not used. "
                "Check the map of this device"
            ) from None
        except (ValueError, struct.error) as error:
            raise DeviceError(f"{self.name}: {name} cannot be used: {error}. Check the map of this device") from None

    def _asked(self, question: Callable[[], T]) -> T:
        for attempt in range(1, self.read_attempts + 1):
            try:
                return self._ordered(question)
            except BenchError as error:
                if self.broken or attempt == self.read_attempts:
                    raise
                self.noticed(f"{error}; asked again")
        raise AssertionError("it is asked once or more")

    def _ordered(self, order: Callable[[], T]) -> T:
        """The result of a request; an error gets the device's name."""
        try:
            if self.broken:
                raise DeviceError(f"{self.broken}; it is not used any more in this run")
            answer = order()
        except BenchError as error:
            error.device = self.name
            raise
        self.afterwards()
        return answer


# --- How a device is known: by its identity objects, by marks in its fields, or by a person alone ------

VENDOR, PRODUCT, REVISION, APPLICATION, SERIAL = 0, 1, 2, 6, 0x80  # numbers of identity objects


def identity_objects(transact: Callable[..., Any]) -> dict[int, str]:
    """Identity objects by number (function 43/14); lower categories are asked for if the extended one leaves them out.

    `transact` sends a request with its arguments but the unit. Raises LinkError, LinkTimeout, DeviceError.
    """

    def category(number: int) -> dict[int, str]:
        reply = transact(read_identity, number)
        return {k: told_text(v) for k, v in getattr(reply, "information", {}).items()}

    objects = category(EXTENDED)
    if VENDOR not in objects:
        objects |= category(BASIC) | category(REGULAR)
    return objects


def check_objects(device: Device, objects: Mapping[int, str]) -> None:
    """Check identity objects, by number, against the contract.

    Raises:
        IdentityError: another vendor, product or major version.
    """
    expected = device.contract.identity
    found = (objects.get(VENDOR, ""), objects.get(PRODUCT, ""), objects.get(REVISION, ""))
    wanted = (expected.vendor, expected.product, expected.revision)
    major = (*found[:2], found[2].split(".")[0])
    if any(text and given != text for given, text in zip(major, (*wanted[:2], wanted[2].split(".")[0]), strict=True)):
        raise IdentityError(
            f"{device.name}: identifies itself as {' '.join(found).strip() or 'nothing'}, the contract is for "
            f"{' '.join(wanted).strip()}; check the address and unit id in the bench file"
        )


def check_marks(device: Device) -> None:
    """Check that each mark of the contract fits.

    Raises:
        IdentityError: another device answers; the message names what was found and wanted.
        LinkError, LinkTimeout: none answers.
    """
    for mark in device.contract.marks:
        found = _found(device, mark)
        fits = found.startswith(str(mark.value)) if isinstance(found, str) else _equal(device, mark, found)
        if not fits:
            shown = repr(found) if isinstance(found, str) else f"{found:.10g}"
            raise IdentityError(
                f"{device.name}: {mark.field} reads {shown}, should "
                + (f"begin with {mark.value!r}" if isinstance(mark.value, str) else f"be {mark.value:.10g}")
                + "; this is another device or firmware: check the address in the bench file",
                device=device.name,
            )


def _equal(device: Device, mark: Mark, found: float) -> bool:
    f = device.contract[mark.field]
    return found == found and f.to_raw(found) == f.to_raw(float(mark.value))


def _found(device: Device, mark: Mark) -> float | str:
    try:
        return device.get_text(mark.field) if isinstance(mark.value, str) else device.held(mark.field)
    except DeviceError as error:
        raise IdentityError(
            f"{device.name}: cannot read {mark.field}, by which it is known ({error}); this is another device or "
            "firmware: check the address in the bench file",
            device=device.name,
        ) from None


def check_inventory(device: Device) -> None:
    """Check that the bench file names a device that tells nothing of itself, and that one answers at its address.

    Raises:
        IdentityError: the bench file does not name it.
        LinkError, LinkTimeout: none answers.
    """
    if not device.inventory:
        raise IdentityError(
            f'{device.name}: tells nothing by which it is known; write inventory = "LABEL" in its section of the bench '
            "file, as it is labelled",
            device=device.name,
        )
    readable = [f.name for f in device.contract.fields if f.access != "wo" and f.type != "text" and not f.beside]
    if readable:
        device.held(readable[0])


def serial_number(device: Device) -> str:
    """Its serial number from the field that the contract names, or its label. Raises LinkError, DeviceError."""
    name = device.contract.serial
    if not name:
        return device.inventory
    if device.contract[name].type == "text":
        return device.get_text(name)
    return f"{device.held(name):.20g}"
