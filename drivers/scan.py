"""Finds out which devices answer on TCP addresses, serial lines and CAN buses, by reading alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

from palpate.drivers.clock import Clock, WallClock
from palpate.drivers.devices.canopen_device import CanopenNode
from palpate.drivers.devices.device import APPLICATION, PRODUCT, REVISION, VENDOR, identity_objects
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.can import LISTEN_ONLY, SET_BY_SYSTEM, CanLink, Heard, has_wire, listen, listens_quietly
from palpate.drivers.links.causes import SEARCH
from palpate.drivers.links.modbus import ModbusLink, only_reads, read_registers
from palpate.instrument.bench.description import can_be_asked
from palpate.instrument.bench.kinds import DeviceKind, LinkKind
from palpate.instrument.bench.links import CanBus, Link, SerialLine, TcpLink
from palpate.instrument.contracts.declaration import ITSELF
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkError, LinkTimeout, UsageError

# --- what is found -------------------------------------------------------------------------------------


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


# --- CAN -----------------------------------------------------------------------------------------------


DEVICE_TYPE, NAME, HARDWARE, IDENTITY = 0x1000, 0x1008, 0x1009, 0x1018
REMEDY = "add --talk if this is its bit rate, or if nothing else is on the bus"


def scan_can(
    search: Search,
    buses: Sequence[CanBus],
    nodes: Sequence[int],
    kinds: Sequence[DeviceKind],
    *,
    seconds: float,
    talk: bool,
) -> None:
    """Search a CAN bus.

    Nothing is sent before frames were heard without an error, which proves the bit rate, unless `talk` allows it. A bus
    without a wire needs no proof.

    Args:
        search: what is added to.
        buses: the same bus with the bit rates to try, the likeliest first.
        nodes: node ids to ask.
        kinds: kinds of device that are compared.
        seconds: how long each bit rate is listened to [s].
        talk: whether nodes are asked although nothing proves the bit rate.

    Raises UsageError: this interface cannot listen without taking part, or which bit rate to talk at is not clear.
    """
    check_allowed(buses, talk=talk)
    chosen, heard = _heard(search, buses, seconds)
    if chosen is None and (talk or not has_wire(buses[0])):
        chosen = buses[0]
    if chosen is None:
        search.left.append(f"{_name(buses[0])}: no node was asked, because nothing proves the bit rate; {REMEDY}")
        return
    link = ReadOnlyCan(chosen)
    try:
        link.open()
    except LinkError as error:
        search.heard.append(str(error))
        return
    try:
        for node in [*sorted(heard.nodes), *(each for each in nodes if each not in heard.nodes)]:
            if not search.goes_on(f"{_name(chosen)} node {node}"):
                return
            try:
                found = _asked(link, chosen, node, kinds)
            except LinkTimeout:
                if node in heard.nodes:
                    search.heard.append(f"{_name(chosen)} node {node}: sends, but answers no SDO upload")
                continue
            except LinkError as error:
                search.heard.append(str(error))
                return
            search.found.append(found)
    finally:
        with suppress(BenchError):
            link.close()


def check_allowed(buses: Sequence[CanBus], *, talk: bool) -> None:
    """Raises UsageError as `scan_can`, before anything is opened."""
    first = buses[0]
    if not talk and not listens_quietly(first):
        raise UsageError(
            f"{_name(first)}: this interface cannot be told only to listen, and a wrong bit rate disturbs a live bus; "
            f"give the right one with --bitrates, and --talk (those that listen: {', '.join(sorted(LISTEN_ONLY))}, "
            f"{', '.join(SET_BY_SYSTEM)})"
        )
    if talk and len(buses) > 1:
        raise UsageError(f"{_name(first)}: --talk speaks at one bit rate; give the right one alone with --bitrates")


def _heard(search: Search, buses: Sequence[CanBus], seconds: float) -> tuple[CanBus | None, Heard]:
    """The bus with the bit rate at which frames come without an error, and what was heard; None: there is none."""
    if not listens_quietly(buses[0]):
        return None, Heard()  # a person has told its bit rate
    for bus in buses:
        where = f"{_name(bus)} at {bus.bitrate} bit/s"
        if not search.goes_on(f"{where}: listening"):
            search.left.append(f"{where}: the time was over")
            continue
        try:
            heard = listen(bus, seconds)
        except LinkError as error:
            search.heard.append(str(error))
            break
        if heard.frames and not heard.errors:
            return bus, heard
        what = f"{heard.errors} error frames and {heard.frames} others" if heard.errors else "nothing"
        if has_wire(bus):
            search.heard.append(f"{where}: heard {what} in {seconds:g} s")
    return None, Heard()


def _asked(link: ReadOnlyCan, at: CanBus, node: int, kinds: Sequence[DeviceKind]) -> FoundDevice:
    """The node of an id. Raises LinkTimeout: none answers; LinkError: the bus failed."""
    asked = link.add_node(node)

    def read(index: int, subindex: int = 0) -> bytes:
        with suppress(DeviceError, LinkTimeout):
            return link.upload(f"node {node}", asked, index, subindex)
        return b""

    with suppress(DeviceError):  # a node that aborts answers
        link.upload(f"node {node}", asked, DEVICE_TYPE, 0)
    answers = _self_description(read)
    simulated = read(HARDWARE) == b"simulated"
    own = [kind for kind in kinds if kind.contract.bus == "canopen"]
    fit = fitting(own, lambda kind: CanopenNode(link, node, WallClock(), kind.contract))
    return FoundDevice("canopen", at, node, answers, fit.serial, fit.fits, fit.candidates, fit.doubt, simulated)


def _self_description(read: Callable[..., bytes]) -> str:
    """What a node says of itself: its name, device type and identity."""
    words = [read(NAME).decode("ascii", "replace").rstrip("\0")]
    numbers = [("type", read(DEVICE_TYPE))]
    numbers += [
        (what, read(IDENTITY, part)) for part, what in enumerate(("vendor", "product", "revision", "serial"), 1)
    ]
    words += [f"{what} {int.from_bytes(data, 'little'):X}h" for what, data in numbers if data]
    return " ".join(filter(None, words))


def _name(bus: CanBus) -> str:
    return f"{bus.interface}:{bus.channel}"


# --- Modbus --------------------------------------------------------------------------------------------


# units that are asked where no other answers: some devices reply at 0 on a line, as they leave the factory
LAST: dict[LinkKind, tuple[int, ...]] = {"modbus-tcp": ITSELF, "modbus-rtu": (0,)}
FEWEST = 3  # units of a TCP address; if as many answer alike, it is one device that looks at no unit id


@dataclass
class ModbusSearch:
    """Asks one unit id after the other on one link.

    Attributes:
        search: what it adds to.
        link: the link.
        at: its address, for the bench file.
        where: the link's name with its settings, for people.
        kinds: kinds of device that are compared.
    """

    search: Search
    link: ReadOnlyModbus
    at: TcpLink | SerialLine
    where: str
    kinds: Sequence[DeviceKind]
    _came: bytes = field(default=b"", init=False)
    _reported: set[str] = field(default_factory=set, init=False)

    def __post_init__(self) -> None:
        """Keep what comes in answer to a request."""
        self.link.section = SEARCH if isinstance(self.at, TcpLink) else f"--line {self.at.port}"
        self.link.tap(self._tapped)

    def _tapped(self, sent: bool, data: bytes) -> None:
        self._came = b"" if sent else data

    def over(self, units: Sequence[int]) -> list[FoundDevice]:
        """The devices that answer at these unit ids or, where none does, at one of `LAST`.

        Raises LinkError: the link cannot be opened, or is lost.
        """
        found: list[FoundDevice] = []
        self.link.open()
        try:
            last = [unit for unit in LAST[self._link_kind] if unit not in units]
            for unit in (*units, *last):
                if unit in last and found:
                    self.search.of -= 1
                    continue
                if not self.search.goes_on(f"{self.where} unit {unit}"):
                    break
                if self._answers(unit):
                    found.append(self._described(unit))
                    self.search.found.append(found[-1])
        finally:
            self.link.close()
        return found

    def _answers(self, unit: int) -> bool:
        """Whether a device answers; an exception response is an answer, too, unless a gateway says that there is none.

        Raises LinkError: the link is lost.
        """
        self._came = b""
        try:
            self.link.transact(f"{self.where} unit {unit}", read_registers, 0, 1, unit, busy=0.0)
        except DeviceError:
            return True
        except LinkError as error:
            if error.code:
                return False
            if not isinstance(error, LinkTimeout):
                raise
            if self._came:
                self._tell(unit, str(error).partition("; ")[2])
            return False
        return True

    def _tell(self, unit: int, why: str) -> None:
        """Tell once, at the first unit, what came instead of a reply; `why`: what is wrong with it on TCP."""
        if isinstance(self.at, SerialLine):
            why = (
                f"{len(self._came)} bytes came that are no valid reply ({self._came[:8].hex(' ')}): noise, an echo, "
                "another baud rate or parity, or two devices at this unit id"
            )
        elif (what := why.partition(" came")[0]) in self._reported:
            return
        else:
            self._reported.add(what)
        self.search.heard.append(f"{self.where} unit {unit}: {why}")

    def _described(self, unit: int) -> FoundDevice:
        name = f"{self.where} unit {unit}"
        objects: dict[int, str] = {}
        silent = False
        try:
            objects = identity_objects(lambda request, category: self.link.transact(name, request, category, unit))
        except LinkTimeout:
            silent = True  # it does not even refuse function 43/14
        except DeviceError:
            pass
        own = [kind for kind in self.kinds if self._possible(kind, unit, identified=not silent)]
        fit: Fitting = fitting(own, lambda kind: ModbusDevice(self.link, unit, WallClock(), kind.contract))
        return FoundDevice(
            self._link_kind,
            self.at,
            unit,
            " ".join(filter(None, (objects.get(number, "") for number in (VENDOR, PRODUCT, REVISION)))),
            fit.serial,
            fit.fits,
            fit.candidates,
            fit.doubt,
            objects.get(APPLICATION) == "simulated",
        )

    @property
    def _link_kind(self) -> LinkKind:
        return "modbus-tcp" if isinstance(self.at, TcpLink) else "modbus-rtu"

    def _possible(self, kind: DeviceKind, unit: int, *, identified: bool) -> bool:
        identifiable = identified or kind.contract.known_by != "identity"
        return (
            kind.contract.bus == "modbus"
            and self._link_kind in kind.links
            and identifiable
            and can_be_asked(kind, isinstance(self.at, TcpLink), unit)
        )


def scan_tcp(search: Search, at: TcpLink, units: Sequence[int], kinds: Sequence[DeviceKind]) -> None:
    """Search a TCP address. Nobody there is told in `search.heard`."""
    where = f"{at.host}:{at.port}"
    first = len(search.found)
    try:
        found = ModbusSearch(search, ReadOnlyModbus.tcp(at), at, where, kinds).over(units)
    except LinkError as error:
        search.heard.append(str(error))
        return
    alike = len({replace(each, unit=0) for each in found}) == 1
    if len(found) == len(units) >= FEWEST and alike:
        search.heard.append(
            f"{where}: units {units[0]} to {units[-1]} all answer alike"
            + (", so this is one device that looks at no unit id" if found[0].serial else "; is it one device?")
        )
        if found[0].serial:
            search.found[first:] = found[:1]


def scan_line(
    search: Search,
    lines: Sequence[SerialLine],
    units: Sequence[int],
    kinds: Sequence[DeviceKind],
    *,
    every: bool,
) -> None:
    """Search a serial line with several settings, the likeliest first.

    Args:
        search: what is added to.
        lines: the same port with the settings to try.
        units: unit ids to ask.
        kinds: kinds of device that are compared.
        every: whether the other settings are tried, too, when devices answer at one.
    """
    for number, line in enumerate(lines):
        where = f"{line.port} at {setting_of(line)}"
        if search.over:
            search.left.append(f"{where}: the time was over")
            continue
        try:
            found = ModbusSearch(search, ReadOnlyModbus.rtu(line), line, where, kinds).over(units)
        except LinkError as error:
            search.heard.append(f"{where}: {error}")
            if not Path(line.port).exists():
                return
            continue  # not every port takes every parity
        if found and not every:
            search.of -= (len(units) + 1) * len(lines[number + 1 :])
            search.left += [
                f"{line.port} at {setting_of(other)}: devices answer at {setting_of(line)}"
                for other in lines[number + 1 :]
            ]
            return


def setting_of(line: SerialLine) -> str:
    """The settings of a line as people write them, such as 9600 8N1."""
    return f"{line.baudrate} 8{line.parity}{line.stopbits}"


USUAL = ((9600, "N", 1), (19200, "E", 1), (115200, "N", 1), (19200, "N", 1), (38400, "N", 1))


def settings(
    kinds: Sequence[DeviceKind], baudrates: Sequence[int], parities: Sequence[str]
) -> list[tuple[int, str, int]]:
    """Baud rate, parity and stop bits to try, the likeliest first: those with which most known devices are delivered.

    Args:
        kinds: the known kinds of device.
        baudrates: baud rates to try; none: the usual ones.
        parities: parities to try; none: the usual ones.
    """
    delivered = [kind.map.line for kind in kinds if kind.map is not None and kind.map.line.baudrate]
    counted = Counter((line.baudrate or 9600, line.parity or "N", line.stopbits or 1) for line in delivered)
    usual_first = list(dict.fromkeys([each for each, _ in counted.most_common()] + list(USUAL)))
    if not baudrates and not parities:
        return usual_first
    wanted = [
        next((each for each in usual_first if each[:2] == (rate, parity)), (rate, parity, 1))
        for rate in baudrates or dict.fromkeys(each[0] for each in usual_first)
        for parity in parities or ("N", "E", "O")
    ]
    return sorted(wanted, key=lambda each: usual_first.index(each) if each in usual_first else len(usual_first))
