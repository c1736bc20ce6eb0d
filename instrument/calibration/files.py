"""Reading and writing the files of calibrations."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import tomli_w

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.calibration.mounting_scatter import MountingScatter
from palpate.instrument.config import read_data, read_hashed
from palpate.instrument.durable import put_whole
from palpate.instrument.errors import RecordError, reason


def read_calibration(path: str | Path) -> LoadCellCalibration:
    """The calibration in a TOML file.

    Raises:
        ConfigError: there is no such file, it is not TOML, it was changed by hand, or keys are unknown, missing or
            invalid (one error lists them all).
    """
    return read_hashed(Path(path), LoadCellCalibration)


def read_film_calibration(path: str | Path) -> FilmCalibration:
    """Read the calibration of films from a TOML file. Raises ConfigError as `read_calibration` does."""
    return read_hashed(Path(path), FilmCalibration)


def read_model_calibration(path: str | Path) -> ModelCalibration:
    """Read the calibration of a model from a TOML file. Raises ConfigError as `read_calibration` does."""
    return read_hashed(Path(path), ModelCalibration)


def read_any(path: Path, *, edited: bool = False) -> Calibration:
    """Read the calibration of any kind from a TOML file, which may have been `edited` by hand.

    Raises ConfigError as `read_calibration` does.
    """
    kinds: dict[str, type[Calibration]] = {
        "films": FilmCalibration, "references": ModelCalibration, "means_u": MountingScatter,
    }  # fmt: skip
    data = read_data(path)
    return read_hashed(
        path, next((kind for key, kind in kinds.items() if key in data), LoadCellCalibration), edited=edited
    )


def accept_calibration(path: Path, today: date) -> Calibration | None:
    """Accept a calibration file that was edited by hand: hash it anew and note the day in it.

    Returns:
        The calibration; None: it had not been edited, and the file stays as it is.

    Raises:
        ConfigError: as in `read_calibration`, except that a change by hand is no error.
        RecordError: as in `write_calibration`.
    """
    found = read_any(path, edited=True)
    if read_data(path).get("sha256") == found.sha256():
        return None
    accepted = type(found).model_validate({**found.model_dump(), "accepted": today.isoformat()})
    write_calibration(path, accepted)
    return accepted


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration as TOML with its hash, as `put_whole` does.

    Raises:
        RecordError: the folder is missing, full or read-only.
    """
    told = {"sha256": calibration.sha256(), **calibration.model_dump(exclude_none=True)}
    try:
        put_whole(path, tomli_w.dumps(told))
    except OSError as error:
        raise RecordError(f"{path}: cannot write the calibration: {reason(error)}; choose another folder") from error
