"""A file of another kind than the one that is asked for is one line, not a list of all its keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.simulators.scenes.heads import shipped
from tests.procedures.conftest import Palpate

BENCH = """name = "lab"
force_limit = "10 N"
[link.line]
kind = "modbus-rtu"
port = "/dev/none"
"""


@pytest.fixture
def files(palpate: Palpate) -> None:
    Path("bench.toml").write_text(BENCH, encoding="utf-8")
    Path("scene.toml").write_bytes(shipped()["thesis_single"].read_bytes())
    Path("study.toml").write_bytes((Path(__file__).parents[1] / "examples" / "study.toml").read_bytes())
    write_calibration(Path("cell.toml"), THESIS_LOAD_CELL)


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("calibrate", "accept", "bench.toml"),
            "bench.toml: is no calibration of a load cell: it has force_limit, link, name,",
        ),
        (("calibrate", "accept", "scene.toml"), "scene.toml: is no calibration of a load cell: it has design, "),
        (("sweep", "loads", "--bench", "scene.toml"), "scene.toml: is no bench: it has "),
        (("sweep", "loads", "--bench", "cell.toml"), "cell.toml: is no bench: it has astm_e74, "),
        (
            ("sweep", "loads", "--scene", "bench.toml"),
            "bench.toml: is no scene: it has force_limit, link, and it l",
        ),
        (("sweep", "loads", "--scene", "study.toml"), "study.toml: is no scene: it has axes, "),
        (("study", "bench.toml"), "bench.toml: is no study: it has force_limit, link, and it lacks axes; give"),
        (("study", "cell.toml"), "cell.toml: is no study: it has astm_e74, "),
        (("runs", "show", "bench.toml"), "bench.toml is a file, and no run; give the folder of a run"),
    ],
)
def test_a_file_of_another_kind_is_named_as_such(palpate: Palpate, words: tuple[str, ...], message: str) -> None:
    said = palpate(*words)
    assert said.status == 2
    assert said.complaint.startswith(message)
    assert len(said.complaint.splitlines()) == 1


def test_a_few_wrong_keys_are_still_told_one_by_one(palpate: Palpate) -> None:
    Path("bench.toml").write_text('watchdgo = "2 s"\n' + BENCH, encoding="utf-8")
    assert "watchdgo: unknown key (did you mean 'watchdog'?)" in palpate("sweep", "loads", "--bench", "bench.toml").err
