"""A search for devices, as it is asked for, and the setting of a CANopen device's node id and bit rate (LSS)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from palpate.drivers.bench_lock import BenchLock
from palpate.drivers.links.can import BIT_TIMING, CanLink, LssAddress, selected
from palpate.drivers.scan import LAST, Search, check_allowed, scan_can, scan_line, scan_tcp, settings
from palpate.instrument.bench.kinds import DeviceKind, all_kinds, check_identities, kind_in_file
from palpate.instrument.bench.links import CanBus, Link, SerialLine, TcpLink
from palpate.instrument.config import check
from palpate.instrument.contracts.declaration import ITSELF
from palpate.instrument.errors import BenchError, DeviceError, LinkTimeout, RangeError, UsageError

BITRATES = (1_000_000, 500_000, 250_000, 125_000)
RATES = re.compile(r"[1-9]\d{0,6}")
ADDRESS = re.compile(r"(?P<host>\[[^\]]+\]|[^:\[\]]+)(:(?P<port>\d{1,5}))?")
ON_A_LINE, ON_CAN = ({*range(1, 248)}, "1 to 247"), ({*range(1, 128)}, "1 to 127")  # addresses that can be asked
ON_TCP = ({*range(248), *ITSELF}, "0 to 247 and 255")
TIMEOUTS = (1e-3, 10.0)  # s
PER_UNIT = 2  # time-outs that a unit costs that does not answer: the second makes sure that the line is silent


@dataclass
class ScanPlan:
    """What a search asks.

    Attributes:
        search: what it finds.
        kinds: kinds of device that are compared.
        tcp: addresses on TCP.
        lines: for each serial port, the settings to try.
        buses: the CAN bus with the bit rates to try; none: no bus.
        units: unit ids on Modbus.
        nodes: node ids on CANopen.
        every: whether all settings of a line are tried.
        talk: whether nodes are asked although nothing proves the bit rate.
        listen: how long each bit rate is listened to [s].
        timeout: time in which an answer must begin [s].
    """

    search: Search
    kinds: list[DeviceKind]
    tcp: list[TcpLink]
    lines: list[list[SerialLine]]
    buses: list[CanBus]
    units: list[int]
    nodes: list[int]
    every: bool
    talk: bool
    listen: float
    timeout: float
    links: dict[str, Link] = field(init=False)

    def __post_init__(self) -> None:
        """Name each link once, as those of a bench. Raises UsageError: one is given twice."""
        each: list[Link] = [*self.tcp, *(lines[0] for lines in self.lines), *self.buses[:1]]
        if len({str(link) for link in each}) < len(each):
            raise UsageError("an address or a port is given twice; give it once")
        if not each:
            raise UsageError("nothing to search; give --tcp HOST, --line PORT or --can INTERFACE:CHANNEL")
        self.links = {str(number): link for number, link in enumerate(each)}

    @classmethod
    def asked(
        cls,
        *,
        tcp: Sequence[str],
        lines: Sequence[str],
        can: str | None,
        units: str,
        nodes: str,
        baudrates: str | None,
        parities: str | None,
        every: bool,
        bitrates: str | None,
        listen: float,
        talk: bool,
        timeout: float,
        within: float,
        maps: Iterable[Path],
    ) -> Self:
        """Read the arguments of the command. Raises UsageError, RangeError, ConfigError: one is wrong."""
        for option, given, (least, most) in (
            ("--timeout", timeout, TIMEOUTS), ("--listen", listen, (0.01, 600.0)), ("--within", within, (1.0, 86400.0)),
        ):  # fmt: skip
            if not least <= given <= most:
                raise RangeError(f"{option} {given:g} s is outside {least:g} s to {most:g} s; give one inside")
        kinds = [*map(kind_in_file, maps), *all_kinds()]  # of those that could be it, a map of one's own is told first
        check_identities(kinds)
        tried = settings(kinds, _rates("--baudrates", baudrates), _parities(parities))
        buses = []
        if can is not None:
            interface, _, channel = can.partition(":")
            rates = _rates("--bitrates", bitrates) or _likely(kinds, interface)
            buses = [
                check(
                    {"interface": interface, "channel": channel, "bitrate": rate, "timeout": f"{timeout} s"},
                    CanBus,
                    f"--can {can}",
                )
                for rate in rates
            ]
        return cls(
            Search(within),
            kinds,
            [_tcp(text, timeout) for text in tcp],
            [[_line(port, each, timeout) for each in (tried[:1] if "://" in port else tried)] for port in lines],
            buses,
            _numbers("--units", units, ON_A_LINE if lines else ON_TCP),
            _numbers("--nodes", nodes, ON_CAN),
            every,
            talk,
            listen,
            timeout,
        )

    @property
    def questions(self) -> int:
        """Greatest number of addresses that are asked."""
        return self._units + (len(self.buses) + len(self.nodes) if self.buses else 0)

    @property
    def _units(self) -> int:
        """Greatest number of units that are asked."""
        on_tcp, on_a_line = (len({*self.units, *last}) for last in (LAST["modbus-tcp"], LAST["modbus-rtu"]))
        return on_tcp * len(self.tcp) + on_a_line * sum(map(len, self.lines))

    @property
    def seconds(self) -> float:
        """Time if nobody answers, which is the longest but for what devices that answer are asked [s]."""
        units = self._units * PER_UNIT * self.timeout
        nodes = len(self.buses) * self.listen + len(self.nodes) * self.timeout if self.buses else 0.0
        return min(units + nodes, self.search.within)

    def go(self) -> None:
        """Search. Raises UsageError: nothing was opened; BenchInUse: another program uses an address."""
        if self.buses:
            check_allowed(self.buses, talk=self.talk)
        self.search.of = self.questions
        with BenchLock(self):
            for address in self.tcp:
                scan_tcp(self.search, address, self.units, self.kinds)
            for lines in self.lines:
                scan_line(self.search, lines, self.units, self.kinds, every=self.every)
            if self.buses:
                scan_can(self.search, self.buses, self.nodes, self.kinds, seconds=self.listen, talk=self.talk)
        if self.search.over:
            self.search.left.append(f"the rest: the search took {self.search.within:g} s; raise --within")


def _likely(kinds: Sequence[DeviceKind], interface: str) -> list[int]:
    """Bit rates to listen at, the likeliest first; one for a bus of which the system sets the bit rate."""
    from palpate.drivers.links.can import SET_BY_SYSTEM

    if interface in SET_BY_SYSTEM:
        return [BITRATES[0]]
    delivered = [kind.map.line.bitrate for kind in kinds if kind.map is not None and kind.map.line.bitrate]
    return list(dict.fromkeys([*sorted(delivered, key=lambda rate: -delivered.count(rate)), *BITRATES]))


def _tcp(text: str, timeout: float) -> TcpLink:
    found = ADDRESS.fullmatch(text)
    if found is None:
        raise UsageError(f"--tcp {text!r} is no address; give HOST or HOST:PORT, as 192.168.1.20:502")
    table: dict[str, Any] = {"host": found["host"].strip("[]"), "timeout": f"{timeout} s"}
    return check(table | ({"port": int(found["port"])} if found["port"] else {}), TcpLink, f"--tcp {text}")


def _line(port: str, setting: tuple[int, str, int], timeout: float) -> SerialLine:
    rate, parity, stopbits = setting
    table = {"port": port, "baudrate": rate, "parity": parity, "stopbits": stopbits, "timeout": f"{timeout} s"}
    return check(table, SerialLine, f"--line {port}")


def _rates(option: str, text: str | None) -> list[int]:
    parts = [] if text is None else [part.strip() for part in text.split(",")]
    if wrong := [part for part in parts if not RATES.fullmatch(part)]:
        raise UsageError(f"{option}: {wrong[0]!r} is no rate in bit/s; give a list such as 9600,19200")
    return list(dict.fromkeys(map(int, parts)))


def _parities(text: str | None) -> list[str]:
    parts = [] if text is None else [part.strip() for part in text.split(",")]
    if wrong := [part for part in parts if part not in ("N", "E", "O")]:
        raise UsageError(f"--parities: {wrong[0]!r} is no parity; give a list of N, E and O")
    return list(dict.fromkeys(parts))


def _numbers(option: str, text: str, allowed: tuple[set[int], str]) -> list[int]:
    """Numbers of a list such as 1-8,16. Raises UsageError."""
    found: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,3})\s*(?:-\s*(\d{1,3}))?\s*", part)
        asked = range(int(ends[1]), int(ends[2] or ends[1]) + 1) if ends else range(0)
        if not asked or not allowed[0].issuperset(asked):
            why = "; 0 is asked by itself where no other answers" if 0 in asked and allowed is ON_A_LINE else ""
            raise UsageError(f"{option}: {part.strip()!r} is not within {allowed[1]}, as 1-8,16{why}")
        found += asked
    return list(dict.fromkeys(found))


# --- Gives a CANopen device a node id or a bit rate (LSS), after a person has agreed -------------------

DEVICE_TYPE = 0x1000


@dataclass
class Change:
    """A change of a device's node id or bit rate.

    Attributes:
        bus: the bus, at the bit rate that it has now.
        address: the device.
        node: node id to set; None: it stays.
        bitrate: bit rate to set [bit/s]; None: it stays.
        save: whether the device keeps both when it is switched off.
    """

    bus: CanBus
    address: LssAddress
    node: int | None
    bitrate: int | None
    save: bool
    links: dict[str, Link] = field(init=False)

    def __post_init__(self) -> None:
        """Raises UsageError, RangeError: there is nothing to set, or it cannot be set so."""
        if self.node is None and self.bitrate is None:
            raise UsageError("nothing to set; give --node or --to-bitrate")
        if self.node is not None and not 1 <= self.node <= 127:
            raise RangeError(f"--node {self.node} is outside 1 to 127; give one inside")
        if self.bitrate is not None and self.bitrate not in BIT_TIMING:
            raise RangeError(f"--to-bitrate {self.bitrate}: LSS knows {', '.join(map(str, BIT_TIMING))}")
        if self.bitrate is not None and not self.save:
            raise UsageError(
                "--to-bitrate: a device takes a new bit rate when it is switched on again, so it has to keep it: give "
                "--save, too"
            )
        self.links = {"can": self.bus}

    @classmethod
    def asked(
        cls, *, can: str, at: int, address: LssAddress, node: int | None, bitrate: int | None, save: bool
    ) -> Self:
        """Read the arguments of the command. Raises UsageError, RangeError, ConfigError."""
        interface, _, channel = can.partition(":")
        bus = check({"interface": interface, "channel": channel, "bitrate": at}, CanBus, f"--can {can}")
        return cls(bus, address, node, bitrate, save)

    def __str__(self) -> str:
        """What will be done, for the person who agrees to it."""
        parts = [f"node id {self.node}"] if self.node is not None else []
        parts += [f"{self.bitrate} bit/s"] if self.bitrate is not None else []
        kept = "and keeps it when it is switched off" if self.save else "until it is switched off"
        return f"device {self.address} on {self.bus.interface}:{self.bus.channel} gets {' and '.join(parts)}, {kept}"

    def carry_out(self, agreed: Callable[[str], object]) -> int | None:
        """Make the change; returns the node id that the device had, None: it had none.

        Args:
            agreed: called with what will be done before anything is written; raises where a person does not agree.

        Raises BenchError: the device does not answer or refuses, or the node id is taken; UsageError.
        """
        link = CanLink(self.bus)
        with BenchLock(self):
            link.open()
            try:
                with selected(link, self.address, self.bus.timeout) as device:
                    before = device.node_id()
                if self.node is not None and self.node != before:
                    self._check_free(link, self.node)
                agreed(f"{self} (it has {'no node id' if before is None else f'node id {before}'} now)")
                with selected(link, self.address, self.bus.timeout) as device:
                    if self.node is not None:
                        device.set_node_id(self.node)
                    if self.bitrate is not None:
                        device.set_bitrate(self.bitrate)
                    if self.save:
                        device.save()
                return before
            finally:
                with suppress(BenchError):
                    link.close()

    def _check_free(self, link: CanLink, node: int) -> None:
        """Raises DeviceError: another device answers as this node."""
        try:
            with suppress(DeviceError):  # a node that refuses answers, too
                link.upload(f"node {node}", link.add_node(node), DEVICE_TYPE, 0)
        except LinkTimeout:
            return
        raise DeviceError(f"node {node} answers already on {link.name}; give another --node, nothing was written")
