"""A search for devices: who answers, at which settings, what fits, and that nothing is written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import can
import pytest

from palpate.drivers.links import can as can_listening
from palpate.drivers.links.can import CanLink, listen
from palpate.drivers.links.modbus import write_registers
from palpate.drivers.scan import (
    ModbusSearch,
    ReadOnlyCan,
    ReadOnlyModbus,
    Search,
    check_allowed,
    scan_can,
    scan_line,
    settings,
)
from palpate.extend import Contract, DeviceKind, Field
from palpate.instrument.bench import links
from palpate.instrument.bench.kinds import KINDS as OWN
from palpate.instrument.bench.links import SerialLine
from palpate.instrument.contracts.declaration import Identity, Manners, Mark
from palpate.instrument.errors import UsageError
from palpate.simulators.clock import VirtualClock
from tests.drivers.fake_links import VirtualLine, checked
from tests.drivers.test_foreign import NODE, ForeignNode

PORT = "virtual line"


def contract(name: str, **more: Any) -> Contract:
    """A device with a model number, a serial number and a unit of its display."""
    fields = (
        Field("model", 0, "uint16", "model"),
        Field("number", 1, "uint16", "serial number"),
        Field("unit", 2, "uint16", "unit", choices={"kg": 0, "N": 5}),
        Field("load", 3, "int16", "load", "N", unit_in="unit"),
    )
    given: dict[str, Any] = {"known_by": "marks", "marks": (Mark("model", 7),), "serial": "number", "fields": fields}
    return Contract(name=name, title=name, bus="modbus", identity=Identity("Maker", name, "1"), **given | more)


def kind(of: Contract) -> DeviceKind:
    return DeviceKind(of, ("modbus-rtu",), "no:Driver")


INDICATOR = kind(contract("indicator"))
KINDS = [
    INDICATOR,
    kind(contract("another", marks=(Mark("model", 8),))),
    kind(contract("nameless", known_by="nothing", marks=())),
    kind(contract("longer", known_by="nothing", marks=(), fields=(Field("far", 40, "uint16", "far"),), serial="")),
]


class Slaves:
    """Devices on a line, each a list of registers by its unit; they refuse function 43/14."""

    def __init__(self, **units: Sequence[int]) -> None:
        self.units = {int(name[1:]): list(registers) for name, registers in units.items()}
        self.requests: list[bytes] = []

    def __call__(self, request: bytes) -> Iterable[tuple[float, bytes]]:
        self.requests.append(request)
        unit, function = request[0], request[1]
        if unit not in self.units:
            return
        start, count = int.from_bytes(request[2:4]), int.from_bytes(request[4:6])
        held = self.units[unit][start : start + count]
        if function != 3:
            yield 0.0, checked(bytes([unit, function | 0x80, 1]))
        elif len(held) < count:
            yield 0.0, checked(bytes([unit, function | 0x80, 2]))
        else:
            yield 0.0, checked(bytes([unit, 3, 2 * count]) + b"".join(value.to_bytes(2) for value in held))


def searched(device: Any, units: Sequence[int], kinds: Sequence[DeviceKind] = KINDS, **search: Any) -> Search:
    found = Search(**search)
    link = ReadOnlyModbus(PORT, VirtualLine(device, timeout=0.1))
    ModbusSearch(found, link, SerialLine(port=PORT), "the line", kinds).over(units)
    return found


@pytest.mark.parametrize(
    ("registers", "known", "doubt"),
    [
        ([7, 123, 5, 0], (("indicator",), ("nameless",), "123"), "^$"),
        ([7, 1, 0, 0], (("indicator",), ("nameless",), ""), "unit is 'kg', the contract reads 'N'"),
        ([], ((), (), ""), "^$"),  # it refuses all that it is asked
    ],
)
def test_a_device_is_known_by_all_its_marks_and_its_serial_number_and_doubts_are_told_by_reads_alone(
    registers: list[int], known: tuple[object, ...], doubt: str
) -> None:
    slaves = Slaves(u3=registers)
    search = searched(slaves, range(1, 5))
    (found,) = search.found
    assert (found.unit, found.says, (found.fits, found.candidates, found.serial)) == (3, "", known)
    assert re.search(doubt, found.doubt)
    assert (search.asked, search.heard, {request[1] for request in slaves.requests}) == (4, [], {3, 43})


def test_noise_is_told_with_the_unit_at_which_it_came() -> None:
    def babble(request: bytes) -> Iterable[tuple[float, bytes]]:
        if request[0] == 2:
            yield 0.0, b"\xff\x00\x81"

    search = searched(babble, [1, 2])
    assert (search.found, len(search.heard)) == ([], 1)
    assert "unit 2: 3 bytes came that are no valid reply (ff 00 81)" in search.heard[0]


def test_a_device_that_answers_at_unit_0_alone_is_found_and_others_are_not_asked_there() -> None:
    """EA sources reply there as they leave the factory; a device that keeps to the standard is silent at unit 0."""
    zero = kind(contract("source", manners=Manners(units=(0, 1))))
    search = searched(Slaves(u0=[7, 123, 5, 0]), [1, 2], [zero, INDICATOR])
    (found,) = search.found
    assert (found.unit, found.fits, search.asked) == (0, ("source",), 3)
    slaves = Slaves(u0=[7, 123, 5, 0], u2=[7, 5, 5, 0])
    (found,) = searched(slaves, [1, 2], [zero, INDICATOR]).found
    assert (found.unit, {request[0] for request in slaves.requests}) == (2, {1, 2})


def test_a_write_is_refused_before_it_is_sent() -> None:
    slaves = Slaves(u1=[0])
    link = ReadOnlyModbus(PORT, VirtualLine(slaves))
    with pytest.raises(UsageError, match="only reads; write_registers was not sent"):
        link.transact("it", write_registers, 0, [1], 1)
    assert slaves.requests == []
    bus = ReadOnlyCan(links.CanBus(interface="virtual", channel="none"))
    for write in (
        lambda: bus.download("it", None, 0x2000, 0, b"1"),
        lambda: bus.command(None, "OPERATIONAL"),
        lambda: bus.send(0x200, b""),
        lambda: bus.beat(127),
    ):
        with pytest.raises(UsageError, match="only reads"):
            write()


def test_a_search_ends_when_its_time_is_over() -> None:
    class Ticking(VirtualClock):
        def now_ns(self) -> int:
            self.wait(1.0)
            return super().now_ns()

    search = searched(Slaves(u3=[7, 1, 5, 0]), range(1, 9), within=2.5, clock=Ticking())
    assert (search.asked, search.found) == (2, [])
    assert search.over


def test_a_stop_in_the_middle_leaves_what_was_found() -> None:
    def interrupt(asked: int, _of: int, _what: str) -> None:
        if asked == 2:
            raise KeyboardInterrupt

    search = Search(progress=interrupt)
    link = ReadOnlyModbus(PORT, VirtualLine(Slaves(u1=[7, 1, 5, 0], u4=[8, 1, 5, 0])))
    with pytest.raises(KeyboardInterrupt):
        ModbusSearch(search, link, SerialLine(port=PORT), "the line", KINDS).over(range(1, 9))
    assert [found.unit for found in search.found] == [1]


def test_the_settings_of_known_devices_are_tried_first() -> None:
    line: Any = type("Line", (), {"baudrate": 57600, "parity": "E", "stopbits": 1})
    made: Any = type("Map", (), {"line": line})
    known = [replace(INDICATOR, map=made)]
    assert settings(known, [], [])[0] == (57600, "E", 1)
    assert settings(known, [9600, 57600], ["E"]) == [(57600, "E", 1), (9600, "E", 1)]
    assert settings([], [19200], ["E", "N"]) == [(19200, "E", 1), (19200, "N", 1)]


@pytest.mark.parametrize("every", [False, True])
def test_other_settings_are_tried_only_until_a_device_answers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any, every: bool
) -> None:
    tried = []

    def over(self: ModbusSearch, units: Sequence[int]) -> list[Any]:
        tried.append(self.at.baudrate)  # type: ignore[union-attr]
        return [object()] if self.at.baudrate == 19200 else []  # type: ignore[union-attr]

    monkeypatch.setattr(ModbusSearch, "over", over)
    lines = [SerialLine(port=str(tmp_path), baudrate=rate) for rate in (9600, 19200, 38400)]
    search = Search()
    scan_line(search, lines, [1], KINDS, every=every)
    assert tried == ([9600, 19200, 38400] if every else [9600, 19200])
    assert search.left == ([] if every else [f"{tmp_path} at 38400 8N1: devices answer at 19200 8N1"])


# --- CAN -----------------------------------------------------------------------------------------------


def can_link(**more: Any) -> links.CanBus:
    return links.CanBus(**{"interface": "virtual", "channel": "scan", "timeout": "50 ms"} | more)


def test_heartbeats_tell_node_ids_and_error_frames_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def frame(identifier: int, **flags: Any) -> can.Message:
        return can.Message(arbitration_id=identifier, **{"is_extended_id": False, **flags})

    came = [frame(0x705), frame(0x89), frame(0x80), frame(0x181), frame(0x70A, is_extended_id=True),
            frame(0, is_error_frame=True)]  # fmt: skip

    class Bus:
        def __init__(self, **settings: Any) -> None:
            self.settings = settings

        def __enter__(self) -> Bus:
            return self

        def __exit__(self, *_: object) -> None:
            assert self.settings["listen_only"] is True

        def recv(self, _left: float) -> can.Message | None:
            return came.pop(0) if came else None

    monkeypatch.setattr(can_listening.can, "Bus", Bus)
    heard = listen(can_link(interface="slcan"), 0.01)
    assert (heard.frames, heard.errors, heard.nodes) == (5, 1, {5, 9})


def test_an_interface_that_cannot_listen_is_refused_unless_a_person_vouches_for_one_bit_rate() -> None:
    buses = [can_link(interface="gs_usb"), can_link(interface="gs_usb", bitrate=500_000)]
    with pytest.raises(UsageError, match="cannot be told only to listen"):
        check_allowed(buses[:1], talk=False)
    with pytest.raises(UsageError, match="speaks at one bit rate"):
        check_allowed(buses, talk=True)
    check_allowed(buses[:1], talk=True)


@pytest.mark.parametrize(("frames", "errors"), [(0, 0), (3, 1)])
def test_nobody_is_asked_on_a_real_bus_before_frames_have_proved_the_bit_rate(
    monkeypatch: pytest.MonkeyPatch, frames: int, errors: int
) -> None:
    opened: list[object] = []
    monkeypatch.setattr(CanLink, "open", lambda self: opened.append(self))
    monkeypatch.setattr(
        "palpate.drivers.scan.listen", lambda _bus, _seconds: can_listening.Heard(frames, errors, set())
    )
    search = Search()
    scan_can(search, [can_link(interface="slcan")], [1], [], seconds=1.0, talk=False)
    assert opened == []
    assert "nothing proves the bit rate; add --talk" in search.left[0]


def test_a_node_is_found_by_uploads_alone() -> None:
    with can.Bus(interface="virtual", channel="scan") as bus:
        node = ForeignNode(bus)
        before = dict(node.objects)
        notifier = can.Notifier(bus, [node.on_message], timeout=0.01)
        try:
            search = Search()
            scan_can(search, [can_link(timeout="10 s")], [NODE], list(OWN.values()), seconds=0.01, talk=False)
        finally:
            notifier.stop()
    assert node.objects == before
    (found,) = search.found
    assert (found.unit, found.fits, found.serial, found.simulated) == (NODE, ("sensor_node",), "0000F0F0", False)
    assert "vendor 50414C50h" in found.says
