"""The links and devices of a bench, made from its description, and the roles that they fill."""

from __future__ import annotations

from typing import Any, TypeVar, get_args

from palpate.drivers.clock import BenchClock, WallClock
from palpate.drivers.devices.device import Device, DevicePlace
from palpate.drivers.devices.exciter import Amplified, Exciter
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.roles import LoadIndicator, Positioner, role_of
from palpate.drivers.watched_clock import WatchedClock
from palpate.instrument.additions import load
from palpate.instrument.bench import links as files
from palpate.instrument.bench.description import DRIVING, BenchDescription
from palpate.instrument.bench.kinds import DeviceKind, Role
from palpate.instrument.bench.listed import Listed, filling
from palpate.instrument.errors import BenchError, ConfigError, UnknownName, UsageError

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
        return CanLink(place)
    return ModbusLink.rtu(place, clock) if isinstance(place, files.SerialLine) else ModbusLink.tcp(place, clock)
