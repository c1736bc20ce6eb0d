"""`palpate bus scan` and `bus lss`: what a scan tells, the bench file that it begins, and node ids that are given."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import canopen.lss
import pytest

from palpate.drivers.links.can import LssAddress
from palpate.drivers.scan import FoundDevice
from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import all_kinds
from palpate.instrument.bench.links import CanBus, SerialLine, TcpLink
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map
from palpate.instrument.errors import BenchError, RangeError, UsageError
from palpate.procedures.lab.before import begun_bench
from palpate.procedures.lab.scan import Change, ScanPlan
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.modbus import Servers
from tests.procedures.conftest import Palpate

OVEN = """
[device]
name = "my-oven"
title = "My oven"
bus = "modbus"
links = ["modbus-tcp", "modbus-rtu"]
vendor = "Maker"
known_by = "marks"
serial = "number"

[[mark]]
field = "model"
value = 77

[field.model]
address = 0
type = "uint16"
meaning = "number of the model"

[field.number]
address = 1
type = "uint16"
meaning = "serial number"
"""


@pytest.fixture
def oven(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """The map of an oven, and the port at which its twin answers, whatever the unit id."""
    path = tmp_path / "oven.toml"
    path.write_text(OVEN)
    kind: Any = SimpleNamespace(contract=read_map(path).contract)
    rig: Any = None
    twin = Twin.at(SimulatedPlace(VirtualClock(), rig, 1, "SIM-OV-0042", None, kind, lambda _role: None))
    with Servers() as servers:
        yield path, servers.serve_tcp(1, twin)


@pytest.mark.parametrize(("units", "found"), [("1-2", 1), ("255", 255), ("0", 0), ("3-4", 0)])
def test_a_device_is_found_with_its_map_or_at_its_address_itself_and_the_bench_file_can_be_used(
    palpate: Palpate, oven: tuple[Path, int], units: str, found: int
) -> None:
    path, port = oven
    scan = ("bus", "scan", f"--tcp=127.0.0.1:{port}", f"--units={units}", f"--map={path}", "--out=begun.toml")
    (device,) = palpate(*scan, "--json").object["devices"]
    assert (device["unit"], device["fits"], device["serial"]) == (found, ["my-oven"], "42")
    (listed,) = read_bench(Path("begun.toml")).devices
    assert (listed.kind.name, listed.unit) == ("my-oven", found)


def test_what_is_impossible_is_refused_before_anything_is_sent(palpate: Palpate) -> None:
    for arguments, message in (
        (["--units=0-3", "--line=/dev/null"], "0 is asked by itself where no other answers"),
        (["--units=4-2", "--tcp=localhost"], "is not within 0 to 247 and 255"),
        (["--units=255", "--line=/dev/null"], "is not within 1 to 247"),
        (["--nodes=128", "--can=virtual:x"], "is not within 1 to 127"),
        ([], "nothing to search"),
        (["--tcp=a b:c:d"], "is no address"),
        (["--tcp=host:70000"], "70000"),
        (["--line=/dev/null", "--line=/dev/null"], "is given twice"),
        (["--line=/dev/null", "--baudrates=fast"], "'fast' is no rate"),
        (["--line=/dev/null", "--baudrates=299"], "299"),
        (["--line=/dev/null", "--parities=X"], "'X' is no parity"),
        (["--tcp=localhost", "--timeout=0 s"], "--timeout 0 s is outside"),
        (["--can=gs_usb:0"], "cannot be told only to listen"),
        (["--can=gs_usb:0", "--talk"], "speaks at one bit rate"),
    ):
        spoken = palpate("bus", "scan", *arguments)
        assert (spoken.status, message in spoken.err) == (2, True), arguments


def test_of_kinds_that_a_device_could_be_a_map_of_ones_own_is_told_first_and_named_by_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = (SHIPPED / "seneca-z-sg2.toml").read_text(encoding="utf-8")
    file.write_text(text.replace('"seneca-z-sg2"', '"mine"').replace('"Z-SG2"', '"Mine"'), encoding="utf-8")
    kinds = ScanPlan.asked(
        tcp=["localhost"], lines=[], can=None, units="1", nodes="1", baudrates=None, parities=None, every=False,
        bitrates=None, listen=1.0, talk=False, timeout=0.2, within=60.0, maps=[file],
    ).kinds  # fmt: skip
    could_be = tuple(kind.name for kind in kinds if kind.name in ("laumas-tlb4", "mine"))
    assert could_be == ("mine", "laumas-tlb4")
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    assert f'# map = "{file}"\n' in begun_bench([FoundDevice("modbus-rtu", line, 4, candidates=could_be)], kinds)


def test_a_bench_file_lists_what_is_known_and_comments_on_the_rest() -> None:
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    tcp = TcpLink(host="rig.lab")
    text = begun_bench(
        [
            FoundDevice("modbus-tcp", tcp, 1, "Palpate SG-1", "1", ("signal_generator",)),
            FoundDevice("modbus-rtu", line, 4, "", "", (), ("flintec-dad-141",)),
            FoundDevice("modbus-rtu", line, 5, "Acme 9000"),
        ],
        all_kinds(),
    )
    assert 'kind = "signal_generator"\nlink = "tcp"\nunit = 1\n' in text
    assert "# unit 4 on line answers, and is not known: it tells nothing\n# could be: flintec-dad-141\n" in text
    assert "# unit 5 on line answers, and is not known: Acme 9000\n# could be: no kind that has a map\n" in text
    assert '# port = "/dev/ttyS9"' in text
    assert begun_bench([], []).startswith("# no device is known yet")


# --- node id and bit rate by LSS: one device by its whole identity, and nothing without agreement -----

ADDRESS = LssAddress(0x26C, 0x10, 0x06720000, 1234)
SELECTS = range(0x40, 0x44)


class Slave:
    """An LSS device after CiA 305, in plain python-can; `node` answers an SDO upload as well."""

    def __init__(self, bus: can.BusABC, node: int, refuses: int = 0) -> None:
        self._bus = bus
        self._given: list[int] = []
        self.configuring = False
        self._refuses = refuses
        self.node = node
        self.written: list[tuple[int, ...]] = []

    def on_message(self, message: can.Message) -> None:
        data = bytes(message.data)
        if message.arbitration_id == 0x600 + self.node:
            self._send(0x580 + self.node, b"\x80" + data[1:4] + bytes(4))
        if message.arbitration_id != 0x7E5:
            return
        code = data[0]
        if code == 0x04:
            self.configuring = bool(data[1])
        elif code in SELECTS:
            self._given = [*(self._given if code > 0x40 else []), struct.unpack_from("<I", data, 1)[0]]
            if LssAddress(*(self._given + [0] * 4)[:4]) == ADDRESS:
                self.configuring = True
                self._send(0x7E4, b"\x44" + bytes(7))
        elif self.configuring and code == 0x5E:
            self._send(0x7E4, bytes([code, self.node, *bytes(6)]))
        elif self.configuring:
            self.written.append(tuple(data[:3]))
            self._send(0x7E4, bytes([code, self._refuses, *bytes(6)]))

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[can.BusABC]:
    monkeypatch.setattr(canopen.lss.time, "sleep", lambda _seconds: None)
    with can.Bus(interface="virtual", channel="lss") as bus:
        yield bus


def change(node: int | None = 5, bitrate: int | None = None, timeout: str = "10 s", **more: Any) -> Change:
    link = CanBus(interface="virtual", channel="lss", timeout=timeout)  # type: ignore[arg-type]
    return Change(link, more.get("address", ADDRESS), node, bitrate, more.get("save", False))


def carried_out(
    bus: can.BusABC, slaves: list[Slave], wanted: Change, agrees: Callable[[str], None] | None = None
) -> tuple[int | None, list[str]]:
    asked: list[str] = []
    notifier = can.Notifier(bus, [slave.on_message for slave in slaves], timeout=0.01)
    try:
        return wanted.carry_out(agrees or asked.append), asked
    finally:
        notifier.stop()


def test_a_node_id_a_bit_rate_and_the_order_to_keep_them_go_to_the_device_by_its_identity(bus: can.BusABC) -> None:
    slave = Slave(bus, 5)
    before, asked = carried_out(bus, [slave], change(5, 500_000, save=True))
    assert (before, slave.written) == (5, [(0x11, 5, 0), (0x13, 0, 2), (0x17, 0, 0)])
    assert "gets node id 5 and 500000 bit/s, and keeps it when it is switched off (it has node id 5 now)" in asked[0]


def test_nothing_is_written_before_a_person_agrees_and_nothing_kept_unless_it_is_asked_for(bus: can.BusABC) -> None:
    def never(_what: str) -> None:
        raise KeyboardInterrupt

    slave = Slave(bus, 5)
    with pytest.raises(KeyboardInterrupt):
        carried_out(bus, [slave], change(5), never)
    assert (slave.written, slave.configuring) == ([], False)
    carried_out(bus, [slave], change(5))
    assert slave.written == [(0x11, 5, 0)]


def test_a_device_that_is_not_there_one_that_refuses_and_a_node_id_that_is_taken_are_told(bus: can.BusABC) -> None:
    other, slave = LssAddress(0x26C, 0x10, 0x06720000, 1), Slave(bus, 255)
    for slaves, wanted, message in (
        (
            [Slave(bus, 5)],
            change(address=other, timeout="20 ms"),
            "26Ch 10h 6720000h 1h on virtual:lss does not answer",
        ),
        ([Slave(bus, 5, refuses=1)], change(5), r"refuses to take node id 5 \(LSS Error: 1\)"),
        ([slave, Slave(bus, 7)], change(7), "node 7 answers already on virtual:lss; give another --node"),
    ):
        with pytest.raises(BenchError, match=message):
            carried_out(bus, slaves, wanted)
    assert slave.written == []


@pytest.mark.parametrize(
    ("wanted", "error", "message"),
    [
        ({"node": None}, UsageError, "nothing to set"),
        ({"node": 128}, RangeError, "--node 128 is outside 1 to 127"),
        ({"node": None, "bitrate": 333_333, "save": True}, RangeError, "LSS knows 1000000, 800000"),
        ({"node": None, "bitrate": 500_000}, UsageError, "give --save, too"),
    ],
)
def test_what_cannot_be_set_is_refused_before_the_bus_is_opened(
    wanted: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        change(**wanted)
