"""Files of calibrations."""

from __future__ import annotations

import os
from pathlib import Path

import tomli_w

from instrument.calibration import LoadCellCalibration
from instrument.config import Config, read
from instrument.errors import RecordError
from instrument.film_calibration import FilmCalibration


def read_calibration(path: Path) -> LoadCellCalibration:
    """The calibration in a TOML file.

    Raises:
        ConfigError: no such file, not TOML, or keys that are unknown, missing or invalid: all of them at once.
    """
    return read(path, LoadCellCalibration)


def read_film_calibration(path: Path) -> FilmCalibration:
    """As `read_calibration`."""
    return read(path, FilmCalibration)


def write_calibration(path: Path, calibration: Config) -> None:
    """Write a calibration as TOML; after a crash the file is the old one or the new one, never a part.

    Raises:
        RecordError: the folder is missing, full or read-only.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        try:
            with draft.open("wb") as file:
                tomli_w.dump(calibration.model_dump(exclude_none=True), file)
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
