"""What a driver does for devices that can be bought: functions, scales, signs, wear, handshakes, marks, both buses."""

from __future__ import annotations

import itertools
import math
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices.device import MOST, WITHIN, DevicePlace
from palpate.drivers.devices.either_bus import EitherBus
from palpate.drivers.links.modbus import ModbusLink
from palpate.extend import Contract, DeviceKind, ModbusDevice
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.declaration import Command, Condition, Identity, Manners, Mark, Pdo
from palpate.instrument.contracts.field import Field, Scaling, sdo
from palpate.instrument.errors import ConfigError, DeviceError, IdentityError, RangeError, UsageError
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.modbus import Servers
from tests.contracts import canopen_contract, modbus_contract
from tests.drivers.fake_links import Objects, Registers, changing

# a load indicator in the manner of LAUMAS, a supply in that of EA, and a drive, in one
FIELDS = (
    Field("type", 1, "uint16", "type of the device"),
    Field("serial", 3, "uint16", "serial number"),
    Field("order", 5, "uint16", "order", access="wo", function=6),
    Field("status", 6, "uint16", "status", bits={"negative": 7, "stable": 11}),
    Field("gross", 7, "uint32", "weight", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("more", 9, "uint64", "net and peak"),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("unit", 14, "uint16", "unit", part=(8, 8), choices={"kg": 0, "N": 5}, access="rw"),
    Field("polarity", 14, "uint16", "polarity", part=(0, 8), choices={"bipolar": 0, "unipolar": 1}, access="rw"),
    Field("span", 16, "uint16", "span", "N", scaling=Scaling("decimals"), access="rw", endures=10_000),
    Field("average", 18, "int32", "triggered average", missing=(99999,), maximum=5000),
    Field("level", 20, "uint16", "filter", access="rw", function=6),
    Field("mode", 30, "uint16", "mode", access="rw"),
    Field("place", 31, "int32", "place", access="rw"),
    Field("gone", 40, "uint16", "state of the order"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw", choices={"off": 0, "on": 1}),
    Field("output", 405, "bool", "output", table="coil", access="rw", choices={"off": 0, "on": 1}),
    Field("closed", 5, "bool", "contact", table="discrete"),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, offset=-40.0, table="input"),
)
COMMANDS = (
    Command("remote", "remote", "on"),
    Command("arm", "order", 7, after=("remote",)),
    Command("tare", "order", 1, ("remote", "arm"), Condition("gone", (2,), 0x0F), Condition("gone", (8,)), 0, 0.5),
)
THING = modbus_contract(
    *FIELDS, known_by="marks", marks=(Mark("type", 24),), serial="serial", commands=COMMANDS,
    manners=Manners(gap=0.005, together=(("mode", "place"),)),
)  # fmt: skip
GOOD: dict[str, Any] = {"type": 24, "serial": 77, "decimals": 2, "unit": "N", "average": 12}


def made(contract: Contract = THING, inventory: str = "", **held: Any) -> tuple[ModbusDevice, Any, VirtualClock]:
    link: Any = Registers(contract)
    link.put(**{name: value for name, value in {**GOOD, **held}.items() if contract.has(name)})
    clock = VirtualClock()
    kind = DeviceKind(contract, ("modbus-rtu",), "here:Thing")
    return ModbusDevice.at(DevicePlace(link, 7, None, clock, kind, inventory)), link, clock


# --- functions -----------------------------------------------------------------------------------------


def test_each_table_is_read_and_written_with_its_function() -> None:
    device, link, _ = made(closed=1, heat=21.5)
    assert device.get_many("closed", "heat", "output", "level") == [1.0, 21.5, 0.0, 0.0]
    device.set(output="on")
    device.set(level=3)
    device.set(mode=1, place=-2)
    assert [asked[0] for asked in link.asked] == [
        "read_coils", "read_discrete", "read_registers", "read_inputs", "write_coil", "write_register",
        "write_registers",
    ]  # fmt: skip
    assert [link.held(name) for name in ("output", "level", "mode", "place")] == [1.0, 3.0, 1.0, -2.0]
    assert all((timing["gap"], timing["responds"]) == (0.005, 0.0) for timing in link.timing)


@pytest.mark.parametrize(
    ("values", "change", "said"),
    [
        ({"output": "on"}, {"bits": [False]}, "did not confirm output = "),
        ({"output": "on"}, {"address": 9}, "did not confirm output = "),
        ({"level": 3}, {"registers": [4]}, "did not confirm level = "),
        ({"level": 3}, {"function_code": 16}, "did not confirm level = "),
        *(
            ({}, {"bits": [True] * bits}, f"answered function 1 with {bits} bits where function 1 with 8")
            for bits in (1, 16, 0)
        ),
    ],
)
def test_an_answer_to_something_else_is_none(values: dict[str, Any], change: dict[str, Any], said: str) -> None:
    device, link, _ = made()
    link.replied = changing(change)
    with pytest.raises(DeviceError, match=said):
        device.set(**values) if values else device.get("output")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mode": 1}, "mode cannot be written without place"),
        ({"unit": "N"}, "unit cannot be written without polarity"),
        ({"level": 1, "span": 2}, "not adjacent"),
    ],
)
def test_what_one_request_cannot_write_is_refused_before_anything_is_sent(values: dict[str, Any], message: str) -> None:
    device, link, _ = made()
    with pytest.raises(UsageError, match=message):
        device.set(**values)
    assert link.asked == []


def test_lost_settings_are_restored_whole() -> None:
    device, link, _ = made()
    device.set(mode=1, place=9)
    device.set(unit="N", polarity="unipolar")
    link.put(place=0, polarity="bipolar")
    assert [text.split(": ")[1] for text in device.differences()] == [
        "place is 0, was set to 9", "polarity is 0, was set to unipolar",
    ]  # fmt: skip
    link.asked.clear()
    device.restore()
    assert link.writes() == [(30, [1, 0, 9]), (14, [0x0501])]


# --- scale, sign, unit, no reading ---------------------------------------------------------------------


@pytest.mark.parametrize(("status", "value"), [(0x0800, 12.34), (0x0880, -12.34)])
def test_a_weight_is_read_with_its_sign_and_its_decimals_in_one_request(status: int, value: float) -> None:
    device, link, _ = made(status=status, gross=12.34)
    assert (device.get_many("gross", "status"), link.asked) == ([value, status], [("read_registers", 6, 8, 7)])
    assert device.held("gross") == value


def test_a_scale_that_stands_too_far_away_is_read_once_and_watched() -> None:
    far = tuple(replace(f, address=300) if f.name == "decimals" else f for f in FIELDS)
    device, link, _ = made(replace(THING, fields=far), gross=12.34)
    assert [device.get("gross") for _ in range(3)] == [12.34] * 3
    assert [asked[1:3] for asked in link.asked] == [(300, 1), (6, 3), (6, 3), (6, 3)]
    link.put(decimals=1)
    for ask in (device.differences, device.identify):
        with pytest.raises(DeviceError, match="decimals is 1, was 2 before, so the scale of its readings has changed"):
            ask()


def test_a_command_or_a_scale_that_the_map_does_not_know_is_an_error_by_name() -> None:
    table = Scaling("decimals", "table", {0: 1.0})
    some = tuple(replace(f, scaling=table) if f.name == "span" else f for f in FIELDS)
    device, link, _ = made(replace(THING, fields=some))
    with pytest.raises(UsageError, match="command of the thing"):
        device.command("tear")
    assert link.asked == []
    with pytest.raises(DeviceError, match="tells a scale of span that the contract does not know"):
        device.get("span")


@pytest.mark.parametrize("ask", ["get", "held"])
def test_a_scale_that_cannot_be_is_an_error_by_name_and_no_reading(ask: str) -> None:
    thing = replace(THING, fields=tuple(replace(f, maximum=None) if f.name == "decimals" else f for f in FIELDS))
    device, link, _ = made(thing, gross=5)
    link.put(decimals=65535)
    with pytest.raises(
        DeviceError, match="gross cannot be used: decimals = 65535 is no number of decimals; valid: -20"
    ):
        getattr(device, ask)("gross")


def test_a_setting_is_written_in_the_scale_that_the_device_tells() -> None:
    device, link, _ = made()
    device.set(span=1.25)
    assert (link.words[16], device.differences()) == (125, [])
    link.words[16] = 126
    assert device.differences() == ["thing at rack unit 7: span is 1.26, was set to 1.25"]


def test_another_unit_than_the_map_s_is_refused_by_name() -> None:
    some = tuple(replace(f, unit_in="unit") if f.name == "gross" else f for f in FIELDS)
    device, link, _ = made(replace(THING, fields=some))
    device.identify()
    link.put(unit="kg")
    for ask in (device.identify, device.differences):
        with pytest.raises(DeviceError, match="unit is 'kg', the contract reads 'N'; set the device to N"):
            ask()


def test_a_value_that_says_that_there_is_none_is_no_error() -> None:
    device, link, _ = made(average=math.nan)
    assert math.isnan(device.get("average"))
    link.put(average=5001)
    with pytest.raises(DeviceError, match="average = 5001 is outside"):
        device.get("average")


# --- wear ----------------------------------------------------------------------------------------------


def test_memory_that_wears_is_written_only_when_it_holds_another_value_and_never_in_a_loop() -> None:
    device, link, clock = made()
    for number in range(MOST):
        device.set(span=1.0 + number)
        device.set(span=1.0 + number)
    assert len(link.writes()) == MOST
    with pytest.raises(DeviceError, match=f"span was written {MOST} times within 3600 s, and its memory endures 10000"):
        device.set(span=99.0)
    assert len(link.writes()) == MOST
    clock.wait(WITHIN)
    device.set(span=99.0)
    assert len(link.writes()) == MOST + 1


# --- commands ------------------------------------------------------------------------------------------


def test_a_command_comes_behind_what_must_precede_it_and_is_cleared_when_it_is_done() -> None:
    device, link, clock = made()
    link.put(gone=0xF0)

    def work() -> None:
        if link.words[5] == 1:
            link.put(gone=0xF2)

    link.written = work
    device.command("tare")
    orders = [asked[:3] for asked in link.asked if asked[0].startswith("write")]
    assert orders == [
        ("write_coil", 402, [True]), ("write_register", 5, [7]), ("write_register", 5, [1]), ("write_register", 5, [0]),
    ]  # fmt: skip
    assert clock.now_ns() == 0


@pytest.mark.parametrize(
    ("state", "message", "waited", "cleared"),
    [
        (8, "refuses the command 'tare': gone reads 8", 0.0, True),
        (4, "'tare' was not done within 0.5 s: gone reads 4 (of which 0xF counts), should read 2", 0.5, False),
    ],
)
def test_a_command_that_is_not_carried_out_is_told_with_the_state_that_was_found(
    state: int, message: str, waited: float, cleared: bool
) -> None:
    device, link, clock = made(gone=state)
    with pytest.raises(DeviceError, match=re.escape(message)):
        device.command("tare")
    assert clock.now_ns() == waited * 1e9
    assert [asked[2] for asked in link.asked if asked[0] == "write_register"].count([1]) == 1
    assert (link.words[5] == 0) is cleared


# --- who answers ---------------------------------------------------------------------------------------


def test_a_device_is_known_by_its_marks_and_gives_its_serial_number() -> None:
    device, link, _ = made()
    device.identify()
    assert device.serial == "77"
    link.put(serial=78)
    with pytest.raises(IdentityError, match="has serial number 78, had 77 before"):
        device.identify()


@pytest.mark.parametrize(
    ("marks", "held", "said"),
    [
        ((Mark("type", 24),), {"type": 25}, "type reads 25, should be 24; this is another device or firmware"),
        ((Mark("model", "TLB4"),), {"model": "TLU 4"}, "model reads 'TLU 4', should begin with 'TLB4'"),
    ],
)
def test_a_mark_that_does_not_fit_is_another_device(marks: Any, held: Any, said: str) -> None:
    text = Field("model", 50, "text", "model", length=8)
    device, _, _ = made(replace(THING, fields=(*FIELDS, text), marks=marks), **held)
    with pytest.raises(IdentityError, match=said):
        device.identify()


def test_a_device_without_the_register_of_its_mark_is_another_one() -> None:
    device, link, _ = made()
    link.failures = [DeviceError("thing: answered exception 2, illegal address", code=2)]
    with pytest.raises(IdentityError, match=r"cannot read type, by which it is known \(thing: answered exception 2"):
        device.identify()


def test_a_device_that_tells_nothing_is_called_by_its_label_or_refused() -> None:
    mute = replace(THING, known_by="nothing", marks=(), serial="")
    device, _, _ = made(mute, inventory="LAB-12")
    device.identify()
    assert device.serial == "LAB-12"
    with pytest.raises(IdentityError, match='tells nothing by which it is known; write inventory = "LABEL"'):
        made(mute)[0].identify()


# --- CANopen nodes -------------------------------------------------------------------------------------


class Switch(EitherBus):
    """A driver that knows fields only."""

    def on(self) -> float:
        self.give(mode=1)
        return self.get("mode")


NODE = canopen_contract(
    Field("mode", sdo(0x2000), "uint8", "mode", access="rw"),
    Field("name", sdo(0x1008), "text", "name"),
    Field("decimals", sdo(0x6132, 1), "uint8", "decimals"),
    Field("force", sdo(0x8130, 1), "int24", "force", "N", scaling=Scaling("decimals")),
    Field("burn", sdo(0x2010), "uint8", "kept", access="rw", endures=1000),
    known_by="marks",
    marks=(Mark("name", "DSRT"),),
)


def node(contract: Contract = NODE, **held: Any) -> tuple[Any, Any, VirtualClock]:
    link: Any = Objects(contract)
    link.put(name="DSRT 22", decimals=2, **held)
    link.held[0x1018, 1] = (0x5F).to_bytes(4, "little")
    clock = VirtualClock()
    return Switch.at(DevicePlace(link, 3, None, clock, DeviceKind(contract, ("canopen",), "here:Node"))), link, clock


def test_one_driver_serves_both_buses() -> None:
    free = replace(THING, manners=Manners())
    link: Any = Registers(free)
    switch = Switch.at(DevicePlace(link, 7, None, VirtualClock(), DeviceKind(free, ("modbus-rtu",), "here:Thing")))
    other, bus, _ = node()
    other.connect()
    assert (switch.on(), other.on()) == (1.0, 1.0)
    assert (link.words[30], bus.held[0x2000, 0]) == (1, b"\1")
    assert type(switch).__name__ == type(other).__name__ == "Switch"


def test_a_node_is_known_by_marks_or_the_parts_of_its_identity_that_the_contract_has_and_read_in_its_scale() -> None:
    driver, link, _ = node()
    link.held[0x8130, 1] = bytes.fromhex("80 C7 FE")
    driver.connect()
    assert driver.get("force") == -800.0
    link.put(name="SX")
    with pytest.raises(IdentityError, match="name reads 'SX', should begin with 'DSRT'"):
        driver.identify()
    driver, link, _ = node(replace(NODE, known_by="identity", marks=()))
    driver.connect()
    link.held[0x1018, 1] = (0x60).to_bytes(4, "little")
    with pytest.raises(IdentityError, match="identifies itself as 0x00000060, the contract is for 0x0000005F"):
        driver.identify()


def test_a_node_s_memory_wears_as_well_and_nothing_is_written_if_one_of_the_values_is_beyond_its_limits() -> None:
    driver, link, _ = node()
    driver.connect()
    link.done.clear()
    with pytest.raises(RangeError):
        driver.give(mode=1, burn=256)
    assert link.done == []
    for number in range(MOST):
        driver.give(burn=number + 1)
    with pytest.raises(DeviceError, match="burn was written"):
        driver.give(burn=99)


# --- process data of a node ----------------------------------------------------------------------------

SENDS = Pdo("force", 0x280, ("force", "decimals"), index=0x1801, transmission=1, inhibit=0.01)
TAKES = Pdo("mode", 0x300, ("mode",), index=0x1401, transmission=255)
WITH_PDOS = replace(NODE, pdos=(SENDS,), receives=(TAKES,))


def piece(number: int, size: int) -> bytes:
    return number.to_bytes(size, "little")


def test_process_data_are_set_up_when_the_driver_connects_and_nothing_is_saved() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0xC000_0283, 4), piece(0x8000_0303, 4)
    driver.connect()
    done = [each[2:] for each in link.done if each[0] == "download"]
    assert done == [
        (0x1801, 1, piece(0xC000_0283, 4)),  # off, and bit 30 as it was
        (0x1A01, 0, b"\0"),
        (0x1A01, 1, piece(0x8130_0118, 4)),
        (0x1A01, 2, piece(0x6132_0108, 4)),
        (0x1A01, 0, b"\2"),
        (0x1801, 2, b"\1"),
        (0x1801, 3, piece(100, 2)),
        (0x1801, 1, piece(0x4000_0283, 4)),
        (0x1401, 1, piece(0x8000_0303, 4)),
        (0x1601, 0, b"\0"),
        (0x1601, 1, piece(0x2000_0008, 4)),
        (0x1601, 0, b"\1"),
        (0x1401, 2, b"\xff"),
        (0x1401, 1, piece(0x303, 4)),
    ]
    assert ("command", 3, "PRE-OPERATIONAL") in link.done
    assert driver.differences() == []
    driver.save()
    assert link.done[-1] == ("download", 3, 0x1010, 1, b"save")


def test_process_data_that_a_restart_has_reset_are_set_up_again() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0x283, 4), piece(0x303, 4)
    driver.connect()
    driver.start()
    driver.watch(127, 0.1)
    assert link.held[0x1016, 1] == bytes.fromhex("64 00 7F 00")
    link.held[0x1A01, 1], link.held[0x1016, 1] = piece(0x6000_0008, 4), bytes(4)
    assert driver.differences() == [
        "node 3 at bus: PDO force is no longer set up", "node 3 at bus: its heartbeat consumer is no longer set",
    ]  # fmt: skip
    driver.restore()
    assert (driver.differences(), link.done.count(("command", 3, "OPERATIONAL"))) == ([], 2)


def test_a_node_that_does_not_take_a_mapping_is_told_with_its_object() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0x283, 4), piece(0x303, 4)
    download = link.download

    def refuses(who: str, number: int, index: int, subindex: int, data: bytes) -> None:
        if (index, subindex) == (0x1A01, 1):
            raise DeviceError("node: aborted the transfer: 06040041")
        download(who, number, index, subindex, data)

    link.download = refuses
    with pytest.raises(DeviceError, match="writing 1A01h:1 for PDO force; the node does not take this, check its map"):
        driver.connect()
    assert link.held[0x1801, 1] == piece(0x8000_0283, 4)  # it stays off


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"known_by": "identity", "marks": (), "identity": Identity("Baumer", "", "")},
            "known by vendor, product and revision ['Baumer']; a node tells numbers",
        ),
        ({"pdos": (replace(SENDS, index=0x1401),)}, "PDO force: index = 5121 is outside 0x1800 to 0x19FF"),
        ({"pdos": (replace(SENDS, transmission=256),)}, "PDO force: transmission = 256 is outside 0 to 255"),
        ({"pdos": (replace(SENDS, inhibit=7.0),)}, "PDO force: inhibit = 7 is outside 0 to 6.5535"),
    ],
)
def test_an_identity_or_process_data_that_no_node_has_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        replace(NODE, **change)


def test_a_contract_whose_process_data_are_not_set_up_has_the_digest_that_it_had() -> None:
    fields = (
        Field("mode", sdo(0x2000), "uint8", "mode", access="rw"),
        Field("force", sdo(0x8130, 1), "int16", "f", "N"),
    )
    plain = canopen_contract(*fields, pdos=(Pdo("force", 0x280, ("force",)),))
    assert plain.digest() == "2b57e1e9f52cfaf8341e03021ae933bbc5305ec4b44e49061fca6b57b1e28981"
    assert replace(plain, pdos=(replace(SENDS, fields=("force",)),)).digest() != plain.digest()


# --- over TCP and a serial line ------------------------------------------------------------------------


WIRED = modbus_contract(
    Field("kind", 0, "uint16", "kind"),
    Field("number", 3, "uint16", "serial number"),
    Field("status", 6, "uint16", "status", bits={"negative": 7, "ready": 3}),
    Field("load", 7, "uint32", "load", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("more", 9, "uint64", "net and peak"),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("order", 20, "uint16", "order", access="rw", choices={"none": 0, "start": 1}, function=6),
    Field("place", 30, "int32", "place", access="rw", words="little"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw"),
    Field("output", 403, "bool", "output", table="coil", access="rw"),
    Field("closed", 5, "bool", "contact", table="discrete"),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, table="input"),
    known_by="marks",
    marks=(Mark("kind", 7),),
    serial="number",
    commands=(Command("start", "order", "start", done=Condition("status", (0x8,), 0x8), clear="none"),),
    manners=Manners(gap=0.004, units=(0, 247), most_read=8),
)


class Thing(Twin):
    def carry_out(self, command: Command) -> None:
        pass


@pytest.fixture(params=["tcp", "rtu"])
def wired(codec: str, request: pytest.FixtureRequest) -> Iterator[tuple[ModbusDevice, Any, VirtualClock]]:
    """A driver on a link of either kind, the twin that it drives at unit 0, and the clock of both."""
    rig: Any = None
    kind: Any = SimpleNamespace(contract=WIRED)
    clock = VirtualClock()
    of_line = VirtualClock() if request.param == "rtu, with a clock of its own" else clock
    thing = Thing.at(SimulatedPlace(clock, rig, 0, "SIM-TH-0003", None, kind, lambda _role: None))
    with Servers() as servers:
        if request.param == "tcp":
            link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=servers.serve_tcp(0, thing), timeout="1 s"), clock)  # type: ignore[arg-type]
        else:
            line = SerialLine(port=servers.serve_rtu({0: thing}, None), timeout="0.5 s")  # type: ignore[arg-type]
            link = ModbusLink.rtu(line, of_line)
        link.open()
        try:
            yield ModbusDevice(link, 0, clock, WIRED), thing, clock
        finally:
            link.close()


def test_a_driver_and_a_twin_understand_each_other_in_all_that_a_contract_says(wired: Any) -> None:
    driver, thing, clock = wired
    thing.settings |= {"status": 0x80, "decimals": 2.0, "heat": 21.5, "closed": 1.0, "load": -12.34}
    driver.identify()
    assert (driver.serial, driver.get_many("load", "heat", "closed")) == ("3", [-12.34, 21.5, 1.0])
    driver.set(place=-70_000)
    driver.set(remote=1)
    driver.set(output=1, remote=0)
    assert driver.get_many("place", "remote", "output") == [-70_000, 0, 1]
    driver.command("start")
    assert (thing.settings["order"], driver.differences()) == (0.0, [])
    assert clock.now_ns() >= 4_000_000
    thing.settings["decimals"] = 3.0
    with pytest.raises(DeviceError, match="decimals is 3, was 2 before"):
        driver.get("load")


@pytest.mark.parametrize("wired", ["rtu, with a clock of its own"], indirect=True)
def test_a_served_bench_measures_silences_by_the_wall_clock(
    wired: tuple[ModbusDevice, Any, VirtualClock], monkeypatch: pytest.MonkeyPatch
) -> None:
    device, _, clock = wired
    now = itertools.count(0, 4_000_000)  # ns; each look at the clock is a silence later
    wall = SimpleNamespace(monotonic_ns=lambda: next(now), monotonic=time.monotonic)
    monkeypatch.setattr("palpate.simulators.wire.modbus.time", wall)
    clock.served = True
    device.get("heat")
    device.get("heat")
