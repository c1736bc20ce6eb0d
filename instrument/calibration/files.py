"""Files of calibrations."""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path

import tomli_w

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.config import Hashed, read_data, read_hashed
from palpate.instrument.errors import RecordError


def read_calibration(path: Path) -> LoadCellCalibration:
    """The calibration in a TOML file.

    Raises:
        ConfigError: no such file, not TOML, keys that are unknown, missing or invalid: all of them at once; or what
            stands in it was changed by hand.
    """
    return read_hashed(path, LoadCellCalibration)


def read_film_calibration(path: Path) -> FilmCalibration:
    """As `read_calibration`."""
    return read_hashed(path, FilmCalibration)


def accept_calibration(path: Path, today: date) -> LoadCellCalibration | FilmCalibration | None:
    """Hash a calibration that was edited by hand, which says from now on that it was; None: it is as it was written.

    Raises:
        ConfigError: as `read_calibration`, but for the change.
        RecordError: as `write_calibration`.
    """
    model = FilmCalibration if "films" in read_data(path) else LoadCellCalibration
    found = read_hashed(path, model, edited=True)
    if found.verified:
        return None
    accepted = model.model_validate({**found.model_dump(), "accepted": today.isoformat()})
    write_calibration(path, accepted)
    return accepted


def write_calibration(path: Path, calibration: Hashed) -> None:
    """Write a calibration as TOML with its hash; after a crash the file is the old one or the new one, never a part.

    Raises:
        RecordError: the folder is missing, full or read-only.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        try:
            with draft.open("wb") as file:
                told = {"sha256": calibration.sha256(), **calibration.model_dump(exclude_none=True)}
                tomli_w.dump(told, file)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise RecordError(f"{path}: cannot write the calibration: {error.strerror}; choose another folder") from error
