"""The whole bench: opens what the bench file lists, checks each identity, and ends with outputs off."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from functools import partial
from types import FrameType, TracebackType
from typing import Any, Self, TypeVar, get_args

from palpate.drivers.bench_lock import BenchLock
from palpate.drivers.clock import BenchClock
from palpate.drivers.devices.device import READ_ATTEMPTS, Device, Place
from palpate.drivers.devices.exciter import Amplified, Exciter
from palpate.drivers.hands import Hands
from palpate.drivers.incident import Incidents, Store
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.roles import Chamber, ProbeStage, SampleChanger, role_of
from palpate.drivers.safe_end import held, taken
from palpate.drivers.watched_clock import WatchedClock
from palpate.instrument.additions import load
from palpate.instrument.bench import description as files
from palpate.instrument.bench.description import BenchDescription, Listed, SerialLine
from palpate.instrument.bench.kinds import Role
from palpate.instrument.bench.operator import Operator
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    LinkError,
    SettingsLost,
    UnknownName,
)

RECOVERY = 1.0  # s, that devices are given to come back
CLAIMS = 10  # that are tried within the time of the watchdog
TERMINATIONS = (signal.SIGTERM, signal.SIGHUP)  # a closed terminal hangs up
DRIVING: tuple[Role, ...] = ("exciter", "source", "amplifier")
ENDINGS = (signal.SIGINT, *TERMINATIONS)


T = TypeVar("T")


class Bench:
    """All devices of a bench, as a context manager.

    On entry every device is opened and identified, the guard of what drives first, and its outputs go to zero. On every
    way out, SIGINT, SIGTERM and SIGHUP included, they go to zero again; where that fails, or the program is killed, the
    guard's watchdog drops the output.
    """

    def __init__(self, description: BenchDescription, clock: BenchClock, operator: Operator) -> None:
        """Raises ConfigError: the driver of a listed device cannot be loaded."""
        self.description = description
        self.force_limit = description.force_limit
        self.links = {name: _link(place) for name, place in description.links.items()}
        self._listed = {each.name: each for each in description.devices}
        self._filling = {role: [each.name for each in description.filling(role)] for role in get_args(Role)}
        self._devices: dict[str, Device] = {}
        driving = [self._listed[name] for role in DRIVING for name in self._filling[role]]
        self._make(driving, clock)
        self._exciter = self._driven()
        self.clock = WatchedClock(clock, self._exciter.guard if self._exciter else None, description.watchdog)
        self._make(self._listed.values(), self.clock)
        self._devices = {name: self._devices[name] for name in self._listed}
        hands = self.maybe(SampleChanger), self.maybe(Chamber), self.maybe(ProbeStage)
        self.operator: Operator = Hands(operator, *hands) if any(hands) else operator
        self.absent: list[str] = []  # why an optional device is not used
        self.incidents = Incidents(self.clock)
        self.attended = False
        self.waits: Callable[[str], object] = lambda _why: None  # told before it has to wait for somebody else
        self._safe = True
        members = self._exciter.members if self._exciter else ()
        for device in self.devices:
            if device not in members[:1]:
                device.afterwards = self.clock.feed_in_time
        self.is_open = False
        self._stack = ExitStack()

    def _make(self, listed: Iterable[Listed], clock: Any) -> None:
        """The drivers of devices that have none yet. Raises ConfigError."""
        for each in listed:
            if each.name not in self._devices:
                driver = load(each.kind.driver, f"driver of {each.name}")
                self._devices[each.name] = driver.at(Place(self.links[each.link], each.unit, each.settings, clock))

    def _driven(self) -> Exciter | None:
        """What drives; None: nothing does."""
        exciter, source, amplifier = (self._in_role(role) for role in DRIVING)
        if exciter is not None:
            assert isinstance(exciter, Exciter)
            return exciter
        return Amplified(source, amplifier) if source is not None and amplifier is not None else None

    @property
    def devices(self) -> list[Device]:
        """Those that are there, in the order in which they are set up and looked at."""
        return list(self._devices.values())

    def device(self, name: str) -> Any:
        """The device of a section of the bench file. Raises UnknownName: there is none, or it is absent."""
        if name not in self._devices:
            raise UnknownName("device of this bench", name, self._devices)
        return self._devices[name]

    def named(self, device: Device) -> Listed:
        """What the bench file says of a device."""
        return next(self._listed[name] for name, each in self._devices.items() if each is device)

    def all(self, kind: type[T]) -> list[T]:
        """The devices that fill a role, or whose driver is of this class."""
        role: Any = role_of(kind)
        if kind is Exciter:
            return [self._exciter] if self._exciter is not None else []  # type: ignore[list-item]
        if role is None:
            return [each for each in self.devices if isinstance(each, kind)]
        return [self._devices[name] for name in self._filling[role] if name in self._devices]  # type: ignore[misc]

    def maybe(self, kind: type[T]) -> T | None:
        """As `role`, or None: nobody fills it."""
        return next(iter(self.all(kind)), None)

    def role(self, kind: type[T]) -> T:
        """The device that fills a role, one of `palpate.drivers.roles`; the first where several do.

        Raises BenchError: nobody fills it.
        """
        found = self.maybe(kind)
        if found is None:
            what = role_of(kind) or kind.__name__
            raise BenchError(f"bench {self.description.name} has no {what}; list a device in its file that can be one")
        return found

    def _in_role(self, role: Role) -> Any:
        return next((self._devices[name] for name in self._filling[role]), None)

    @property
    def simulated(self) -> bool:
        """Whether any device says that it is simulated."""
        return any(device.simulated for device in self.devices)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(BenchLock(self.description))
            stack.enter_context(taken(TERMINATIONS, _terminate))
            members = self._exciter.members if self._exciter else ()
            opened = []
            for number, device in enumerate(members):
                if device.link not in opened:
                    self._open(device.link, stack)
                    opened.append(device.link)
                device.connect()
                if number == 0:
                    self._claim()
                    stack.callback(self._release)
                    stack.enter_context(self.clock.beating())
                    self.guard.disable()  # a bench that was left driving stops, whatever cannot be opened next
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
            self._stack = stack.pop_all()
        self.is_open = True
        return self

    def _while_there(self, step: Callable[[], object], of: Device | ModbusLink | CanLink) -> None:
        """Do this; where the devices that it needs are all optional and do not answer, go on without them."""
        try:
            step()
        except LinkError as error:
            needing = [name for name, device in self._devices.items() if of in (device, device.link)]
            if not all(self._listed[name].optional for name in needing):
                raise
            for name in needing:
                del self._devices[name]
                self.absent.append(f"{name} is not used: {error}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.is_open = False
        self._stack.__exit__(kind, error, trace)  # the second time nothing is left of it

    def _open(self, link: ModbusLink | CanLink, stack: ExitStack) -> None:
        link.open()
        stack.callback(link.close)

    @property
    def guard(self) -> Any:
        """The device that has the watchdog. Raises BenchError: nothing drives."""
        return self.role(Exciter).guard

    def _claim(self) -> None:
        """Become the guard's owner; the claim of a program that was killed ends after the watchdog's time.

        Raises BenchInUse: another program owns it and is alive; nothing has been changed.
        """
        guard = self.guard
        if guard.claim():
            return
        watchdog = guard.get("watchdog")
        self.waits(
            f"{guard.name}: belongs to another program, or to one that was killed; waiting {watchdog:g} s, "
            "after which a killed one's claim ends"
        )
        piece = watchdog / CLAIMS
        for _ in range(CLAIMS):
            self.clock.wait(piece)
            if guard.claim():
                return
        raise BenchInUse(f"{guard.name}: belongs to another program, which feeds its watchdog; wait for it or end it")

    def _release(self) -> None:
        if self._safe:
            with suppress(BenchError), held(ENDINGS):  # its output is off, and nobody feeds its watchdog any more
                self.guard.release()

    @property
    def cautions(self) -> list[str]:
        """What a person should know before the bench drives."""
        if self._exciter is None or self.guard.owned:
            return self.absent
        return [
            *self.absent,
            f"{self.guard.name}: any request feeds its watchdog, so that whoever else reads it keeps its output on "
            "when this program dies; see that nobody does",
        ]

    def drive(self) -> None:
        """Enable the amplifier and close the generator's output, at zero amplitude; watching starts.

        Raises:
            DeviceError: a fault is latched; see `ShakerAmplifier.clear_faults`.
        """
        self.role(Exciter).drive()
        self.clock.watching = True

    def rest(self) -> None:
        """Outputs to zero: amplitude, output relay, amplifier."""
        self.clock.watching = False
        if self._exciter:
            self._exciter.rest()

    def attend(self, store: Store) -> None:
        """From now on what fails is made good where that is safe, and each incident stored by `store` as it happens.

        Without a record of it nothing is made good: the first failure is raised.
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
        """Why devices are not used any more."""
        return [device.broken for device in self.devices if device.broken]

    def declare_broken(self, error: BenchError) -> None:
        """No later step uses the device that failed, but to switch it off."""
        for device in self.devices:
            if device.name == error.device and not device.broken:
                device.broken = str(error)
                self.incidents.note(f"{device.name}: is broken")

    def check_settings(self) -> None:
        """See that all devices hold what was written, and note what they have told of themselves.

        Raises:
            SettingsLost: one does not. LinkError, DeviceError: one does not answer.
        """
        for device in self.devices:
            for notice in device.notices():
                self.incidents.note(notice)
        for link in self.links.values():
            if isinstance(link, CanLink) and (errors := link.error_frames()):  # before the nodes' answers have come
                self.incidents.note(f"{link.name}: {errors} error frames")
        for device in self.devices:
            if found := device.differences():
                raise SettingsLost(f"{'; '.join(found)}; look at the device", device=device.name)

    def recover(self) -> None:
        """Outputs to zero; then every device is identified again and gets the settings that it has lost.

        Raises:
            SafetyError: the amplifier has tripped. IdentityError: another device stands in the place of one.
            LinkError, DeviceError: one does not answer, or does not take its settings; the indicator reads no load.
        """
        self.clock.watching = False
        self._switch_off()
        self.clock.wait(RECOVERY)
        self.rest()
        if self._exciter:
            self.guard.check()
        for device in self.devices:
            device.identify()
            if self._exciter and device is self.guard:
                self._claim()
            lost = device.differences()
            device.restore()
            for found in lost:
                self.incidents.note(f"{found}; written again")
        for device in self.devices:
            if sick := device.sick():
                raise DeviceError(f"{device.name}: {sick}", device=device.name)

    def _make_safe(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Switch off by every means there is, whatever fails; signals meanwhile are ignored."""
        self.clock.watching = False
        self.incidents.hold()
        for device in self._exciter.members if self._exciter else ():
            device.broken = ""
        with held(ENDINGS):
            failures = self._switch_off()
        self._safe = not failures
        if failures:
            message = (
                "outputs could not all be switched off: "
                + "; ".join(failures)
                + f". The amplifier's watchdog drops its output within {self.description.watchdog:g} s; check by eye"
            )
            if error is None:
                raise BenchError(message)
            error.add_note(message)

    def _switch_off(self) -> list[str]:
        return self._exciter.switch_off() if self._exciter else []


def _link(place: files.Link) -> ModbusLink | CanLink:
    if isinstance(place, files.CanLink):
        return CanLink(place)
    return ModbusLink.rtu(place) if isinstance(place, SerialLine) else ModbusLink.tcp(place)


def _terminate(number: int, _frame: FrameType | None) -> None:
    """SIGTERM and SIGHUP take the same way out as everything else."""
    raise SystemExit(128 + number)
