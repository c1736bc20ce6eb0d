"""What `palpate contracts` promises about maps: exit statuses, one JSON object, and files that are not overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.instrument.contracts.maps.eds import FOLDERS
from palpate.instrument.contracts.maps.map_file import read_map
from tests.instrument.test_eds import drive
from tests.instrument.test_map_files import TRANSMITTER
from tests.procedures.conftest import Palpate


def test_a_map_whose_frames_fit_is_proved(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(TRANSMITTER, encoding="utf-8")
    said = palpate("contracts", "check", str(file), "--json")
    assert (said.status, said.err) == (0, "")
    told = json.loads(said.out)
    assert told["computed"] == ["command", "status", "gross", "net"]
    assert (told["printed"], told["without"], told["problems"]) == ([], [], [])
    assert told["sha256"] == read_map(file).sha256


def test_a_frame_that_does_not_fit_is_exit_status_1_and_names_file_frame_field_and_values(
    palpate: Palpate, tmp_path: Path
) -> None:
    file = tmp_path / "map.toml"
    file.write_text(TRANSMITTER.replace("gross = 1234", "gross = 1235"), encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert said.status == 1
    frame = "frame 1 (read status, gross, net): gross: 1235 kg wanted (00 00 04 D3), 1234 found (00 00 04 D2)"
    assert said.err.strip() == f"palpate: error: {file}: {frame}"


def test_a_map_that_says_something_impossible_is_exit_status_2(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(TRANSMITTER.replace("address = 9", "address = 8"), encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert said.status == 2
    assert "gross and net overlap at 0x8" in said.err


def test_a_makers_file_becomes_a_map_that_its_own_copy_is_compared_with(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet, file = tmp_path / "drive.eds", tmp_path / "drive.toml"
    sheet.write_text(drive(), encoding="utf-8")
    asked = ("contracts", "import", str(sheet), "--object", "6071", "--node", "4", "--out", str(file))
    assert palpate(*asked).status == 0
    assert read_map(file).line.node == 4
    again = palpate(*asked)
    assert (again.status, "is there already" in again.err) == (2, True)
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    assert json.loads(palpate("contracts", "check", str(file), "--json").out)["eds"] == f"{sheet}: compared"
    file.write_text(file.read_text().replace('type = "int16"', 'type = "uint16"').replace("minimum = -2000", ""))
    said = palpate("contracts", "check", str(file))
    assert (said.status, "target_torque: type is 'uint16', in drive.eds it is 'int16'" in said.err) == (1, True)
    sheet.write_text(drive() + "\n", encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert (said.status, "the map was made from" in said.err) == (1, True)


def test_frames_that_are_worked_out_complete_a_map(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(TRANSMITTER.partition("[[frame]]")[0], encoding="utf-8")
    file.write_text(file.read_text() + palpate("contracts", "frames", str(file)).out, encoding="utf-8")
    assert json.loads(palpate("contracts", "check", str(file), "--json").out)["without"] == []


def test_the_list_has_our_kinds_and_the_shipped_maps(palpate: Palpate) -> None:
    rows = {row["kind"]: row["map"] for row in json.loads(palpate("contracts", "list", "--json").out)["kinds"]}
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


def test_an_address_that_looks_like_the_number_of_a_register_is_warned_of(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(MANUAL, encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert said.status == 0
    assert "addresses count from 0: net = 40001" in " ".join(said.out.split())
    (warning,) = json.loads(palpate("contracts", "check", str(file), "--json").out)["warnings"]
    assert warning.endswith("net is 440002 here; if its manual says 40001, write address = 0")
    file.write_text(MANUAL.replace("40001", "0") + FRAME, encoding="utf-8")
    fitting = json.loads(palpate("contracts", "check", str(file), "--json").out)
    assert (fitting["printed"], fitting["warnings"]) == (["net"], [])


@pytest.mark.parametrize("address", [40001, 1, 7])
def test_a_frame_that_fits_another_address_tells_which(address: int, palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(MANUAL.replace("40001", str(address)) + FRAME, encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert (said.status, said.err.rstrip().endswith("; would fit with address = 0")) == (1, True)


def test_a_register_beyond_all_addresses_is_told_how_manuals_count(palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(MANUAL.replace("40001", "400001"), encoding="utf-8")
    assert "register 400001 of a manual has the address 0" in palpate("contracts", "check", str(file)).complaint


@pytest.mark.parametrize(("scale", "wrong"), [("0", "scale = 0; give a finite number other than 0"), ("-0.1", "")])
def test_a_negative_scale_is_taken_and_none_is_not(scale: str, wrong: str, palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    file.write_text(MANUAL + f"scale = {scale}\n", encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert (said.status, wrong in said.err) == (2 if wrong else 0, True)


@pytest.mark.parametrize("values", ["[0xFFFF]", "[-1, 0xFFFE]"])
def test_a_state_that_no_signed_field_reads_is_refused(values: str, palpate: Palpate, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    writable = MANUAL.replace('meaning = "net load"', 'meaning = "net load"\naccess = "rw"')
    command = f'[command.tare]\nfield = "net"\nvalue = 1\ndone = {{ field = "net", values = {values} }}\n'
    file.write_text(writable + command, encoding="utf-8")
    said = palpate("contracts", "check", str(file))
    assert (said.status, "a int16 with these bits reads" in said.err) == (2, True)
