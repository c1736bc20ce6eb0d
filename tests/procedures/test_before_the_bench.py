"""What store and scene tell already is refused before a bench is opened."""

from __future__ import annotations

import re
from contextlib import nullcontext
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from palpate import ConfigError, RangeError
from palpate.extend import read_bench, read_scene
from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.procedures.lab import open as session
from palpate.procedures.lab.calibrations import check_nameable, check_store, path_of
from tests.fuzz.files import BENCH
from tests.procedures.conftest import Palpate

TODAY = date(2026, 11, 21)
SIMULATED: dict[str, object] = {"simulated": True, "scene": read_scene("thesis_single").identity}


@pytest.fixture(autouse=True)
def unopened(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("simulated_bench", "driven_bench"):
        monkeypatch.setattr(session, name, Mock(side_effect=AssertionError("the bench was opened")))


def stored(device: str, **changed: object) -> None:
    """A load-cell calibration in the store: of a real bench, unless `changed` says otherwise."""
    calibration = THESIS_LOAD_CELL.model_copy(update={"device": device, **changed})
    path = path_of(LoadCellCalibration, calibration.owner)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, calibration)


@pytest.mark.parametrize("rehearsal", [(), ("--dry-run",)])
@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("--out", "/proc/palpate"), 1, "cannot write /proc/palpate: "),
        (("--out", "new/file/x"), 1, "cannot write new/file/x: Not a directory; choose a writable folder with --out"),
        (
            ("--out", "dir.blf/link"),
            1,
            "dir.blf/link is a link to nothing, which does not exist; choose a writable folder",
        ),
        (("--out", "new/file"), 1, "new/file is a file, not a folder; choose a writable folder with --out or $PALPATE"),
        (("--out", "new"), 2, "new holds other files; choose a new or empty folder with --out"),
        (("--log", "trace.txt"), 2, "--log trace.txt: the name must end in .pcapng (everything), .blf or .asc (CAN)"),
        (("--log", "dir.blf"), 2, "--log dir.blf: dir.blf exists already; give another name"),
        (("--log", "no/trace.blf"), 1, "no/trace.blf: the bus log cannot be written: No such file or directory"),
        (("--out", "made/day", "--log", "/proc/trace.blf"), 1, "/proc/trace.blf: the bus log cannot be written: "),
    ],
)
def test_a_dry_run_refuses_the_places_that_the_run_refuses_and_neither_leaves_anything(
    palpate: Palpate, arguments: tuple[str, ...], status: int, message: str, rehearsal: tuple[str, ...]
) -> None:
    for folder in ("dir.blf", "new"):
        Path(folder).mkdir()
    Path("new/file").touch()
    Path("dir.blf/link").symlink_to("nothing")
    said = palpate("sweep", "loads", *arguments, *rehearsal)
    assert (said.status, message in said.complaint) == (status, True), said.complaint
    assert sorted(str(path) for path in Path().rglob("*")) == ["dir.blf", "dir.blf/link", "new", "new/file"]


def test_a_dry_run_leaves_no_folder_and_no_log(palpate: Palpate) -> None:
    Path("mine").mkdir()
    for out in ("made/day", "mine"):
        assert palpate("sweep", "loads", "--dry-run", "--out", out, "--log", f"{out}/trace.asc").status == 0
    assert [str(path) for path in Path().rglob("*")] == ["mine"]


def test_a_stored_calibration_of_the_simulated_bench_counts_and_not_the_thesis_own(palpate: Palpate) -> None:
    stored("SIM-SI-0001", **SIMULATED, greatest_N=3.5)
    assert "outside the 1.373 to 3.5 N" in palpate("sweep", "loads").complaint


def test_a_dry_run_says_that_a_real_bench_has_no_calibration_yet(palpate: Palpate) -> None:
    """Only the open bench tells whether it is real."""
    Path("lab.toml").write_bytes(BENCH)
    rehearsed = ("sweep", "loads", "--bench", "lab.toml", "--dry-run", "--json")
    note = "no stored calibration of a real bench covers these loads: run palpate calibrate load-cell there"
    assert palpate(*rehearsed).err == f"palpate: note: {note}\n"
    stored("SIM-SI-0001", **SIMULATED)
    assert palpate(*rehearsed).err == f"palpate: note: {note}\n"
    stored("SI-1")
    assert palpate(*rehearsed).err == palpate("sweep", "loads", "--dry-run").err == ""


def test_of_several_calibrations_one_that_tells_the_loads_is_enough(palpate: Palpate) -> None:
    stored("SI-1", greatest_N=3.5)
    stored("SI-2", greatest_N=9.0)
    check_store([2.0, 8.0], extrapolate=False, scene=None, today=TODAY)
    with pytest.raises(RangeError, match=r"load 8 N lies outside the 1\.373 to 7\.257 N"):
        check_store([2.0, 8.0], extrapolate=False, scene="ab12", today=TODAY)
    check_store([2.0, 8.0], extrapolate=True, scene="ab12", today=TODAY)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("serve", "ideal", "--line", "/proc/x"), "directory; choose a name in a writable folder with --line"),
        (("serve", "ideal", "--line", "no/x"), "make the folder no, or choose a name in a writable folder with --line"),
        (("serve", "ideal", "--out", "no/x"), "make the folder no, or choose a file in a writable folder with --out"),
        pytest.param(
            ("contracts", "export", "--to", "file"),
            "file is a file, not a folder; name another folder",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_remedy_for_a_place_that_cannot_be_written_names_the_option_that_sets_it(
    palpate: Palpate, arguments: tuple[str, ...], message: str
) -> None:
    Path("file").touch()
    said = palpate(*arguments)
    assert said.status == 1
    assert said.complaint.endswith(message)


def test_a_store_that_is_a_file_is_named(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("file").touch()
    monkeypatch.setenv("PALPATE_STORE", "file")
    assert "file is a file, not a folder; choose a writable folder" in palpate("sweep", "loads").complaint
    assert palpate("runs", "list").complaint == "file is no folder; name one that holds runs with --out"


MAKERS_BENCH = """
name = "makers"
[link.can]
kind = "canopen"
interface = "socketcan"
channel = "can9"
bitrate = 1000000
[link.line]
kind = "modbus-rtu"
port = "/dev/ttyUSB9"
[device.exciter]
kind = "maxon-epos4"
link = "can"
node = 1
full_scale = 0.5
[device.load_cell]
kind = "flintec-dad-141"
link = "line"
unit = 1
inventory = "LAB-1"
span = 10.306
filter = 0
[device.stage]
kind = "nanotec-c5-e"
link = "can"
node = 2
metres_per_step = 0.5e-6
travel = "50 mm"
[device.films]
kind = "canopennode-io"
link = "can"
node = 3
set_to_link = true
volts_per_unit = 1.5e-5
"""
EXCITER = MAKERS_BENCH[MAKERS_BENCH.index("[device.exciter]") : MAKERS_BENCH.index("[device.load_cell]")]
STAGE = MAKERS_BENCH[MAKERS_BENCH.index("[device.stage]") : MAKERS_BENCH.index("[device.films]")]


@pytest.mark.parametrize(
    ("old", "new", "frequency", "message"),
    [
        ("filter = 0", "filter = 4", "10 Hz", "write filter = 0 in its section"),
        ("filter = 0", "filter = 99", "10 Hz", "filter = 99 is no level of its filter; valid: 0, 1"),
        ("filter = 0", 'filter = 0\nbandwidth = "9 Hz"', "10 Hz", "the device itself tells its bandwidth"),
        ("", "", "20 Hz", "drive at up to 11.6 Hz"),
        (
            "volts_per_unit = 1.5e-5",
            "",
            "10 Hz",
            "volts_per_unit in its section of the bench file: the node reads counts",
        ),
        (EXCITER, "", "10 Hz", "has no exciter; add a device"),
        (STAGE, "", "10 Hz", "has no positioner; add a device"),
    ],
)
def test_a_rehearsal_tells_which_load_the_devices_of_a_bench_file_cannot_do(
    palpate: Palpate, old: str, new: str, frequency: str, message: str
) -> None:
    Path("bench.toml").write_text(MAKERS_BENCH.replace(old, new, 1))
    said = palpate("sweep", "loads", "--bench", "bench.toml", "--frequency", frequency, "--dry-run")
    assert message in said.complaint


@pytest.mark.parametrize(
    ("frequency", "message"),
    [
        ("20 Hz", "load_cell: its readings (filter_level = 0: 17 Hz, 600 a second) lose up to 48 % of a force at 20"),
        ("100 Hz", "exciter: frequency = 100 Hz is outside 0.00391 to 50 Hz"),
    ],
)
@pytest.mark.parametrize("rehearsal", [(), ("--dry-run",)])
def test_a_load_that_the_devices_of_a_scene_cannot_do_is_refused_before_they_are_simulated(
    palpate: Palpate, rehearsal: tuple[str, ...], frequency: str, message: str
) -> None:
    said = palpate("sweep", "loads", "--scene", "real_bench", "--frequency", frequency, *rehearsal)
    assert message in said.complaint


def test_all_that_the_sections_of_a_bench_file_lack_is_told_at_once_each_with_its_unit(palpate: Palpate) -> None:
    Path("bench.toml").write_text(re.sub("(full_scale|span|metres_per_step|travel) = .*\\n", "", MAKERS_BENCH))
    said = palpate("sweep", "loads", "--bench", "bench.toml", "--dry-run").complaint
    for told in (
        "device.exciter: full_scale: is missing; give the share of its rated effort that 10 V stand for",
        "device.load_cell: span: is missing; give the mV of the load cell for one unit of the display",
        "device.stage: metres_per_step: is missing; give the lead of the screw by the steps of a turn in m",
        'device.stage: travel: is missing; give the lowest position, downwards from home, as "50 mm"',
    ):
        assert told in said


@pytest.mark.parametrize(("more", "simulated"), [("", True), ("", False), ('inventory = "N-3"\n', False)])
def test_a_calibration_is_not_for_any_node_that_tells_no_serial_number(
    more: str, simulated: bool, tmp_path: Path
) -> None:
    """A CANopenNode tells none: its films' calibration would pass for that of the films at another one."""
    (tmp_path / "bench.toml").write_text(MAKERS_BENCH + more)
    bench: Any = SimpleNamespace(description=read_bench(tmp_path / "bench.toml"), simulated=simulated)
    refused = pytest.raises(ConfigError, match=r"device\.films: .*write inventory = \"LABEL\"")
    with nullcontext() if more or simulated else refused:
        check_nameable(bench, "sensor_node")
    check_nameable(bench, "load_indicator")


def test_a_rehearsal_of_a_bench_of_makers_opens_nothing(palpate: Palpate) -> None:
    Path("bench.toml").write_text(MAKERS_BENCH)
    said = palpate("sweep", "loads", "--bench", "bench.toml", "--dry-run", "--quiet")
    assert (said.status, said.err) == (0, "")
