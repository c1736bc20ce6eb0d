"""Map files, their golden frames and roles: each is a contract, and what is wrong is said with table, key and value."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from pymodbus.framer import FramerRTU

from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import check_identities, device_kind, kind_in_file, kind_of
from palpate.instrument.bench.role_maps import BiasMap, ExciterMap, raw_limits
from palpate.instrument.config import check
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Command, Pdo
from palpate.instrument.contracts.field import Field, Scaling, sdo
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.contracts.maps.golden_frames import computed, crc, prove
from palpate.instrument.contracts.maps.map_file import (
    SHIPPED,
    FrameTable,
    GoldenFrame,
    frame_of,
    map_of,
    read_map,
    shipped,
)
from palpate.instrument.errors import ConfigError, UnknownName
from tests.contracts import canopen_contract as node
from tests.contracts import modbus_contract as modbus

# A transmitter after those of the LAUMAS family; its two frames are worked out by hand in the manual's words
TRANSMITTER = """
[device]
name = "transmitter"
title = "weight transmitter"
bus = "modbus"
links = ["modbus-rtu"]
vendor = "Maker"
product = "TX-1"
revision = "1"
known_by = "nothing"
[field.command]
address = 5
type = "uint16"
meaning = "order"
access = "wo"
choices = { save = 99 }
[field.status]
address = 6
type = "uint16"
meaning = "status"
bits = { gross_negative = 7, net_negative = 8, stable = 11 }
[field.gross]
address = 7
type = "uint32"
meaning = "gross weight"
unit = "kg"
sign = ["status", "gross_negative"]
[field.net]
address = 9
type = "uint32"
meaning = "net weight"
unit = "kg"
sign = ["status", "net_negative"]
[command.save]
field = "command"
value = "save"
[[frame]]
says = "read status, gross, net"
request = "01 03 00 06 00 05 65 C8"
reply = "01 03 0A 09 00 00 00 04 D2 00 00 03 E8 4D B1"
values = { status = ["net_negative", "stable"], gross = 1234, net = -1000 }
origin = "computed"
[[frame]]
says = "command save"
request = "01 10 00 05 00 01 02 00 63 E6 2C"
reply = "01 10 00 05 00 01 11 C8"
origin = "computed"
"""


def written(folder: Path, text: str = TRANSMITTER) -> Path:
    """A map file."""
    file = folder / "map.toml"
    file.write_text(text, encoding="utf-8")
    return file


def changed(folder: Path, changes: Mapping[str, str]) -> Path:
    """The map with parts of its text replaced, each of which it has once."""
    text = TRANSMITTER
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return written(folder, text)


@pytest.mark.parametrize("name", shipped())
def test_each_field_of_a_shipped_map_has_a_frame_that_fits(name: str) -> None:
    found = read_map(SHIPPED / f"{name}.toml")
    proof = prove(found.contract, found.frames)
    assert (proof.problems, proof.without, found.name) == ((), (), name)
    assert device_kind(name).contract == found.contract


def test_a_bench_file_names_a_map_beside_it(tmp_path: Path) -> None:
    written(tmp_path)
    bench = tmp_path / "bench.toml"
    link = '[link.line]\nkind = "modbus-rtu"\nport = "/dev/ttyS9"\n'
    device = f'{link}[device.scale]\nmap = "map.toml"\nlink = "line"\nunit = 1\ninventory = "no. 7"\n'
    bench.write_text(f'name = "b"\n{device}', encoding="utf-8")
    (found,) = read_bench(bench).devices
    assert found.kind.name == "transmitter"
    assert found.kind.map is not None
    bench.write_text(f'name = "b"\n{device.replace("map.toml", "../map.toml")}', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"device.scale: map: '../map.toml' leaves the folder"):
        read_bench(bench)


def test_two_maps_of_one_name_that_say_different_things_cannot_be_on_one_bench(tmp_path: Path) -> None:
    kinds = []
    for number, title in enumerate(("one", "two")):
        folder = tmp_path / str(number)
        folder.mkdir()
        kinds.append(kind_in_file(changed(folder, {'"weight transmitter"': f'"{title}"'})))
    check_identities([kinds[0], kinds[0]])
    with pytest.raises(ConfigError, match=r"0/map.toml and .*1/map.toml: device.name: both are 'transmitter'"):
        check_identities(kinds)


def test_the_map_of_the_documentation_is_one_and_its_frame_fits(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "map.md").read_text(encoding="utf-8")
    device, frame = page.split("```\n")[1], page.split("```\n")[3]
    file = written(tmp_path, device + frame)
    found = read_map(file)
    proof = prove(found.contract, found.frames)
    assert (set(proof.proved), proof.problems) == ({"net", "status"}, ())
    assert set(kind_in_file(file).serves) == {"load_indicator"}


def test_bytes_of_a_frame_may_have_commas_as_some_manuals_print_them(tmp_path: Path) -> None:
    (line,) = [line for line in TRANSMITTER.splitlines() if line.startswith("request") and " 03 " in line]
    found = read_map(changed(tmp_path, {line: line.replace(" ", ",").replace(",=,", " = ")}))
    assert prove(found.contract, found.frames).problems == ()


# --- what is wrong -------------------------------------------------------------------------------------

SCALED = """
[field.decimals]
address = 20
type = "uint16"
meaning = "decimals of the display"
access = "rw"
[field.tare]
address = 11
type = "int32"
meaning = "tare"
scaling = { told_by = "decimals" }
[command.save]"""


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("address = 9", "address = 8", "weight transmitter: gross and net overlap at 0x8"),
        ("address = 9", "address = 65535", "net ends at address 65536; the addresses go from 0 to 65535"),
        ("address = 9", "address = -2", "net ends at address -1; the addresses go from 0 to 65535"),
        ("address = 9", 'address = "nine"', "field.net: address: 'nine' is no address; give a number"),
        ("address = 9", "address = true", "field.net: address: True is no whole number"),
        ("address = 9", "address = 9\nscale = 0", "field net: scale = 0; give a finite number other than 0"),
        (
            "address = 9",
            "address = 9\nscal = 2.0",
            "field.net: scal: unknown key .did you mean 'scale'.*; valid: access,",
        ),
        ("address = 9", "address = 9\nchoices = { a = true }", "field.net: choices.a: True is no whole number"),
        (
            "address = 9",
            "address = 9\nmissing = ['1']",
            "field.net: missing.0: '1' is no number; give one without quotes",
        ),
        (
            "[command.save]",
            "[line]\nbitrate = 500000\n[command.save]",
            "line.bitrate: is not for bus = 'modbus'; valid: baudrate, parity, stopbits, unit",
        ),
        (
            "[command.save]",
            "[line]\nunit = 200\n[manners]\nunits = [1, 99]\n[command.save]",
            "line.unit = 200, but manners.units are 1 to 99",
        ),
        (
            'links = ["modbus-rtu"',
            'links = ["canopen"',
            "device.links: 'canopen'; valid for bus = 'modbus', each once:",
        ),
        ("[command.save]", SCALED, "tare: its scale is in decimals, which has access 'rw'; it must be 'ro'"),
        ('value = "save"', 'value = "tare"', "command save: .*command = 'tare' is no choice; valid: save"),
        ('says = "command save"', 'says = "save"', """frame 2: says: 'save': give "read", "write", "command","""),
        ("00 01 11 C8", "00 01 11 C", "frame 2: reply: '.* 11 C' is no message; give bytes as"),
        ('bus = "modbus"', 'bus = "profibus"', "device.bus: 'profibus' is not known; valid: 'modbus' or 'canopen'"),
        ('name = "transmitter"', 'name = "../transmitter"', "device.name: '../transmitter' does not have the form"),
    ],
)
def test_an_impossible_map_is_refused_with_file_table_value_and_what_is_allowed(
    old: str, new: str, wrong: str, tmp_path: Path
) -> None:
    file = changed(tmp_path, {old: new})
    with pytest.raises(ConfigError, match=f"^{re.escape(str(file))}: .*{wrong}"):
        read_map(file)


def test_a_map_with_the_name_of_one_of_our_own_kinds_is_refused(tmp_path: Path) -> None:
    file = changed(tmp_path, {'name = "transmitter"': 'name = "positioner"'})
    with pytest.raises(ConfigError, match=r"device.name: 'positioner' is a kind of palpate's own; give another name"):
        kind_in_file(file)


def test_a_map_whose_frame_does_not_fit_is_no_kind(tmp_path: Path) -> None:
    file = changed(tmp_path, {"net = -1000": "net = -1001"})
    wrong = r"frame 1 \(read status, gross, net\): net: -1001 kg wanted \(00 00 03 E9\), -1000 found \(00 00 03 E8\)"
    with pytest.raises(ConfigError, match=f"^{re.escape(str(file))}: {wrong}"):
        kind_in_file(file)


def test_a_table_of_an_unknown_role_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, f"{TRANSMITTER}\n[role.coffee_machine]\n")
    with pytest.raises(ConfigError, match=r"role.coffee_machine: unknown role of a map 'coffee_machine'"):
        kind_in_file(file)


@pytest.mark.parametrize("name", ["../maps/flintec-dad-141", "/etc/passwd", "", "flintec-dad-141.toml", "x" * 5000])
def test_the_name_of_a_kind_is_no_path(name: str) -> None:
    with pytest.raises(UnknownName):
        device_kind(name)


# --- Golden frames: each wrong scale, sign, order, address or function of a map is found, and is named with its values


def frame(says: str, request: Any = None, reply: Any = None, **more: Any) -> GoldenFrame:
    table = {"says": says, "request": request, "reply": reply, "origin": "printed", **more}
    return frame_of(1, check({key: value for key, value in table.items() if value is not None}, FrameTable, "map"))


DRIVER = Field("driver_temperature", 0xF8, "int32", "temperature", "degC", 0.1)
MOTOR = replace(DRIVER, name="motor_temperature", address=0xFA)
TEMPERATURES = {"driver_temperature": 38.3, "motor_temperature": 42.6}
DECIMALS = Field("decimals", sdo(0x6132, 1), "uint8", "decimals")
STRAIN = Field("strain", sdo(0x7130, 1), "int16", "strain", "um/m", scaling=Scaling("decimals"))

# Printed in HP-5142E rev 6 (Oriental Motor), p. 81; in Manual_CANopen_StrainLink_EN_V3_05 (Baumer); and on the page of
# Waveshare's Analog Output 8CH; the coil of an EA supply is worked out
FRAMES = {
    "two longs": (
        modbus(DRIVER, MOTOR),
        frame("read driver_temperature, motor_temperature", "01 03 00 F8 00 04 C5 F8",
              "01 03 08 00 00 01 7F 00 00 01 AA 00 23", values=TEMPERATURES),
    ),
    "one register": (
        modbus(Field("output", 1, "uint16", "current", "A", 1e-6, "wo", function=6)),
        frame("write output", "01 06 00 01 13 88 D5 5C", "01 06 00 01 13 88 D5 5C", values={"output": 0.005}),
    ),
    "a coil": (
        modbus(Field("remote", 402, "bool", "remote", access="rw", table="coil", choices={"off": 0, "on": 1}),
               commands=(Command("remote", "remote", "on"),)),
        frame("command remote", "00 05 01 92 FF 00 2D FA", "00 05 01 92 FF 00 2D FA"),
    ),
    "an object": (
        node(STRAIN, DECIMALS),
        frame("read strain", "601: 40 30 71 01 00 00 00 00", "581: 4B 30 71 01 2C 01 00 00", values={"strain": 3.0},
              beside={"decimals": 2}),
    ),
    "a text in four bytes, whose number is not told": (
        node(Field("auto_zero", sdo(0x6125, 1), "text", "order", access="wo", length=4)),
        frame("write auto_zero", "601: 22 25 61 01 7A 65 72 6F", "581: 60 25 61 01 00 00 00 00",
              values={"auto_zero": "zero"}),
    ),
    "process data": (
        node(Field("torque", sdo(0x6071), "int16", "torque", access="rw"),
             Field("order", sdo(0x6040), "uint16", "order", access="rw"),
             receives=(Pdo("drive", 0x200, ("order", "torque")),)),
        frame("takes drive", "205: 0F 00 F4 01", values={"order": 15, "torque": 500}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FRAMES)
def test_a_frame_of_a_manual_proves_its_fields(name: str) -> None:
    contract, given = FRAMES[name]
    proof = prove(contract, [given])
    assert proof.problems == ()
    assert set(proof.proved.values()) == {"printed"}
    assert set(proof.without) <= {"decimals"}


@pytest.mark.parametrize(
    ("name", "field", "changes", "wrong"),
    [
        (
            "two longs",
            "motor_temperature",
            {"scale": 0.01},
            "42.6 degC wanted .00 00 10 A4., 4.26 found",
        ),
        ("two longs", "motor_temperature", {"words": "little"}, "motor_temperature: 42.6 degC wanted .01 AA 00 00.,"),
        ("two longs", "driver_temperature", {"octets": "little"}, "38.3 degC wanted .00 00 7F 01"),
        ("two longs", "motor_temperature", {"address": 0xFC}, "our driver sends 01 03 00 F8 00 06 44 39"),
        ("two longs", "motor_temperature", {"type": "int16"}, "our driver sends 01 03 00 F8 00 03"),
        ("two longs", "motor_temperature", {"maximum": 40.0}, "motor_temperature = 42.6 degC is outside -inf to 40"),
        ("two longs", "driver_temperature", {"access": "wo"}, "driver_temperature cannot be read; its access is 'wo'"),
        ("one register", "output", {"function": 16}, "output: request 01 06 .*, our driver sends 01 10 00 01 00 01 02"),
        ("one register", "output", {"scale": 1e-5}, "output: 0.005 A wanted .01 F4., 0.05 found .13 88."),
        ("one register", "output", {"maximum": 0.004}, "output = 0.005 A is outside -inf to 0.004 A"),
        ("a coil", "remote", {"function": 15}, "our driver sends 00 0F 01 92 00 01 01 01"),
        ("a coil", "remote", {"choices": {"off": 1, "on": 0}}, "remote: 0 wanted .00., 1 found .01."),
        ("an object", "strain", {"scaling": None}, "strain: 3 um/m wanted .03 00., 300 found .2C 01."),
        ("an object", "strain", {"type": "int32"}, "strain: 2 bytes, a int32 has 4"),
        ("an object", "strain", {"address": sdo(0x7130, 2)}, "is no answer to a read of 7130:2"),
        ("process data", "torque", {"type": "int32"}, "4 bytes, drive has 6"),
        ("process data", "torque", {"scale": 0.1}, "torque: 500 wanted .88 13., 50 found .F4 01."),
    ],
)
def test_each_mistake_in_a_map_is_named_with_the_values_wanted_and_found(
    name: str, field: str, changes: dict[str, Any], wrong: str
) -> None:
    contract, given = FRAMES[name]
    fields = tuple(replace(f, **changes) if f.name == field else f for f in contract.fields)
    (problem,) = prove(replace(contract, fields=fields), [given]).problems
    assert problem.startswith(f"frame 1 ({given.table.says}): ")
    assert re.search(wrong, problem), problem


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        (frame("read x", "01 03 00 00 00 01 84 0B", "01 03 02 00 07 F9 86", values={"x": 7}), "the CRC 84 0B"),
        (frame("read x", "01 03 00 00 00 01 84 0A", "01 03 02 00 07 F9 87", values={"x": 7}), "reply .* CRC F9 87"),
        (frame("read x", "01 03 00 00 00 01 84 0A", "02 03 02 00 07 BD 86", values={"x": 7}), "unit 2, not from 1"),
        (frame("read x", "01 03 00 00 00 01 84 0A", values={"x": 7}), "has no reply; give it"),
        (frame("read x", "01 03 00 00 00 01 84 0A", "01 83 02 C0 F1", values={"x": 7}), "x: reply begins with 83 02"),
        (frame("read x", "601: 40", "581: 40", values={"x": 7}), "request 601: 40 must be bytes"),
        (frame("read x", "01", "01", values={"x": 7}), "request 01 has 1 bytes; a frame has 4 or more"),
        (frame("read x", "01 03 00 00 00 01 84 0A", "01 03 02 00 07 F9 86"), "has values of nothing; give those of x"),
        (frame("read y", values={"y": 7}), "unknown field of the thing 'y'"),
        (frame("write x", values={"x": 7}), "x cannot be written; its access is 'ro'"),
        (frame("command go"), "unknown command 'go'"),
        (frame("sends go", reply="181: 00"), "unknown PDO"),
        (frame("read x", values={"x": "on"}), "x = 'on' is no choice"),
        (frame("read x", values={"x": float("nan")}), "x = nan, but it has no raw value that says so"),
        (frame("read x", values={"x": ["on"]}), "unknown bit of x 'on'"),
    ],
)  # fmt: skip
def test_a_frame_that_is_none_is_refused(given: GoldenFrame, wrong: str) -> None:
    contract = modbus(Field("x", 0, "uint16", "x"))
    (problem,) = prove(contract, [given]).problems
    assert re.search(wrong, problem), problem


def test_the_crc_is_that_of_the_library() -> None:
    for data in map(Random(1).randbytes, range(60)):
        assert crc(data) == FramerRTU.compute_CRC(data).to_bytes(2, "big")


@pytest.mark.parametrize("name", CONTRACTS)
def test_frames_that_are_worked_out_fit_each_of_our_contracts(name: str) -> None:
    contract = CONTRACTS[name]
    tables = "".join(computed(contract, tuple(f.name for f in contract.fields)))
    proof = prove(contract, _frames(tables))
    assert (proof.problems, proof.without) == ((), ())


def _frames(text: str) -> list[GoldenFrame]:

    return [frame_of(n, check(table, FrameTable, "map")) for n, table in enumerate(tomllib.loads(text)["frame"], 1)]


@pytest.mark.parametrize("limits", [{"minimum": 70_000.0}, {"maximum": -7.0}, {"minimum": 5.0, "maximum": 6.0}])
def test_a_frame_is_worked_out_within_the_limits_of_its_field(limits: dict[str, float]) -> None:
    contract = modbus(Field("x", 0, "int32", "x", access="rw", **limits))  # type: ignore[arg-type]
    assert prove(contract, _frames("".join(computed(contract, ("x",))))).proved == {"x": "computed"}


# --- A map makes a CANopen node a sensor node: what it must say for that, and what of an EDS is enough -

IO = (SHIPPED / "canopennode-io.toml").read_text(encoding="utf-8")
CHANNELS = 'channels = ["analog_1", "analog_2", "analog_3", "analog_4"]'


def test_shipped_nodes_tell_their_channels_their_limits_and_what_they_are_known_by() -> None:
    io, strain, fine = (device_kind(name) for name in ("canopennode-io", "baumer-dsrt", "baumer-dsrt-24"))
    assert [kind.channels for kind in (io, strain, fine)] == [4, 1, 1]
    assert {kind.contract.known_by for kind in (io, strain, fine)} == {"marks"}
    assert raw_limits(io.contract["analog_1"], 1.0) == (-32767, 32767)
    assert raw_limits(strain.contract["strain"], 0.01) == (-32767, 32767)
    assert raw_limits(fine.contract["strain"], 0.01) == (-8388607, 8388607)


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        (
            CHANNELS,
            'channels = ["analog_1", "heartbeat"]',
            "channels: 'heartbeat' is no integer that a PDO sends; valid: ",
        ),
        (
            CHANNELS,
            'channels = ["analog_1", "analog_1"]',
            "channels: analog_1 would come twice at each SYNC; name each",
        ),
        (CHANNELS, "channels = []", "channels: "),
        ("transmission = 1\n", "transmission = 255\n", "channels: PDO samples has transmission = 255; give 1, so that"),
        ('meaning = "analogue input 1"', 'unit = "V"\nmeaning = "x"', "channels: they have several units; a node has"),
        (
            'address = "1006:0"',
            'address = "1007:0"',
            "sends_sync: needs fields at 1005:0 and 1006:0 that can be written",
        ),
        ("fastest = 1000.0", 'status = "error_register"', "status: 'error_register' is no field with a choice `ok`"),
        ("fastest = 1000.0", "fastest = 0.0", "fastest: "),
        ("fastest = 1000.0", "slowest = 1.0", "slowest: unknown key"),
    ],
)
def test_a_table_that_makes_no_sensor_node_is_refused_by_name(old: str, new: str, wrong: str) -> None:
    assert IO.count(old) == 1
    text = IO.replace(old, new).partition("[[frame]]")[0]
    with pytest.raises(ConfigError, match=r"role\.sensor_node") as told:
        kind_of(map_of(Path("io.toml"), text.encode()))
    assert wrong in str(told.value)


SHEET = """[FileInfo]
[DeviceInfo]
VendorName=Maker
ProductName=Inputs
[1000]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=ro
DefaultValue=0x191
[1005]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x80
[1006]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
[1800]
ParameterName=x
ObjectType=0x9
[1800sub1]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=$NODEID+0x180
[1800sub2]
ParameterName=x
ObjectType=0x7
DataType=0x5
AccessType=rw
DefaultValue=1
[1A00]
ParameterName=x
ObjectType=0x9
[1A00sub0]
ParameterName=x
ObjectType=0x7
DataType=0x5
AccessType=rw
DefaultValue=2
[1A00sub1]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x64010110
[1A00sub2]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x64010210
[6401]
ParameterName=x
ObjectType=0x8
[6401sub1]
ParameterName=x
ObjectType=0x7
DataType=0x3
AccessType=ro
PDOMapping=1
[6401sub2]
ParameterName=x
ObjectType=0x7
DataType=0x3
AccessType=ro
PDOMapping=1
"""


def test_a_data_sheet_and_three_lines_make_a_sensor_node(tmp_path: Path) -> None:
    sheet = tmp_path / "inputs.eds"
    sheet.write_text(SHEET, encoding="ascii")
    text = imported(sheet, ["6401:1=left", "6401:2=right", "1005", "1006"])
    text += '\n[role.sensor_node]\nchannels = ["left", "right"]\nsends_sync = true\n'
    kind = kind_of(map_of(tmp_path / "inputs.toml", text.encode()))
    assert (kind.channels, kind.roles, kind.contract.pdos[0].fields) == (2, ("sensor_node",), ("left", "right"))


# --- Tables `[role.exciter]` and `[role.bias]` that name what a map does not have are refused, each thing by its key


def wrong(kind: str, role: str, contract: Contract | None = None, **changes: Any) -> list[str]:
    found = device_kind(kind)
    assert found.map is not None
    model: type[ExciterMap | BiasMap] = ExciterMap if role == "exciter" else BiasMap
    return check({**found.map.roles[role], **changes}, model, "role").wrong(contract or found.contract)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stream": "torque"}, "stream = 'torque' is no process data it takes; valid: set_point"),
        ({"enable": "run"}, "enable = 'run' is no command; valid: shutdown, switch_on, enable, disable, reset"),
        (
            {"fault": ("statusword", "broken")},
            "fault = ['statusword', 'broken'] is no bit of a field; valid bits of it",
        ),
        ({"error": "number"}, "error: 'number' is no field; valid: device_type,"),
        ({"set_up": {"gear": 1}}, "set_up: 'gear' is no field; valid: device_type,"),
    ],
)
def test_an_exciter_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("maxon-epos4", "exciter", **changes)
    assert found.startswith(said)


def test_a_drive_without_a_dead_man_is_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    fields = tuple(f for f in contract.fields if f.name != "watchdog")
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, fields=fields))
    assert found.startswith(
        "a drive that goes on with its last set-point needs a dead-man: a field 'watchdog' of 1016h"
    )


def test_set_points_that_wait_for_a_sync_are_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    (pdo,) = contract.receives
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, receives=(replace(pdo, transmission=1),)))
    assert found.startswith("stream = 'set_point' must hold one field in %, and be taken when it arrives")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"level": "state"}, "level: 'state' is no number field that can be written and read; valid: remote, output,"),
        ({"actual": "measured"}, "actual = 'measured' is no number field that can be read; valid: device_class,"),
        ({"ready": "wake"}, "ready = 'wake' is no command; valid: remote, on, off"),
        ({"off": ""}, "on and off: give both, or none"),
    ],
)
def test_a_source_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("ea-psb", "bias", **changes)
    assert found.startswith(said)
