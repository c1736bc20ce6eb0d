"""Traffic of makers' devices in a bus log: fields by name, with the scales and signs that went by before."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.drivers.logs.bus_log import RUN, Link, Packet, PcapngWriter
from palpate.instrument.contracts.field import Field, Scaling
from palpate.instrument.contracts.maps.map_file import read_map
from palpate.procedures.logs import Conversation, read_log
from tests.contracts import modbus_contract

THING = modbus_contract(
    Field("status", 6, "uint16", "status", bits={"negative": 7, "ready": 3}),
    Field("load", 7, "uint32", "load", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("mean", 14, "int16", "mean", "N", missing=(-1,)),
    Field("low", 16, "uint16", "low half", part=(0, 8)),
    Field("high", 16, "uint16", "high half", part=(8, 8)),
    Field("order", 20, "uint16", "order", access="rw", choices={"none": 0, "start": 1}, function=6),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, table="input"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw"),
    Field("output", 403, "bool", "output", table="coil", access="rw"),
    Field("closed", 5, "bool", "contact", table="discrete"),
    known_by="nothing",
)


def said(*frames: str) -> list[str]:
    """The texts of a request, its reply, the next request and so on."""
    talk = Conversation(THING)
    return [talk.pdu(bytes.fromhex(frame), sent=number % 2 == 0) for number, frame in enumerate(frames)]


def test_a_scale_and_a_sign_are_those_that_went_by_before() -> None:
    texts = said("03 000D 0001", "03 02 0002", "03 0006 0003", "03 06 0080 000004D2")
    assert texts[1:] == ["decimals = 2", "read status, load", "status = negative, load = -12.34 N"]


def test_a_scale_that_never_went_by_is_said_to_be_unknown() -> None:
    assert said("03 0007 0002", "03 04 000004D2")[1] == "load = 00 00 04 d2 (its scale or sign is not known here)"


@pytest.mark.parametrize(
    ("request_", "reply", "texts"),
    [
        ("04 0009 0001", "04 02 00D7", ["read heat", "heat = 21.5 degC"]),
        ("02 0005 0001", "02 01 01", ["read closed", "closed = 1"]),
        ("01 0192 0002", "01 01 02", ["read remote, output", "remote = 0, output = 1"]),
        ("05 0192 FF00", "05 0192 FF00", ["write remote = 1", "written"]),
        ("05 0192 0000", "05 0192 0000", ["write remote = 0", "written"]),
        ("0F 0192 0002 01 02", "0F 0192 0002", ["write remote = 0, output = 1", "written"]),
        ("06 0014 0001", "06 0014 0001", ["write order = start", "written"]),
        ("03 000E 0001", "03 02 FFFF", ["read mean", "mean = no reading"]),
        ("03 0010 0001", "03 02 0102", ["read low, high", "low = 2, high = 1"]),
        ("03 0064 0002", "03 04 0102 0304", ["read 2 from 0x0064", "0x0064: 01 02 03 04"]),
        ("06 0064 0007", "06 0064 0007", ["write 0x0064: 00 07", "written"]),
        ("03 0064 0001", "83 02", ["read 1 from 0x0064", "exception 2, illegal address"]),
    ],
)
def test_every_function_shows_fields_by_name(request_: str, reply: str, texts: list[str]) -> None:
    assert said(request_, reply) == texts


@pytest.mark.parametrize(
    ("identifier", "data", "text"),
    [
        (0x58A, "43 02 64 01 2C 01 00 00", "-> 0x6402:1 = 2c 01 00 00"),
        (0x60A, "2B 02 64 01 2C 01 00 00", "write 0x6402:1 = 2c 01"),
        (0x60A, "40 02 64 01 00 00 00 00", "read 0x6402:1"),
        (0x58A, "60 02 64 01 00 00 00 00", "written 0x6402:1"),
        (0x3CA, "01 FF", "0x3CA: 01 ff"),
        (0x3CA, "", "0x3CA"),
    ],
)
def test_an_object_or_message_that_no_contract_has_is_shown_with_its_value(
    tmp_path: Path, identifier: int, data: str, text: str
) -> None:
    log = tmp_path / "bus.log"
    log.write_text(f"(0.000000) can0 {identifier:03X}#{data.replace(' ', '')}\n")
    (line,) = read_log(log)
    assert line.text == text


def test_a_laboratorys_map_is_found_by_the_runs_header_if_it_is_still_the_same(tmp_path: Path) -> None:
    path = tmp_path / "oven.toml"
    path.write_text(
        '[device]\nname = "my-oven"\ntitle = "Oven"\nbus = "modbus"\nlinks = ["modbus-tcp"]\nvendor = "M"\n'
        'known_by = "nothing"\n[field.heat]\naddress = 1\ntype = "uint16"\nmeaning = "heat"\nunit = "degC"\n'
    )
    reply = Packet(1, "oven (my-oven)", Link.TCP, True, bytes(7) + bytes.fromhex("03 0001 0001"))
    for digest, text in ((read_map(path).sha256, "<- read heat"), ("0" * 64, "<- read 1 registers from 0x0001")):
        header = {"bench": f'[device.oven]\nmap = "{path}"\n', "maps": {"my-oven": digest}}
        note = Packet(0, RUN, Link.NOTE, True, json.dumps(header).encode())
        with (log := tmp_path / "bus.pcapng").open("wb") as file:
            writer = PcapngWriter(file)
            for packet in (note, reply):
                writer.write(packet)
            writer.end()
        (line,) = read_log(log)
        assert line.text == text
