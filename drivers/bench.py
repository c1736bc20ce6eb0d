"""The whole bench: opens what the bench file lists, checks each identity, and ends with outputs off."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from types import FrameType, TracebackType
from typing import Any, Self, TypeVar, get_args

from palpate.drivers.bench_lock import BenchLock, check_apart
from palpate.drivers.clock import BenchClock, WallClock
from palpate.drivers.devices.device import Device, DevicePlace
from palpate.drivers.devices.exciter import Amplified, Exciter, WatchdogGuard
from palpate.drivers.incident import Incidents, Store
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.ownership import cautions, claim
from palpate.drivers.roles import Bias, Chamber, LoadIndicator, Positioner, ProbeStage, SampleChanger, role_of
from palpate.drivers.safe_end import held, insist, taken
from palpate.drivers.watched_clock import WatchedClock
from palpate.instrument.additions import load
from palpate.instrument.bench import links as files
from palpate.instrument.bench.description import DRIVING, READ_ATTEMPTS, BenchDescription, Listed, filling
from palpate.instrument.bench.kinds import DeviceKind, Role
from palpate.instrument.bench.operator import Operator, mount_anew
from palpate.instrument.errors import (
    BenchError,
    ConfigError,
    DeviceError,
    LinkError,
    SettingsLost,
    UnknownName,
    UsageError,
)
from palpate.instrument.own_process import Ends
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import Sample

# --- The links and devices of a bench, made from its description, and the roles that they fill ---------

T = TypeVar("T")
UNOPENED: dict[str, files.Link] = {
    "modbus-tcp": files.TcpLink(host="unopened"),
    "modbus-rtu": files.SerialLine(port="unopened"),
    "canopen": files.CanBus(interface="virtual", channel="unopened"),
}  # links that are never opened, by kind


class Fitted:
    """The drivers of all devices of a bench, in the order in which they are set up and checked.

    Attributes:
        description: the description of the bench.
        links: the links, by their names in the bench file.
        clock: the bench's clock, which watches the exciter while the bench drives.
        absent: for each optional device that is not used, the reason.
    """

    def __init__(self, description: BenchDescription, clock: BenchClock) -> None:
        """Raises ConfigError: the driver of a listed device cannot be loaded, or does not fit its role."""
        self.description = description
        self.links = {name: _link(place, clock) for name, place in description.links.items()}
        self.absent: list[str] = []
        devices = description.devices
        self._listed = {each.name: each for each in devices}
        for name, link in self.links.items():
            link.section = f"[link.{name}]"
            link.devices = {each.unit: f"[device.{each.name}]" for each in devices if each.link == name}
        self._filling = {role: [each.name for each in filling(role, devices)] for role in get_args(Role)}
        self.clock = WatchedClock(clock)
        self._devices = {each.name: self._made(each) for each in devices}
        self._exciter = self._driven()
        if self._exciter is not None:
            self.clock.look_after(self._exciter, description.watchdog)

    def _made(self, each: Listed) -> Device:
        """The driver of a device. Raises ConfigError: it cannot be loaded."""
        driver: type[Device] = load(each.kind.driver, f"driver of {each.name}")
        return driver.at(
            DevicePlace(self.links[each.link], each.unit, each.settings, self.clock, each.kind, each.inventory)
        )

    def _driven(self) -> Exciter | None:
        """The exciter; None: the bench has none. Raises ConfigError: its driver does not fit."""
        exciter, source, amplifier = (
            next((self._devices[name] for name in self._filling[role]), None) for role in DRIVING
        )
        found: Any = exciter
        if exciter is None and source is not None and amplifier is not None:
            found = Amplified(source, amplifier)
        if found is None:
            return None
        if not isinstance(found, Exciter):
            raise ConfigError(f"{found.name}: its driver is no palpate.drivers.roles.Exciter; mend its package")
        if (found.guard is None) != self.description.unguarded:
            raise ConfigError(
                f"{found.members[0].name}: driver and contract do not agree whether it has a watchdog; mend its package"
            )
        return found

    @property
    def devices(self) -> list[Device]:
        """The drivers of all devices in use."""
        return list(self._devices.values())

    def device(self, name: str) -> Any:
        """The device of a section of the bench file. Raises UnknownName: there is none, or it is absent."""
        if name not in self._devices:
            raise UnknownName("device of this bench", name, self._devices)
        return self._devices[name]

    def named(self, device: object) -> Listed:
        """The entry of a device in the bench file. Raises UsageError: it is no device of this bench."""
        for name, each in self._devices.items():
            if each is device:
                return self._listed[name]
        raise UsageError(f"{device!r} is no device of this bench; give one of its `devices`")

    def all(self, kind: type[T]) -> list[T]:
        """The devices that fill a role, or whose driver is of this class."""
        role: Any = role_of(kind)
        if kind is Exciter:
            return [self._exciter] if self._exciter is not None else []  # type: ignore[list-item]
        if role is None:
            return [each for each in self.devices if isinstance(each, kind)]
        return [self._devices[name] for name in self._filling[role] if name in self._devices]  # type: ignore[misc]

    def maybe(self, kind: type[T]) -> T | None:
        """The device that fills a role; None: there is none."""
        return next(iter(self.all(kind)), None)

    def role(self, kind: type[T]) -> T:
        """The device that fills a role, which is a class of `palpate.drivers.roles`; the first if several fill it.

        Raises BenchError: no device fills it.
        """
        found = self.maybe(kind)
        if found is None:
            what = role_of(kind) or kind.__name__
            raise BenchError(
                f"bench {self.description.name} has no {what}; add a device whose kind fills this role to its file"
            )
        return found

    def fills(self, role: Role) -> bool:
        """Whether a device in use fills a role."""
        return any(name in self._devices for name in self._filling[role])

    def leave_out(self, part: Device | ModbusLink | CanLink, why: Exception) -> bool:
        """Go on without a device or link if all devices that need it are optional; returns whether they are."""
        needing = [name for name, device in self._devices.items() if part in (device, device.link)]
        if not all(self._listed[name].optional for name in needing):
            return False
        for name in needing:
            del self._devices[name]
            self.absent.append(f"{name} is not used: {why}")
        return True


def check_drivable(description: BenchDescription, frequency: float) -> None:
    """Check, by the bench file alone, that a bench can have a load of a frequency [Hz]; nothing is opened.

    Raises:
        RangeError: a device cannot work with it, or its section lacks a key.
        BenchError: the bench lacks a device that a load needs.
        ConfigError: the driver of a device cannot be loaded or does not fit its role, or a section lacks a key.
    """
    fitted = Fitted(description, WallClock())
    for needed in (Exciter, LoadIndicator, Positioner):
        fitted.role(needed)
    for device in fitted.devices:
        device.check_section(fitted.named(device).settings, frequency)


def check_alone(name: str, kind: DeviceKind, settings: Any, frequency: float) -> None:
    """As `check_drivable`, for one device of a simulated bench, which has no address before the bench is open."""
    clock = WallClock()
    driver: type[Device] = load(kind.driver, f"driver of {name}")
    device = driver.at(DevicePlace(_link(UNOPENED[kind.links[0]], clock), 1, settings, clock, kind))
    device.name = name
    device.check_section(settings, frequency)


def _link(place: files.Link, clock: BenchClock) -> ModbusLink | CanLink:
    """A link, closed. What it waits between frames is not watched, so it gets the clock that keeps the time."""
    if isinstance(place, files.CanBus):
        return CanLink(place, clock.stepper)
    if isinstance(place, files.SerialLine):
        return ModbusLink.rtu(place, clock, clock.stepper)
    return ModbusLink.tcp(place, clock, clock.stepper)


# --- The operator of a bench with devices that do some of a person's work ------------------------------


class Hands:
    """A `palpate.instrument.bench.operator.Operator` that passes each task to a device or else to the person.

    The device is looked up at each task, because an optional device may be left out when the bench is opened.
    """

    def __init__(self, person: Operator, bench: Fitted) -> None:
        self._person, self._bench = person, bench
        self._warmed: Any = None  # the chamber, once it was told to warm
        self.place_weight = person.place_weight
        self.turn_load_cell = person.turn_load_cell

    def mount(self, sample: Sample) -> None:
        if changer := self._bench.maybe(SampleChanger):
            changer.mount(sample.name)
        else:
            self._person.mount(sample)

    def mount_anew(self, sample: Sample) -> None:
        """As `mount`, for a sample that may lie there already. A changer leaves it alone then."""
        if self._bench.maybe(SampleChanger):
            self.mount(sample)
        else:
            mount_anew(self._person, sample)

    def lay_on_support(self, sample: Sample | None) -> None:
        self._free_changer()
        self._person.lay_on_support(sample)

    def press_tooth(self, tooth: int) -> None:
        self._free_changer()
        self._person.press_tooth(tooth)

    def place_probe(self, x: float, y: float) -> None:
        (self._bench.maybe(ProbeStage) or self._person).place_probe(x, y)

    def set_temperature(self, kelvin: float) -> None:
        if chamber := self._bench.maybe(Chamber):
            self._warmed = chamber
            chamber.warm(kelvin)
        else:
            self._person.set_temperature(kelvin)

    def confirm_device(self, what: str, label: str) -> None:
        self._person.confirm_device(what, label)

    @property
    def has_warmed(self) -> bool:
        """Whether a chamber was told to warm the sensor."""
        return self._warmed is not None

    def chamber_off(self, within: float) -> str:
        """Switch off the chamber that has warmed the sensor; returns a message if that fails, else an empty text.

        `within`: time for which that is tried again [s].
        """
        self._warmed.broken = ""
        for failure in insist([self._warmed.off], self._bench.clock, within):
            return f"{self._warmed.name} could not be switched off: {failure}; switch it off by hand, now"
        return ""

    def _free_changer(self) -> None:
        if changer := self._bench.maybe(SampleChanger):
            changer.leave()


# --- the bench -----------------------------------------------------------------------------------------

RECOVERY = 1.0  # s that devices get to come back
LONGEST_END = 5.0  # s for which switching off is tried again; with a shorter watchdog, until that has switched off
TERMINATIONS = (signal.SIGTERM, signal.SIGHUP)  # SIGHUP: the terminal was closed
ENDINGS = (signal.SIGINT, *TERMINATIONS)


class Bench(Fitted):
    """All devices of a bench, as a context manager.

    On entry every device is opened and identified, the exciter first, and the outputs go to zero. On every way out,
    also by SIGINT, SIGTERM and SIGHUP, they go to zero again, and a chamber that has warmed the sensor is switched off.
    If that fails, or the program is killed, the exciter's watchdog switches the output off, if it has one.
    """

    def __init__(self, description: BenchDescription, clock: BenchClock, operator: Operator) -> None:
        """Raises ConfigError: the driver of a listed device cannot be loaded, or does not fit its role."""
        super().__init__(description, clock)
        self.force_limit = description.force_limit
        self._hands = Hands(operator, self)
        self.operator: Operator = self._hands
        self.incidents = Incidents(self.clock)
        self.attended = False
        self.waits: Callable[[str], object] = lambda _why: None  # called with the reason before a wait for others
        # called with a bench time before [ns] and what the films show: "films", "rate" [Hz], "voltage" (films, n) [V]
        self.sampled: Callable[[int, Mapping[str, object]], object] = lambda _bench_ns, _shown: None
        self._safe = True
        for device in self.devices:
            if device not in self._guarding:
                device.afterwards = self.clock.feed_in_time
        self.is_open = False
        self._stack = Ends()

    @property
    def _guard(self) -> WatchdogGuard | None:
        return self._exciter.guard if self._exciter else None

    @property
    def _guarding(self) -> tuple[Any, ...]:
        """The guard as a device, if there is one."""
        return self._exciter.members[:1] if self._exciter and self._exciter.guard else ()

    @property
    def simulated(self) -> bool:
        """Whether any device, or the bench file, says that it is simulated."""
        return self.description.simulated or any(device.simulated for device in self.devices)

    def __enter__(self) -> Self:
        with Ends() as stack:
            check_apart(self.description)
            stack.enter_context(BenchLock(self.description))
            self._confirm_devices()
            stack.enter_context(taken(TERMINATIONS, _terminate))
            members = self._exciter.members if self._exciter else ()
            opened = []
            for number, device in enumerate(members):
                if device.link not in opened:
                    self._open(device.link, stack)
                    opened.append(device.link)
                device.connect()
                if number == 0:
                    self._take_over(stack)
            stack.push(self._make_safe)
            for link in self.links.values():
                if link not in opened:
                    self._while_there(partial(self._open, link, stack), link)
            for device in self.devices:
                if device not in members:
                    self._while_there(device.connect, device)
            if self._exciter:
                self._exciter.quiet()
            for device in self.devices:
                device.set_up(self.named(device).settings, self.description.watchdog)
            stack.push(self._switch_chamber_off)
            stack.push(self._switch_biases_off)
            self._stack = stack.pop_all()
        self.is_open = True
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it as `ClosedBench`, because nobody else can use its links."""
        return ClosedBench, (self.description, self.simulated)

    @property
    def elsewhere(self) -> bool:
        """Whether this process is a child that was forked from the one that opened the bench."""
        return self._stack.elsewhere

    def check_process(self) -> None:
        """Raises BenchError: this process is a child that was forked from the one that opened the bench."""
        self._stack.check()

    def _confirm_devices(self) -> None:
        """Let a person confirm each device that tells nothing by which it is known. Raises BenchError: nobody does."""
        for each in self._listed.values():
            if each.unknowable and not each.confirmed:
                title = each.kind.contract.title
                self.operator.confirm_device(f"{each.name} ({title}, {each.unit} on {each.link})", each.inventory)

    def _while_there(self, step: Callable[[], object], of: Device | ModbusLink | CanLink) -> None:
        """Do a step; if it gets no answer and only optional devices need it, go on without these devices."""
        try:
            step()
        except LinkError as error:
            if not self.leave_out(of, error):
                raise

    def _take_over(self, stack: ExitStack) -> None:
        """Become the guard's owner, keep its watchdog fed, and stop a bench that was left driving.

        This comes first, so that the bench is stopped even if another device cannot be opened. Raises BenchInUse.
        """
        if self._guard is not None:
            claim(self._guard, self.clock, self.waits)
            stack.callback(self._release, self._guard)
        stack.enter_context(self.clock.beating())
        if self._exciter:
            self._exciter.halt()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.is_open = False
        self._stack.__exit__(kind, error, trace)  # a second call does nothing, because the stack is empty

    def _open(self, link: ModbusLink | CanLink, stack: ExitStack) -> None:
        link.open()
        stack.callback(link.close)

    def _release(self, guard: WatchdogGuard) -> None:
        if self._safe:
            with suppress(BenchError), held(ENDINGS):  # its output is off, and nobody feeds its watchdog any more
                guard.release()

    @property
    def cautions(self) -> list[str]:
        """Notes for a person before the bench drives: absent devices, outputs that could stay on, unusual forces."""
        left_on = [
            f"{bias.name}: has no watchdog, so that it stays on when this program is killed; stay beside it"
            for bias in self.all(Bias)
        ]
        stood = self.description.withstands
        limit = f"force limit {show(self.force_limit, 'N')}: its bench file says that this bench stands"
        strong = [] if stood is None else [f"{limit} {show(stood, 'N')}"]
        return [*self.absent, *cautions(self._exciter), *left_on, *strong]

    def drive(self) -> None:
        """Switch the outputs on at zero amplitude, and start watching them. Raises DeviceError: a fault is latched."""
        self.role(Exciter).drive()
        self.clock.watching = True

    def rest(self) -> None:
        """Bring the outputs to zero."""
        self.clock.watching = False
        if self._exciter:
            self._exciter.rest()

    def attend(self, store: Store) -> None:
        """From now on recover from failures where that is safe, and record each incident with `store` as it happens.

        Without this call the first failure is raised, because a recovery must be recorded.
        """
        self.attended = True
        self.incidents.tell(store)
        for device in self.devices:
            device.read_attempts, device.noticed = READ_ATTEMPTS, self.incidents.note

    @property
    def driving(self) -> bool:
        """Whether the outputs are on."""
        return self.clock.watching

    @property
    def broken(self) -> list[str]:
        """The reasons why devices are no longer used."""
        return [device.broken for device in self.devices if device.broken]

    def declare_broken(self, error: BenchError) -> None:
        """Mark the failed device as broken: later steps use it only to switch it off."""
        for device in self.devices:
            if device.name == error.device and not device.broken:
                device.broken = str(error)
                self.incidents.note(f"{device.name}: is broken")

    def check_frequency(self, frequency: float) -> None:
        """Check that all devices can work with a load of this frequency [Hz]. Raises RangeError: one cannot."""
        for device in self.devices:
            device.check_frequency(frequency)

    def check_settings(self) -> None:
        """Check that all devices still hold their settings, and note what they have reported.

        Raises:
            SettingsLost: a device does not hold its settings.
            LinkError, DeviceError: a device does not answer.
        """
        for device in self.devices:
            for notice in device.notices():
                self.incidents.note(notice)
        for link in self.links.values():
            if isinstance(link, CanLink) and (errors := link.error_frames()):  # this comes before the nodes are asked
                self.incidents.note(f"{link.name}: {errors} error frames")
        for device in self.devices:
            if found := device.differences():
                raise SettingsLost(f"{'; '.join(found)}; look at the device", device=device.name)

    def recover(self) -> None:
        """Bring the outputs to zero, identify every device again, and restore lost settings.

        Raises:
            SafetyError: the exciter has tripped.
            IdentityError: another device answers at the address of one.
            LinkError, DeviceError: a device does not answer, or does not keep its settings; or the indicator cannot
                read a load.
        """
        self.clock.watching = False
        self._switch_off()
        self.clock.wait(RECOVERY)
        self.rest()
        if self._exciter:
            self._exciter.check()
        for device in self.devices:
            device.identify()
            if self._guard is not None and device in self._guarding:
                claim(self._guard, self.clock, self.waits)
            lost = device.differences()
            device.restore()
            for found in lost:
                self.incidents.note(f"{found}; written again")
        for device in self.devices:
            if sick := device.sick():
                raise DeviceError(f"{device.name}: {sick}", device=device.name)

    def _make_safe(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Switch off by every means, even if some fail; signals are ignored meanwhile."""
        self.clock.watching = False
        self.incidents.hold()
        for device in self._exciter.members if self._exciter else ():
            device.broken = ""
        with held(ENDINGS):
            failures = self._switch_off(min(self.description.watchdog, LONGEST_END))
        self._safe = not failures
        if failures:
            watchdog = f"The watchdog drops the output within {self.description.watchdog:g} s; check by eye"
            remedy = watchdog if self._guard else "It has no watchdog: switch it off by hand, now"
            _tell(f"outputs could not all be switched off: {'; '.join(failures)}. {remedy}", error)
        elif (
            error is not None and not isinstance(error, Exception) and not any(bias.holding for bias in self.all(Bias))
        ):
            error.add_note("the outputs are off")  # for somebody who stands at the bench and pressed Ctrl-C

    def _switch_chamber_off(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Switch off a chamber that has warmed the sensor, after the outputs and before its link is closed."""
        if self._hands.has_warmed:
            self.clock.watching = False
            with held(ENDINGS):
                self._switch_off()  # `_make_safe` does it again, and tells what failed
                failure = self._hands.chamber_off(LONGEST_END)
            if failure:
                _tell(failure, error)

    def _switch_biases_off(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Switch off each source that holds a value, after the outputs and before its link is closed."""
        for bias in self.all(Bias):
            if not bias.holding:
                continue
            self.clock.watching = False
            with held(ENDINGS):
                self._switch_off()
                bias.broken = ""
                for failure in insist([bias.off], self.clock, LONGEST_END):
                    _tell(f"{bias.name} could not be switched off: {failure}; switch it off by hand, now", error)

    def _switch_off(self, within: float = 0.0) -> list[str]:
        """Switch off in every way; see `insist`."""
        return insist(self._exciter.means(), self.clock, within) if self._exciter else []


@dataclass(frozen=True)
class ClosedBench:
    """What a pickled result keeps of the bench on which it was measured."""

    description: BenchDescription
    simulated: bool
    is_open = False


def _tell(message: str, error: BaseException | None) -> None:
    """Raise a message about the end of a bench, or add it to the error that ends the bench. Raises BenchError."""
    if error is None:
        raise BenchError(message)
    error.add_note(message)


def _terminate(number: int, _frame: FrameType | None) -> None:
    """End the program on SIGTERM and SIGHUP by an exception, so that the outputs go to zero."""
    raise SystemExit(128 + number)
