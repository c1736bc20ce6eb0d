"""Searches Modbus TCP addresses and serial lines for devices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.drivers.clock import WallClock
from palpate.drivers.devices.device import APPLICATION, PRODUCT, REVISION, VENDOR, identity_objects
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.causes import SEARCH
from palpate.drivers.links.modbus import read_registers
from palpate.drivers.scan.found import Fitting, FoundDevice, ReadOnlyModbus, Search, fitting
from palpate.instrument.bench.description import can_be_asked
from palpate.instrument.bench.kinds import DeviceKind, LinkKind
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.declaration import ITSELF
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout

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
    _told: set[str] = field(default_factory=set, init=False)

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
        elif (what := why.partition(" came")[0]) in self._told:
            return
        else:
            self._told.add(what)
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
        known = identified or kind.contract.known_by != "identity"
        return (
            kind.contract.bus == "modbus"
            and self._link_kind in kind.links
            and known
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
        baudrates: baud rates to try; none: the likely ones.
        parities: parities to try; none: the likely ones.
    """
    delivered = [kind.map.line for kind in kinds if kind.map is not None and kind.map.line.baudrate]
    counted = Counter((line.baudrate or 9600, line.parity or "N", line.stopbits or 1) for line in delivered)
    likely = list(dict.fromkeys([each for each, _ in counted.most_common()] + list(USUAL)))
    if not baudrates and not parities:
        return likely
    wanted = [
        next((each for each in likely if each[:2] == (rate, parity)), (rate, parity, 1))
        for rate in baudrates or dict.fromkeys(each[0] for each in likely)
        for parity in parities or ("N", "E", "O")
    ]
    return sorted(wanted, key=lambda each: likely.index(each) if each in likely else len(likely))
