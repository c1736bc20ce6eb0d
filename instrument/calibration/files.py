"""Reading and writing the files of calibrations."""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path

import tomli_w

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.calibration.mounting_scatter import MountingScatter
from palpate.instrument.config import Hashed, read_data, read_hashed
from palpate.instrument.errors import RecordError, check_path, reason


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


def read_mounting_scatter(path: str | Path) -> MountingScatter:
    """Read the scatter of mountings from a TOML file. Raises ConfigError as `read_calibration` does."""
    return read_hashed(Path(path), MountingScatter)


def accept_calibration(
    path: Path, today: date
) -> LoadCellCalibration | FilmCalibration | ModelCalibration | MountingScatter | None:
    """Accept a calibration file that was edited by hand: hash it anew and note the day in it.

    Returns:
        The calibration; None: it had not been edited, and the file stays as it is.

    Raises:
        ConfigError: as in `read_calibration`, except that a change by hand is no error.
        RecordError: as in `write_calibration`.
    """
    data = read_data(path)
    kinds: dict[str, type[FilmCalibration | ModelCalibration | MountingScatter]] = {
        "films": FilmCalibration, "references": ModelCalibration, "means_u": MountingScatter,
    }  # fmt: skip
    model = next((kind for key, kind in kinds.items() if key in data), LoadCellCalibration)
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
    check_path(path)
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
        raise RecordError(f"{path}: cannot write the calibration: {reason(error)}; choose another folder") from error
