"""Searches a CAN bus for CANopen nodes: it listens first, then reads objects of the nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from palpate.drivers.clock import WallClock
from palpate.drivers.devices.canopen_device import CanopenNode
from palpate.drivers.links.can import LISTEN_ONLY, SET_BY_SYSTEM, Heard, has_wire, listen, listens_quietly
from palpate.drivers.scan.found import FoundDevice, ReadOnlyCan, Search, fitting
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.bench.links import CanBus
from palpate.instrument.errors import BenchError, DeviceError, LinkError, LinkTimeout, UsageError

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
    said = _said(read)
    simulated = read(HARDWARE) == b"simulated"
    own = [kind for kind in kinds if kind.contract.bus == "canopen"]
    fit = fitting(own, lambda kind: CanopenNode(link, node, WallClock(), kind.contract))
    return FoundDevice("canopen", at, node, said, fit.serial, fit.fits, fit.candidates, fit.doubt, simulated)


def _said(read: Callable[..., bytes]) -> str:
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
