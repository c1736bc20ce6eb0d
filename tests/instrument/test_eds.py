"""Maps from EDS and DCF files. The files are written here from facts; none of a maker's is in this repository."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from palpate.instrument.contracts.field import sdo
from palpate.instrument.contracts.maps.eds import LARGEST_SHEET, imported
from palpate.instrument.contracts.maps.map_file import DeviceMap, map_of
from palpate.instrument.errors import ConfigError

HEAD = """[FileInfo]
FileName=drive
[Comments]
Lines=9
Line1=the number of lines is wrong
[DeviceInfo]
VendorName=Maker
VendorNumber=
ProductName=Drive 50/15
[DeviceComissioning]
NodeID={node}
"""
OTHERS = {"PDOMapping": "0", "ObjectType": "0x7", "ParameterName": "a text of the maker"}


def section(address: str, **keys: str) -> str:
    lines = [f"{key}={value}" for key, value in (OTHERS | keys).items()]
    return "\n".join([f"[{address}]", *lines, ""])


def record(index: str, **members: tuple[str, str, str, str]) -> str:
    """An object with subindices, each with data type, access, default and configured value."""
    text = section(index, ObjectType="0x9")
    count = ("0x5", "rw" if index.startswith("1A") else "ro", str(len(members)), "")  # of a mapping that can be changed
    for sub, (type_, access, default, value) in {"sub0": count, **members}.items():
        keys = {"DataType": type_, "AccessType": access}
        keys |= {key: given for key, given in (("DefaultValue", default), ("ParameterValue", value)) if given}
        text += section(f"{index}{sub}", **keys)
    return text


def drive(node: str = "", cob_id: str = "", mapping: str = "") -> str:
    """A drive: its identity is only in the values of a configured device, as in some makers' DCFs."""
    return HEAD.format(node=node or "0") + "".join([
        section("1000", DataType="0x7", AccessType="const", DefaultValue="0x20192"),
        record("1018", sub1=("0x7", "ro", "", "0xFB"), sub2=("0x7", "ro", "", "0x65520000"),
               sub3=("0x7", "ro", "", "0x01700000"), sub4=("0x7", "ro", "", "0x29002021")),
        section("1021", DataType="0xF", AccessType="ro"),
        record("1800", sub1=("0x7", "rw", "$NODEID+0x40000180", cob_id), sub2=("0x5", "rw", "255", "")),
        record("1801", sub1=("0x7", "rw", "$NODEID + 0xC0000280", ""), sub2=("0x5", "rw", "255", "")),
        record("1A00", sub1=("0x7", "rw", "0x60410010", mapping), sub2=("0x7", "rw", "0x81300118", "")),
        record("1A01", sub1=("0x7", "rw", "0x60410010", "")),
        section("6041", DataType="0x6", AccessType="ro", PDOMapping="1"),
        section("6071", DataType="0x3", AccessType="rww", LowLimit="-2000", HighLimit="2000", DefaultValue="0"),
        section("6072", DataType="0x6", AccessType="rw", LowLimit="0", HighLimit="0", DefaultValue="1000"),
        record("8130", sub1=("0x10", "ro", "", "")),
    ])  # fmt: skip


def of(folder: Path, text: str, *objects: str, name: str = "drive.eds") -> DeviceMap:
    file = folder / name
    file.write_text(text, encoding="latin-1")
    return map_of(folder / "drive.toml", imported(file, objects).encode())


def test_a_map_is_made_of_a_makers_file_without_its_texts(tmp_path: Path) -> None:
    found = of(tmp_path, drive(), "6071=torque", "6072")
    contract = found.contract
    assert (contract.name, found.links) == ("drive-50-15", ("canopen",))
    identity = contract.identity
    assert (identity.vendor, identity.product, identity.revision) == ("000000FB", "65520000", "01700000")
    assert (contract.known_by, contract.serial) == ("identity", "serial")
    torque, limit = contract["torque"], contract["torque_limit"]
    assert (torque.address, torque.type, torque.access, torque.limits) == (sdo(0x6071), "int16", "rw", (-2000, 2000))
    assert (limit.minimum, limit.maximum, limit.default) == (None, None, 1000)  # 0 to 0 is no limit
    assert contract["process_value_24_1"].type == "int24"
    (pdo,) = contract.pdos  # bit 31 switches the second one off
    assert (pdo.index, pdo.transmission) == (0x1800, 255)
    assert (pdo.base, pdo.fields) == (0x180, ("statusword", "process_value_24_1"))
    assert "text of the maker" not in imported(tmp_path / "drive.eds", ["6071"])
    assert found.eds is not None
    assert found.eds.sha256 == hashlib.sha256((tmp_path / "drive.eds").read_bytes()).hexdigest()


def test_a_configured_file_tells_its_node_and_its_own_mapping_but_cob_ids_of_any_node(tmp_path: Path) -> None:
    found = of(tmp_path, drive(node="5", cob_id="0x185", mapping="0x60710010"), "6071")
    assert (found.line.node, found.contract.pdos[0].base) == (5, 0x180)
    assert found.contract.pdos[0].fields == ("target_torque", "process_value_24_1")


@pytest.mark.parametrize(
    ("objects", "wrong"),
    [
        (["1021"], "drive.eds: 1021:0: its type DOMAIN cannot be used; valid: BOOLEAN, INTEGER8,"),
        (["6075"], "drive.eds: 6075:0: it has no such object"),
        (["1018:9", "6099"], "drive.eds: 1018:9: it has subindices 0, 1, 2, 3, 4\ndrive.eds: 6099:0: it has no such"),
        (["torque"], "object 'torque': give index and subindex in hexadecimal, as \"6401:1\""),
        (["6071=Torque!"], "object '6071=Torque!': give index and subindex in hexadecimal, as \"6401:1\""),
        (["6071=statusword"], "drive.eds: 2 objects are called statusword; name them apart"),
    ],
)
def test_objects_that_cannot_be_used_are_refused_by_name(objects: list[str], wrong: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        of(tmp_path, drive(), *objects)
    assert wrong in str(refused.value)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "has no section [DeviceInfo]; give an EDS or DCF"),
        (HEAD.format(node=0), "has no objects; give an EDS or DCF"),
        ("[DeviceInfo", "has no section [DeviceInfo]"),
        ("nothing\n[DeviceInfo]", "has no objects; give an EDS or DCF"),
        (drive().replace("DataType=0x3", "DataType=many"), "6071:0: has no DataType; valid: BOOLEAN, INTEGER8,"),
        (drive().replace("AccessType=rww", "AccessType=maybe"), "6071:0: its access 'maybe' is unknown; valid: const"),
    ],
)
def test_a_file_that_is_none_is_refused(text: str, wrong: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        of(tmp_path, text, "6071")
    assert str(refused.value).startswith((str(tmp_path / "drive.eds"), "drive.eds"))
    assert wrong in str(refused.value)


def test_a_name_in_a_file_reaches_no_terminal(tmp_path: Path) -> None:
    """What the maker writes may hold orders to a terminal; a title and notes go there."""
    file = tmp_path / "hostile.eds"
    strange = drive().replace("Drive 50/15", "\x1b[2JDrive") + "[20\x1b[2J00\nx\x1b]0;\n"
    file.write_text(strange + section("2000", DataType="\x1b[2J", AccessType="\x1b[2J", LowLimit="\x1b[2J"))
    told: list[str] = []
    text = imported(file, (), tell=told.append)
    assert told
    assert "\x1b" not in text + "".join(told)
    with pytest.raises(ConfigError) as refused:
        imported(file, ["2000"])
    assert "\x1b" not in str(refused.value)


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    file = tmp_path / "drive.eds"
    with file.open("wb") as opened:
        opened.truncate(LARGEST_SHEET + 1)
    with pytest.raises(ConfigError, match=r"drive.eds: larger than 10000000 bytes"):
        imported(file, ())
