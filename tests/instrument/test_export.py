"""The exported maps say what the contracts say, read back by the tools they are for."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import canopen
import cantools
import pytest

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.declaration import Pdo
from palpate.instrument.contracts.export import bench_dbc, export_contracts, register_table
from palpate.instrument.contracts.field import Field, sdo
from palpate.instrument.contracts.object_dictionary import object_dictionary
from palpate.instrument.errors import RecordError, UsageError
from tests.contracts import canopen_contract, modbus_contract
from tests.second_reader import hold

NODE = CONTRACTS["sensor_node"]
NAMES = ["registers.md", "sensor_node.eds", "bench.dbc"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("maps") / "not" / "yet"
    assert [path.name for path in export_contracts(folder)] == NAMES
    return folder


@pytest.fixture(scope="module")
def eds(folder: Path) -> Any:
    return canopen.import_od(str(folder / "sensor_node.eds"), 5)


@pytest.fixture(scope="module")
def dbc(folder: Path) -> Any:
    return cantools.database.load_file(folder / "bench.dbc")


# --- the files -----------------------------------------------------------------------------------------


def test_two_exports_are_the_same_bytes_in_another_process_on_another_day(folder: Path, tmp_path: Path) -> None:
    code = (
        "import datetime, pathlib, sys\n"
        "class Later(datetime.datetime):\n"
        "    @classmethod\n"
        "    def utcnow(cls): return cls(2031, 2, 3, 16, 5, 6)\n"
        "datetime.datetime = Later\n"
        "from palpate.instrument.contracts.export import export_contracts\n"
        "export_contracts(pathlib.Path(sys.argv[1]))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "12345", "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True, env=environment, timeout=60)
    for name in NAMES:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_an_export_writes_over_its_own_files_and_touches_no_other(folder: Path, tmp_path: Path) -> None:
    for name in (*NAMES, "notes.txt"):
        (tmp_path / name).write_text("before")
    export_contracts(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "before"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*NAMES, "notes.txt"])
    for name in NAMES:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize("blocked", ["folder", *NAMES])
def test_what_cannot_be_written_is_named_with_its_remedy(blocked: str, tmp_path: Path) -> None:
    if blocked == "folder":
        wrong = tmp_path / "maps"
        wrong.write_text("a file")
    else:
        wrong = tmp_path / "maps" / blocked
        wrong.mkdir(parents=True)
    with pytest.raises(RecordError, match=rf"^{re.escape(str(wrong))}: cannot be written: .+; name another folder$"):
        export_contracts(tmp_path / "maps")


def test_the_files_for_tools_are_plain_ascii(folder: Path) -> None:
    for name in NAMES[1:]:
        assert (folder / name).read_bytes().isascii(), name


def test_the_node_s_sheet_is_read_back_whole_by_the_importer_and_by_a_second_reader(folder: Path) -> None:
    found = hold(folder / "sensor_node.eds", 5)
    assert (found.objects > 20, found.faults) == (True, [])


# --- the register tables -------------------------------------------------------------------------------


def test_a_register_table_gives_every_field_whole() -> None:
    registers = modbus_contract(
        Field("speed", 0x10, "uint16", "of the belt", "m/s", 1e-3, "rw", 0.5, 20.0, 1.0),
        Field("mode", 0x11, "uint16", "a | b", access="rw", choices={"slow": 0, "fast": 2}, default=2),
        Field("status", 0x12, "uint16", "status", bits={"ready": 0, "hot": 3}),
        Field("order", 0x13, "uint16", "order", access="wo", minimum=1, maximum=1),
        Field("label", 0x14, "text", "label", access="rw", length=4, default="AB"),
    )
    head = """\
| address | name | type | unit | scale | access | limits | default | choices or bits | meaning |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""
    rows = """\
| 0x0010 | speed | uint16 | m/s | 0.001 | rw | 0.5 to 20 | 1 |  | of the belt |
| 0x0011 | mode | uint16 |  | 1 | rw |  | fast | 0 slow, 2 fast | a \\| b |
| 0x0012 | status | uint16 |  | 1 | ro |  | 0 | bit 0 ready, bit 3 hot | status |
| 0x0013 | order | uint16 |  | 1 | wo | 1 to 1 |  |  | order |
| 0x0014 | label | text |  |  | rw | up to 4 bytes | AB |  | label |
"""
    assert register_table(registers).rstrip() == (head + rows).rstrip()
    objects = canopen_contract(Field("sample", sdo(0x7130, 1), "int16", "sample", "V", 2e-3))
    row = "| 0x7130:01 | sample | int16 | V | 0.002 | ro |  | 0 |  | sample |"
    assert register_table(objects).rstrip() == head + row


def test_the_tables_say_whose_maps_they_are_and_what_they_imitate(folder: Path) -> None:
    text = (folder / "registers.md").read_text()
    assert "Palpate's own" in text
    for imitated in ("Waveshare", "Riden RD6006", "Hubert A1230", "Laumas TLB", "Dini Argeo", "Baumer"):
        assert imitated in text
    for contract in CONTRACTS.values():
        section = text.split(f"\n## {contract.title}\n")[1].split("\n## ")[0]
        assert register_table(contract) in section
        assert contract.digest() in section
        for part in (contract.identity.vendor, contract.identity.product, contract.identity.revision):
            assert part in section
        for pdo in contract.pdos:
            assert f"0x{pdo.base:X} + node id: {', '.join(pdo.fields)}." in section


# --- the EDS -------------------------------------------------------------------------------------------


def test_the_eds_names_the_maker_and_the_numbers_of_the_identity_object(eds: Any) -> None:
    device = eds.device_information
    assert (device.vendor_name, device.product_name) == ("Palpate", "sensor node")
    assert (device.vendor_number, device.product_number, device.revision_number) == (
        eds[0x1018][1].default, eds[0x1018][2].default, eds[0x1018][3].default,
    )  # fmt: skip
    assert (device.nr_of_TXPDO, device.nr_of_RXPDO) == (2, 0)
    assert device.allowed_baudrates == {1_000_000}
    assert NODE.digest() in eds.comments


# --- the DBC -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("node_id", [1, 7, 20])
def test_the_dbc_decodes_golden_samples_to_their_counts(node_id: int, dbc: Any) -> None:
    frame = bytes.fromhex("01 00 ff ff ff 7f 00 80")
    assert dbc.decode_message(0x180 + node_id, frame) == {
        "sample_1": 1, "sample_2": -1, "sample_3": 32767, "sample_4": -32768,
    }  # fmt: skip


@pytest.mark.parametrize("node_id", [1, 7, 20])
def test_the_dbc_decodes_a_golden_stamp_heartbeat_emergency_and_sync(node_id: int, dbc: Any) -> None:
    stamp = dbc.decode_message(0x280 + node_id, bytes.fromhex("04 03 02 f1 05"))
    assert stamp == {"sample_counter": 0xF1020304, "saturation": 0b0101}
    assert dbc.decode_message(0x700 + node_id, b"\x05") == {"nmt_state": "operational"}
    emergency = dbc.decode_message(0x80 + node_id, bytes.fromhex("01 ff 04 11 22 33 44 55"))
    assert emergency == {"error_code": 0xFF01, "error_register": 4, "manufacturer": 0x5544332211}
    assert dbc.decode_message(0x80, b"") == {}


def test_the_dbc_has_five_kinds_of_message_for_nodes_1_to_20_and_no_other(dbc: Any) -> None:
    expected = {0x80: ("SYNC", 0)}
    for n in range(1, 21):
        expected |= {
            0x180 + n: (f"SN{n:02d}_samples", 8),
            0x280 + n: (f"SN{n:02d}_stamp", 5),
            0x700 + n: (f"SN{n:02d}_heartbeat", 1),
            0x80 + n: (f"SN{n:02d}_emergency", 8),
        }
    assert {m.frame_id: (m.name, m.length) for m in dbc.messages} == expected


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"minimum": -40.0, "maximum": 125.0}, (-40.0, 125.0)),
        ({"minimum": -40.0}, (-3276.8, 3276.7)),
        ({"maximum": 125.0}, (-3276.8, 3276.7)),
    ],
)
def test_a_scaled_field_keeps_both_limits_in_the_dbc_or_has_those_of_its_width(
    limits: dict[str, float], expected: tuple[float, float]
) -> None:
    warm = Field("warm", 0x400001, "int16", "temperature", "degC", 0.1, **limits)  # type: ignore[arg-type]
    node = replace(NODE, fields=(*NODE.fields, warm), pdos=(Pdo("heat", 0x180, ("saturation", "warm")),))
    dbc: Any = cantools.database.load_string(bench_dbc(node), "dbc")
    bits, signal = dbc.get_message_by_name("SN01_heat").signals
    assert bits.comment.endswith(", ".join(f"bit {number} {bit}" for bit, number in NODE["saturation"].bits.items()))
    assert (signal.start, signal.scale, signal.unit, signal.comment) == (8, 0.1, "degC", "temperature")
    assert (signal.minimum, signal.maximum) == pytest.approx(expected)
    assert dbc.decode_message("SN01_heat", b"\x00\xfb\xff") == {"saturation": 0, "warm": -0.5}


def test_without_the_library_of_a_dbc_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cantools", None)
    with pytest.raises(UsageError, match=r"cantools cannot be imported .*pip install 'palpate\[dbc\]'"):
        export_contracts(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_objects_of_the_eds_are_variables_records_or_arrays_by_index_and_subindices() -> None:
    """A variable where subindex 0 alone is declared; below 2000h (communication, CiA 301) a record, else an array."""
    fields = (
        Field("lone", sdo(0x1F00), "uint8", "alone"),
        Field("first_1", sdo(0x1F01, 1), "uint8", "alone behind its number"),
        Field("own_1", sdo(0x2000, 1), "uint16", "of ours", minimum=1),
        Field("own_2", sdo(0x2000, 2), "uint16", "of ours", minimum=1, maximum=9, default=2),
    )
    dictionary = object_dictionary(replace(NODE, fields=fields, pdos=()))
    kinds = {index: type(item).__name__ for index, item in dictionary.items()}
    assert kinds == {0x1F00: "ODVariable", 0x1F01: "ODRecord", 0x2000: "ODArray"}
    assert (dictionary[0x1F01].name, dictionary[0x2000].name) == ("first", "own")
    assert dictionary[0x1F01][0].default == 1
    assert dictionary[0x2000][0].default == 2
    one, two = dictionary[0x2000][1], dictionary[0x2000][2]
    assert ((one.min, one.max), (two.min, two.max, two.default)) == ((None, None), (1, 9, 2))
    assert [variable.pdo_mappable for variable in (one, two)] == [False, False]
