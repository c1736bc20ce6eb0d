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
