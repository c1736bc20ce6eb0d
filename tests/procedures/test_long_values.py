"""Settings of Python that are too long to be quoted, and names that no file can have, are one short error."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

import palpate
from palpate.extend import Procedure, Target
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.errors import PalpateError, UsageError
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import parse_samples
from palpate.procedures.engine.run import prepared
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.export import export
from palpate.procedures.study.results import read_results

MANY = 100_000
NUL = "a\0b"
TARGET = Target(get_design("single"), 10.0, 1)


@pytest.mark.parametrize(
    "procedure",
    [
        palpate.LoadSweep(loads=("x",) * 1000),  # type: ignore[arg-type]
        palpate.LoadSweep(loads=(3.0, 2.0) * MANY),
        palpate.LoadSweep(samples=("1",) * MANY),
        palpate.LoadSweep(samples=("x" * MANY,)),
        palpate.ModulusTest("1", strain="x" * MANY),  # type: ignore[arg-type]
        palpate.LoadCellSeries(loads=(2.0,) * MANY),
    ],
    ids=["types", "loads", "samples", "name", "text", "weights"],
)
def test_of_a_long_setting_a_message_quotes_a_few_values(procedure: Procedure) -> None:  # type: ignore[type-arg]
    with pytest.raises(PalpateError) as raised:
        prepared(procedure, TARGET)
    assert len(str(raised.value)) < 600


def test_of_a_long_text_a_message_quotes_the_beginning() -> None:
    for text in (",".join(["1"] * MANY), "x" * MANY, "1-" + " " * MANY):
        with pytest.raises(PalpateError) as raised:
            parse_samples(text)
        assert len(str(raised.value)) < 600
    for text in ("9" * MANY, "9 " + "x" * MANY, "9" * 300 + "." + "0" * MANY + " kg"):
        with pytest.raises(PalpateError) as raised:
            parse(text, "N")
        assert len(str(raised.value)) < 600


def opened(**where: str) -> None:
    with palpate.open_bench(**where):  # type: ignore[arg-type]
        pass


def made(folder: Path) -> None:
    with result_folder(folder, "sweep-loads", datetime.now(UTC)):
        pass


@pytest.mark.parametrize(
    "use",
    [
        lambda: palpate.read(NUL),
        lambda: palpate.resume(NUL),
        lambda: opened(bench=NUL),
        lambda: opened(scene=NUL),
        lambda: opened(scene="ideal", log=f"{NUL}.pcapng"),
        lambda: made(Path(NUL)),
        lambda: read_calibration(NUL, LoadCellCalibration),
        lambda: write_calibration(Path(NUL), THESIS_LOAD_CELL),
        lambda: read_results(Path(NUL)),
        lambda: export(None, "csv", Path(NUL)),
    ],
    ids=["read", "resume", "bench", "scene", "log", "out", "calibration", "written", "study", "export"],
)
def test_a_name_with_a_zero_byte_is_refused(use: Callable[[], object]) -> None:
    with pytest.raises(UsageError, match=r"'a\\x00b(\.pcapng)?'"):
        use()
