"""A load-cell calibration survives its file, and a file that is wrong is refused."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from random import Random

import pytest

from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, Classification, Curvature, LoadCellCalibration
from palpate.instrument.errors import ConfigError, RecordError


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("text", ["A", "\0", 'a "quoted"\n\r\ttext \\', "\u00b5\u2028\U0001f4a7\x7f"])
def test_a_calibration_comes_back_from_its_file_bit_by_bit(tmp_path: Path, text: str, simulated: bool) -> None:
    draw = Random(text)
    values = [10.0 ** draw.uniform(-6, 6) for _ in range(6)]
    zero, correlation = draw.choice([-1e9, 0.1, -0.0, 1e-300]), draw.choice([-1.0, 1.0, draw.random()])
    calibration = LoadCellCalibration(
        sensitivity_mV_per_N=values[0],
        sensitivity_u=values[1],
        zero_mV=zero,
        zero_u=values[2],
        covariance=correlation * values[1] * values[2],
        degrees_of_freedom=5,
        least_N=-values[0],
        greatest_N=values[1],
        linearity=values[3],
        reversibility=values[4],
        reversibility_of_reading=values[2],
        interpolation=values[3],
        creep=values[0],
        lower_limit_factor_N=values[5],
        astm_e74=Classification(name="A", least_N=values[0], greatest_N=values[1]),
        iso_376=Classification(name="not classifiable", reason=text),
        gage_factor=values[1],
        expires="2020-02-29",
        curvature=Curvature(mV_per_N2=zero, u=values[3], with_sensitivity=0.0, with_zero=0.0),
        resolution_mV=values[5],
        device=text,
        simulated=simulated,
        source=text,
        created=text,
    )
    path = tmp_path / "load_cell.toml"
    write_calibration(path, calibration)
    assert read_calibration(path, LoadCellCalibration) == calibration
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("linearity", "lineraity", r"lineraity: unknown key \(did you mean 'linearity'\?\)"),
        ("linearity", "lineraity", "linearity: is missing"),
        ("resolution_mV = 1.0", "resolution_mV = -1.0", r"resolution_mV: -1\.0 is too small; give more than 0"),
        ("resolution_mV = 1.0", "resolution_mV = nan", "resolution_mV: nan is not finite; give a number"),
        ("resolution_mV = 1.0", 'resolution_mV = "1"', "resolution_mV: '1' is no number; give one without quotes"),
        ("reversibility = ", "reversibility = -", r"reversibility: -[0-9.e-]+ is too small; give at least 0"),
        (
            "simulated = false",
            "simulated = 0",
            "simulated: 0 is neither true nor false",
        ),
        ("covariance = -", "covariance = -9", r"covariance: -90\.0134 exceeds sensitivity_u · zero_u = 0\.0146682"),
        ("simulated = false", "simulated = ", "is not TOML"),
        ("least_N = 1.3", "least_N = 9.3", r"greatest_N: 7\.25692 N is not above least_N = 9\.372"),
        ('"thesis Table 5.1"', '"a"\nexpires = "soon"', "expires: 'soon' is not a date such as 2027-11-21"),
        (
            "[astm_e74]",
            "[curvature]\nmV_per_N2 = 1.0\nu = 1.0\nwith_zero = 0.5\nwith_sensitivity = 0.0\n[astm_e74]",
            "covariances of zero, sensitivity and curvature cannot be",
        ),
    ],
)
def test_a_wrong_calibration_file_is_refused_by_file_key_and_problem(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "load_cell.toml"
    write_calibration(path, THESIS_LOAD_CELL)
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        read_calibration(path, LoadCellCalibration)
    assert str(caught.value).startswith(str(path))


def test_a_missing_calibration_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read: No such file"):
        read_calibration(tmp_path / "absent.toml", LoadCellCalibration)


def test_a_missing_folder_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(
        RecordError, match=r"load_cell\.toml: cannot write the calibration: No such file .* another folder"
    ):
        write_calibration(tmp_path / "absent" / "load_cell.toml", THESIS_LOAD_CELL)


def test_a_full_disk_leaves_the_old_calibration_and_no_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "load_cell.toml"
    write_calibration(path, THESIS_LOAD_CELL)

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RecordError, match="No space left on device"):
        write_calibration(path, THESIS_LOAD_CELL.model_copy(update={"device": "LC-1"}))
    assert read_calibration(path, LoadCellCalibration) == THESIS_LOAD_CELL
    assert list(tmp_path.iterdir()) == [path]
