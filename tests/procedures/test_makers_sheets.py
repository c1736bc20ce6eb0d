"""Makers' EDS and DCF files in all their variety: each value is right in the map, or told to be left out.

Every file here is also held against a second reader of CiA 306 (`tests/second_reader.py`), which knows nothing of maps.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.contracts.maps.eds import FOLDERS
from palpate.instrument.contracts.maps.map_file import read_map
from tests import second_reader
from tests.contracts import (
    BASE,
    BIT,
    DATA,
    F32,
    F64,
    I16,
    I24,
    INFO,
    MAPPED,
    OBJECTS,
    TAKEN,
    TEXT,
    U8,
    U16,
    U32,
    U64,
    node,
    pdo,
    record,
    section,
    var,
)  # fmt: skip
from tests.instrument.test_eds import drive
from tests.instrument.test_map_files import TRANSMITTER
from tests.procedures.conftest import Palpate, Spoken
from tests.second_reader import hold
from tests.shares import first_of

X = ("--object", "2002=x")
SINGLE = 0.10000000149011612  # what a number of 32 bits keeps of 0.1


def made(
    palpate: Palpate, text: str | bytes, *options: str, name: str = "a.eds", read_again: bool = True
) -> tuple[dict[str, Any], list[str]]:
    """A map as TOML, and what was told of it; the second reader agrees with the import of the whole file."""
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    Path("a.toml").unlink(missing_ok=True)
    said = palpate("contracts", "import", name, *options, "--out", "a.toml", "--json").object
    number = int(options[options.index("--node") + 1]) if "--node" in options else 0
    assert not read_again or hold(Path(name), number).faults == []
    notes: list[str] = said["notes"]
    written = Path("a.toml").read_text(encoding="utf-8")
    assert all(f"# {note}\n" in written for note in notes)
    return tomllib.loads(written), notes


def only_pdo(found: dict[str, Any], direction: str = "sends") -> dict[str, Any]:
    (table,) = found[direction].values()
    assert isinstance(table, dict)
    return table


# --- COB-IDs -------------------------------------------------------------------------------------------


DEFAULT = pdo(0, "$NODEID+0x180", MAPPED)


@pytest.mark.parametrize(
    ("text", "options", "base", "at"),
    [
        *(
            (BASE + pdo(0, cob_id, MAPPED) + pdo(4, "$NODEID+0x80000280", MAPPED), (), 0x180, 0)  # the latter is off
            for cob_id in ("$NODEID+0x180", "0x180+$NODEID", "0x180 + $NodeId", "$nodeid + 384", "$NODEID+0x40000180")
        ),
        (node("76") + BASE + pdo(0, "0x181", MAPPED), (), 0x181 - 76, 76),
        (node("76") + BASE + pdo(0, "0x181", TAKEN, sends=False), (), 0x181 - 76, 76),
        (BASE + pdo(0, "0x181", MAPPED), ("--node", "1"), 0x180, 1),
        *(
            (node("5") + BASE + DEFAULT.replace("$NODEID+0x180", f"$NODEID+0x180\nParameterValue={own}"), (), base, at)
            for own, base, at in (("0x2A5", 0x2A0, 5), ("0x185", 0x180, 0), ("$NODEID+0x300", 0x300, 0), ("", 0x180, 0))
        ),
    ],
)  # fmt: skip
def test_a_relative_cob_id_is_that_of_any_node_and_an_absolute_one_never_gets_the_node_id_added(
    text: str, options: tuple[str, ...], base: int, at: int, palpate: Palpate
) -> None:
    """A configured one counts before the default; one that is the default at the file's own node id is of any node."""
    found, notes = made(palpate, text, *options, name="a.dcf")
    (table,) = [*found["sends"].values(), *found["takes"].values()]
    assert (table["base"], table.get("node", 0)) == (base, at)
    assert [note.partition(" at ")[2] for note in notes if "COB-ID" in note] == ([f"node id {at} alone"] if at else [])


@pytest.mark.parametrize(
    ("cob_id", "why"),
    first_of([
        ("0x20010181", "has 29 bits"), ("$NODEID+0x20000180", "has 29 bits"), ("0x10181", "more than 11 bits"),
        ("0x80", "kept for other messages"), ("$NODEID", "kept for other messages"), ("$NODEID+0577", "octal or dec"),
        ("$NODEID*2", "no sum of $NODEID"), ("many", "no whole number"), ("", "gives no COB-ID"),
    ]),
)  # fmt: skip
def test_a_cob_id_that_a_map_cannot_hold_is_left_out_with_object_and_reason(
    cob_id: str, why: str, palpate: Palpate
) -> None:
    found, notes = made(palpate, node("5") + BASE + pdo(0, cob_id, MAPPED), name="a.dcf")
    assert found["sends"] == {}
    assert [note for note in notes if note.startswith("Left out: PDO 1800h: ") and why in note], notes


# --- mappings ------------------------------------------------------------------------------------------


def test_a_mapping_and_a_list_may_stand_in_short(palpate: Palpate) -> None:
    short = section("1A00", ParameterName="m", ObjectType="0x9", DataType=U32, AccessType="rw", CompactSubObj="8")
    short += section("1A00Value", NrOfEntries="1", **{"1": MAPPED})
    text = BASE + record("1800", (U32, "rw", "$NODEID+0x180"), (U8, "rw", "255")) + short
    assert only_pdo(made(palpate, text)[0])["fields"] == ["object_2000_0"]
    text = BASE + section(
        "3000", ParameterName="a", ObjectType="0x8", DataType=I16, AccessType="ro", CompactSubObj="4", LowLimit="-5",
        HighLimit="5",
    )  # fmt: skip
    third = made(palpate, text, "--object", "3000:3=third")[0]["field"]["third"]
    assert (third["address"], third["type"], third["minimum"], third["maximum"]) == ("3000:3", "int16", -5, 5)
    assert len(made(palpate, text, "--object", "3000")[0]["field"]) == 8


@pytest.mark.parametrize(
    ("entries", "count", "why"),
    first_of([
        (("0x00060010", TAKEN), "", "its object 1 is a dummy of 16 bits"),
        (("0x20100001", "0x20110001", TAKEN), "", "holds 1 bits of 2010:0, a map only its whole 8"),
        (("0x20010008",), "", "holds 8 bits of 2001:0, a map only its whole 16"),
        ((TAKEN,), "255", "multiplexed PDO"), ((TAKEN,), "254", "multiplexed PDO"),
        ((TAKEN,), "65", "a PDO holds 64 objects at most"), ((TAKEN,), "2", "1600:2: it has subindices 0, 1"),
        ((TAKEN, TAKEN), "", "holds 2001:0 twice"), (("0x20990010",), "", "2099:0: it has no such object"),
        ((MAPPED,), "", "holds 2000:0, which can only be read"), (("0",), "1", "its object 1 is 0x0"),
        (("0x20130020",), "", "holds 2013:0, a text"), (("0x20140040", TAKEN), "", "holds 80 bits, and a frame 64"),
    ]),
)  # fmt: skip
def test_a_mapping_that_a_map_cannot_hold_is_left_out_and_nothing_moves_to_another_byte(
    entries: tuple[str, ...], count: str, why: str, palpate: Palpate
) -> None:
    more = var("2010", BIT) + var("2011", BIT) + var("2013", TEXT) + var("2014", U64)
    found, notes = made(palpate, BASE + more + pdo(0, "$NODEID+0x200", *entries, sends=False, count=count))
    assert found["takes"] == {}
    assert [note for note in notes if note.startswith("Left out: PDO 1400h: ") and why in note], notes


def test_a_pdo_that_nobody_can_set_up_has_no_index_and_check_tells_a_map_that_would_set_it_up(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, notes = made(palpate, BASE + pdo(0, "$NODEID+0x180", MAPPED, access="const"))
    table = only_pdo(found)
    assert (table["base"], table["fixed"], "index" in table) == (0x180, 0x1800, False)
    assert "Note: PDO 1800h is as the node has it, no driver sets it up: 1800:1 is const" in notes
    monkeypatch.setenv("PALPATE_EDS", str(Path.cwd()))
    assert palpate("contracts", "check", "a.toml").status == 0
    file = Path("a.toml")
    file.write_text(file.read_text().replace("fixed = 6144", "index = 6144").replace("base = 384", "base = 512"))
    said = palpate("contracts", "check", "a.toml")
    assert "PDO sends_1: index: nobody can set it up, because in a.eds 1800:1 is const" in said.err
    assert (said.status, "PDO sends_1: base is 0x200, in a.eds it is 0x180" in said.err) == (1, True)


# --- objects -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "keys", "wanted"),
    [
        (I24, {"LowLimit": "-100", "HighLimit": "100", "DefaultValue": "-7"}, (-100, 100, -7)),
        (I16, {"DefaultValue": "0xFFFE"}, (None, None, -2)),
        (I16, {"LowLimit": "0x8000", "HighLimit": "0x7FFF"}, (-32768, 32767, None)),
        (
            F32,
            {"LowLimit": "-1.5", "HighLimit": "0x40200000", "DefaultValue": "1e-1"},
            (-1.5, 2.5, SINGLE),
        ),
        (F64, {"DefaultValue": "0x3FF8000000000000"}, (None, None, 1.5)),
        (U16, {"lowlimit": "001", "HIGHLIMIT": "3 ; at most", "defaultvalue": "2"}, (1, 3, 2)),
        (U16, {"LowLimit": "0", "HighLimit": "0"}, (None, None, None)),
    ],
)
def test_values_are_read_by_the_type_of_their_object(
    kind: str, keys: dict[str, str], wanted: tuple[Any, ...], palpate: Palpate
) -> None:
    found, notes = made(palpate, BASE + var("2002", kind, **keys), *X)
    field = found["field"]["x"]
    assert ((field.get("minimum"), field.get("maximum"), field.get("default")), notes) == (wanted, [])


@pytest.mark.parametrize(
    ("kind", "keys", "kept", "why"),
    first_of([
        (U16, {"LowLimit": "1", "HighLimit": "65536"}, {"minimum": 1}, "greatest value: 65536 is beyond 0 to 65535"),
        (U64, {"HighLimit": "0xFFFFFFFFFFFFFFFF"}, {}, "greatest value: 0xFFFFFFFFFFFFFFFF has more digits"),
        (U64, {"DefaultValue": "0x8000000000000001"}, {}, "default: 0x8000000000000001 has more digits"),
        (I16, {"LowLimit": "10", "HighLimit": "-10"}, {}, "limits 10 to -10 contradict each other"),
        (I16, {"LowLimit": "4", "HighLimit": "4"}, {}, "limits 4 to 4 leave one value"),
        (I16, {"HighLimit": "10", "DefaultValue": "50"}, {"maximum": 10}, "default 50 is outside its limits"),
        (U8, {"DefaultValue": "$NODEID"}, {}, "default: $NODEID counts from the node id"),
        (U32, {"DefaultValue": "1.5"}, {}, "default: '1.5' is no whole number"),
        (U32, {"DefaultValue": "017"}, {}, "default: 017 may be octal or decimal"),
        (F32, {"DefaultValue": "1e39"}, {}, "default: 1e39 is beyond a number of 32 bits"),
        (F32, {"DefaultValue": "0x7F800000"}, {}, "default: 0x7F800000 is beyond a number of 32 bits"),
        (BIT, {"DefaultValue": "2"}, {}, "default: 2 is beyond 0 to 1"),
    ]),
)  # fmt: skip
def test_a_value_that_cannot_be_kept_is_told_and_never_rounded_or_clipped(
    kind: str, keys: dict[str, str], kept: dict[str, int], why: str, palpate: Palpate
) -> None:
    found, notes = made(palpate, BASE + var("2002", kind, **keys), *X)
    values = {key: found["field"]["x"][key] for key in ("minimum", "maximum", "default") if key in found["field"]["x"]}
    assert values == kept
    assert [note for note in notes if note.startswith("Left out: 2002:0: its ") and why in note], notes


# --- whole files ---------------------------------------------------------------------------------------

USAGE = section("DummyUsage", Dummy0002="1", Dummy0005="0x1")
LINES = section("Comments", Lines="9", Line1="their number is wrong")
STRAY = {
    "dummies that are not all listed": BASE + USAGE,
    "a domain without a type": BASE + section("2009", ParameterName="d", ObjectType="0x2", AccessType="rw"),
    "an object without access": BASE + section("2009", ParameterName="d", ObjectType="7", DataType="5"),
    "blank numbers": BASE + var("2009", U8, PDOMapping="") + node("", Baudrate=""),
    "a node that is not configured": BASE + node("255"),
    "comments": LINES + BASE,
    "objects before all else": OBJECTS + DATA + INFO,
    "keys in lower case": BASE.replace("DefaultValue", "defaultvalue").replace("DataType", "datatype"),
    "sections in capitals": BASE.replace("[DeviceInfo]", "[DEVICEINFO]").replace("sub", "SUB"),
    "indented keys": BASE.replace("\nDefaultValue", "\n   DefaultValue"),
    "carriage returns": BASE.replace("\n", "\r\n"),
    "no end of its last line": BASE.rstrip("\n"),
    "spaces around": BASE.replace("=", " = ").replace("[1018]", "[ 1018 ]"),
    "bytes of UTF-16": BASE.encode("utf-16"),
    "bytes of UTF-16 without a mark": BASE.encode("utf-16-le"),
    "a mark of UTF-8": BASE.encode("utf-8-sig"),
}


@pytest.mark.parametrize("text", STRAY.values(), ids=STRAY)
def test_what_makers_do_to_files_stops_no_import(text: str | bytes, palpate: Palpate) -> None:
    found, notes = made(palpate, text, "--object", "2000", read_again=text != STRAY["bytes of UTF-16 without a mark"])
    device = found["device"]
    assert (device["vendor"], device["product"], device["known_by"]) == ("000004D2", "00000010", "identity")
    assert "object_2000_0" in found["field"]
    assert notes == [] or text == STRAY["bytes of UTF-16 without a mark"]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (BASE + var("2000", U8), "Note: section [2000] is there twice; line "),
        (BASE + "AccessType=wo\n", "Note: section [2001] has accesstype twice; line "),
        (BASE + "what is this\n", "is neither section nor key, and is not used: what is this"),
        (BASE + "[2002\n", "is no section, and is not used: [2002"),
        (BASE + node("300"), "Note: NodeID = 300 is no node id (1 to 127), and is not used"),
        (BASE + node("x"), "Note: NodeID 'x' is no whole number; it is not used"),
        (BASE + node("5", Baudrate="500000"), "Note: Baudrate = 500000 is taken in bit/s; CiA 306 has kbit/s"),
        (BASE + node("5", Baudrate="5"), "Left out: Baudrate: 5000 bit/s is no bit rate of CAN"),
        (BASE.replace("VendorNumber=0x4D2", "VendorNumber=001"), "1018:1 is 0x4D2, [DeviceInfo] VendorNumber 0x1"),
        (BASE + section("SupportedModules", NrOfEntries="2"), "has 2 kinds of modules, whose objects are not read"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_or_is_not_read_is_told(text: str, note: str, palpate: Palpate) -> None:
    found, notes = made(palpate, text, "--object", "2000")
    assert [each for each in notes if note in each], notes
    assert found["field"]["object_2000_0"]["type"] == "uint16"  # of two sections the first one counts


def test_notes_are_told_to_people_too_in_a_few_lines(palpate: Palpate) -> None:
    name = 'M\xfchle \xb0C"]\\n[x]'  # letters, and what is TOML
    text = BASE.replace("ProductName=Widget", f"ProductName={name}") + pdo(0, "0x20000181", MAPPED)
    text += pdo(1, "$NODEID+0x180", MAPPED) + pdo(4, "$NODEID+0x180", MAPPED)
    Path("a.eds").write_bytes((text + "rubbish\n" * 1000).encode("latin-1"))
    told = palpate("contracts", "import", "a.eds", "--out", "a.toml").out.splitlines()
    assert "Left out: PDO 1800h: its COB-ID 0x20000181 has 29 bits; a map holds those of 11" in told
    assert "Left out: PDO 1804h: has the COB-ID of PDO 1801h" in told
    assert "Note: 980 more lines are not used" in told
    assert (len(told), told[-1], read_map(Path("a.toml")).contract.title) == (24, "a.toml", name)


def test_the_second_reader_notices_what_is_wrong_and_what_is_lost(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test of a test: an importer with the faults that it looks for."""
    file = Path("a.dcf")
    file.write_text(node("5") + BASE + var("2002", I16, LowLimit="-3") + pdo(0, "$NODEID+0x180", MAPPED))
    right = second_reader.imported
    for old, new, fault in (
        ("base = 384", "base = 389", "COB-ID 18Ah at node 5"), ("minimum = -3", "minimum = -2", "2002:0: low -2"),
        ("minimum = -3", "", "2002:0: low '-3'"), ("index = 6144", "fixed = 6144", "PDO 1800h: can be set up"),
        ('access = "rw"\nminimum', "minimum", "int16 ro, int16 rw"),
        ('address = "2000:0"', 'address = "2003:0"', "holds"),
    ):  # fmt: skip
        monkeypatch.setattr(second_reader, "imported", lambda *given, o=old, n=new: right(*given).replace(o, n))
        assert [each for each in hold(file).faults if fault in each], (old, hold(file).faults)


# --- maps: exit statuses, one JSON object, and files that are not overwritten -------------------------


@pytest.fixture
def check(palpate: Palpate, tmp_path: Path) -> Callable[..., Spoken]:
    """Checks a map."""

    def checked(text: str, *options: str) -> Spoken:
        (tmp_path / "map.toml").write_text(text, encoding="utf-8")
        return palpate("contracts", "check", "map.toml", *options)

    return checked


def test_a_map_whose_frames_fit_is_proved(check: Callable[..., Spoken]) -> None:
    told = check(TRANSMITTER, "--json").object
    assert told["computed"] == ["command", "status", "gross", "net"]
    assert (told["printed"], told["without"], told["problems"]) == ([], [], [])
    assert told["sha256"] == read_map(Path("map.toml")).sha256


def test_a_makers_file_becomes_a_map_that_its_own_copy_is_compared_with(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet, file = tmp_path / "drive.eds", tmp_path / "drive.toml"
    sheet.write_text(drive(), encoding="utf-8")
    asked = ("contracts", "import", str(sheet), "--object", "6071", "--node", "4", "--out", str(file))
    assert (palpate(*asked).status, read_map(file).line.node) == (0, 4)
    assert "is there already" in palpate(*asked).complaint
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    assert palpate("contracts", "check", str(file), "--json").object["eds"] == f"{sheet}: compared"
    file.write_text(file.read_text().replace('type = "int16"', 'type = "uint16"').replace("minimum = -2000", ""))
    told = palpate("contracts", "check", str(file)).err
    assert "target_torque: type is 'uint16', in drive.eds it is 'int16'" in told
    sheet.write_text(drive() + "\n", encoding="utf-8")
    assert "the map was made from" in palpate("contracts", "check", str(file)).err


def test_frames_that_are_worked_out_complete_a_map(palpate: Palpate, check: Callable[..., Spoken]) -> None:
    bare = TRANSMITTER.partition("[[frame]]")[0]
    check(bare)
    assert check(bare + palpate("contracts", "frames", "map.toml").out, "--json").object["without"] == []


def test_the_list_has_our_kinds_and_the_shipped_maps(palpate: Palpate) -> None:
    rows = {row["kind"]: row["map"] for row in palpate("contracts", "list", "--json").object["kinds"]}
    assert (rows["positioner"], rows["flintec-dad-141"]) == (False, True)


MANUAL = """
[device]
name = "scale"
title = "scale"
bus = "modbus"
links = ["modbus-rtu"]
vendor = "Nobody"
known_by = "nothing"
[field.net]
address = 40001
type = "int16"
meaning = "net load"
"""
FRAME = """
[[frame]]
says = "read net"
request = "01 03 00 00 00 01 84 0A"
reply = "01 03 02 00 05 78 47"
values = { net = 5 }
origin = "printed"
"""


WRITABLE = MANUAL.replace('meaning = "net load"', 'meaning = "net load"\naccess = "rw"')
STATE = '[command.tare]\nfield = "net"\nvalue = 1\ndone = {{ field = "net", values = {} }}\n'
FRAME_1 = "frame 1 (read status, gross, net): gross: 1235 kg wanted (00 00 04 D3), 1234 found (00 00 04 D2)"


@pytest.mark.parametrize(
    ("text", "status", "told"),
    [
        (TRANSMITTER.replace("gross = 1234", "gross = 1235"), 1, f"palpate: error: map.toml: {FRAME_1}\n"),
        (TRANSMITTER.replace("address = 9", "address = 8"), 2, "gross and net overlap at 0x8"),
        *((MANUAL.replace("40001", at) + FRAME, 1, "; would fit with address = 0\n") for at in ("40001", "1", "7")),
        (MANUAL.replace("40001", "400001"), 2, "register 400001 of a manual has the address 0"),
        (MANUAL + "scale = 0\n", 2, "scale = 0; give a finite number other than 0"),
        (MANUAL + "scale = -0.1\n", 0, ""),
        *((WRITABLE + STATE.format(v), 2, "a int16 with these bits reads") for v in ("[0xFFFF]", "[-1, 0xFFFE]")),
    ],
)
def test_a_map_that_is_wrong_is_told_with_what_would_be_right(
    check: Callable[..., Spoken], text: str, status: int, told: str
) -> None:
    said = check(text)
    assert (said.status, told in said.err) == (status, True), said.err


def test_an_address_that_looks_like_the_number_of_a_register_is_warned_of(check: Callable[..., Spoken]) -> None:
    said = check(MANUAL)
    assert (said.status, "addresses count from 0: net = 40001" in " ".join(said.out.split())) == (0, True)
    (warning,) = check(MANUAL, "--json").object["warnings"]
    assert warning.endswith("net is 440002 here; if its manual says 40001, write address = 0")
    fitting = check(MANUAL.replace("40001", "0") + FRAME, "--json").object
    assert (fitting["printed"], fitting["warnings"]) == (["net"], [])
