"""Golden frames: each wrong scale, sign, order, address or function of a map is found, and is named with its values."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from pymodbus.framer import FramerRTU

from palpate.instrument.config import check
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.declaration import Command, Pdo
from palpate.instrument.contracts.field import Field, Scaling, sdo
from palpate.instrument.contracts.maps.golden_frames import computed, crc, prove
from palpate.instrument.contracts.maps.map_file import FrameTable, GoldenFrame, frame_of
from tests.contracts import canopen_contract as node
from tests.contracts import modbus_contract as modbus


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
