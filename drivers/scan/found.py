"""What a search for devices has found, and how long it may go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, NoReturn

from palpate.drivers.clock import Clock, WallClock
from palpate.drivers.devices.canopen_device import CanopenNode
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink, only_reads
from palpate.instrument.bench.kinds import DeviceKind, LinkKind
from palpate.instrument.bench.links import Link
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkTimeout, UsageError


@dataclass(frozen=True)
class FoundDevice:
    """A device that answers.

    Attributes:
        kind: kind of its link.
        link: its link, with the settings at which it answers.
        unit: its unit id or node id.
        says: what it says of itself; "": nothing.
        serial: its serial number; "": it tells none.
        fits: kinds of device of which all marks or the whole identity fit.
        candidates: kinds that tell nothing by which they are known, and of which it has the registers or objects.
        doubt: why the kind that fits cannot be used as it is, such as another unit than the map's; "": it can.
        simulated: whether it says that it is simulated.
    """

    kind: LinkKind
    link: Link
    unit: int
    says: str = ""
    serial: str = ""
    fits: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    doubt: str = ""
    simulated: bool = False

    @property
    def identified(self) -> bool:
        """Whether one kind alone fits."""
        return len(self.fits) == 1


@dataclass
class Search:
    """A search that goes on: what it has found until now, and what else there is to tell.

    Attributes:
        within: longest time that it may take [s].
        clock: tells how much of it has passed.
        asked: number of addresses that were asked.
        of: number of addresses that will be asked at most.
        progress: called with `asked`, `of` and what is asked now.
        found: devices that answer.
        heard: what was heard at addresses that do not answer properly, as texts for people.
        left: what was not asked, and why, as texts for people.
    """

    within: float = 600.0
    clock: Clock = field(default_factory=WallClock)
    asked: int = 0
    of: int = 0
    progress: Callable[[int, int, str], object] = lambda _asked, _of, _what: None
    found: list[FoundDevice] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    def goes_on(self, what: str) -> bool:
        """Tell what is asked next. False: the time is over, and nothing more is asked."""
        if self.over:
            return False
        self.progress(self.asked, self.of, what)
        self.asked += 1
        return True

    @property
    def over(self) -> bool:
        """Whether its time is over."""
        return self.clock.now_ns() > 1e9 * self.within


# -------------------------------------------------------------------------------------------------------
# Which kinds of device one that answers can be: by the same checks by which a bench knows its devices

UNNAMED = "?"  # a label, so that a device that tells nothing of itself may be asked at all


@dataclass
class Fitting:
    """The kinds that fit; the attributes are those of `FoundDevice`."""

    fits: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    serial: str = ""
    doubt: str = ""


def fitting(kinds: Iterable[DeviceKind], driver: Callable[[DeviceKind], ModbusDevice | CanopenNode]) -> Fitting:
    """The kinds whose marks or identity fit, and those that cannot be told from others.

    Args:
        kinds: kinds that can be on this link.
        driver: makes the generic driver of a kind for the device.
    """
    found = Fitting()
    for kind in kinds:
        device = driver(kind)
        if kind.contract.known_by == "nothing":
            device.inventory = UNNAMED
        try:
            if isinstance(device, CanopenNode):
                device.join()
            device.recognise()
        except (IdentityError, DeviceError, LinkTimeout):
            continue
        if kind.contract.known_by == "nothing":
            found.candidates += (kind.name,)
            continue
        found.fits += (kind.name,)
        try:
            device.identify()
        except BenchError as error:
            found.doubt = str(error)
        found.serial = found.serial or device.serial
    return found


# -------------------------------------------------------------------------------------------------------
# Links over which nothing can be written: a search must not change any device, whatever the code above does


class ReadOnlyModbus(ModbusLink):
    """A link that sends functions 1 to 4 and 43/14 alone, which change nothing. Raises UsageError for all others."""

    def transact(self, who: str, request: Callable[..., Any], *args: object, **timing: Any) -> Any:
        """As `ModbusLink.transact`."""
        if not only_reads(request):
            raise UsageError(f"{who}: a search only reads; {request.__name__} was not sent")
        return super().transact(who, request, *args, **timing)


class ReadOnlyCan(CanLink):
    """A CAN bus on which objects are read alone. Raises UsageError for all else that would be sent."""

    def download(self, who: str, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{who}: a search only reads; no object was written")

    def command(self, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{self.name}: a search only reads; no node was switched to another state")

    def _send(self, cob_id: int, data: bytes) -> NoReturn:
        """Not sent: neither process data nor a heartbeat."""
        raise UsageError(f"{self.name}: a search only reads; no frame {cob_id:03X}h was sent")

    def begin_cycle(self, cob_id: int, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{self.name}: a search only reads; no frame {cob_id:03X}h was sent")
