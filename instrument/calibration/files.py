"""Reading and writing the files of calibrations."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import TypeVar, overload

import tomli_w

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.calibration.films import FilmCalibration, MountingScatterCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.config import read_data, read_hashed
from palpate.instrument.durable import put_whole
from palpate.instrument.errors import RecordError, reason

C = TypeVar("C", bound=Calibration)
KINDS: dict[str, type[Calibration]] = {
    "films": FilmCalibration,
    "references": ModelCalibration,
    "means_u": MountingScatterCalibration,
}


@overload
def read_calibration(path: str | Path, kind: None = None, *, edited: bool = False) -> Calibration: ...
@overload
def read_calibration(path: str | Path, kind: type[C], *, edited: bool = False) -> C: ...
def read_calibration(path: str | Path, kind: type[C] | None = None, *, edited: bool = False) -> C | Calibration:
    """Read a calibration from a TOML file.

    Args:
        path: the file.
        kind: what it calibrates, such as `LoadCellCalibration`; None: whatever it does.
        edited: True: it may have been changed by hand.

    Raises:
        ConfigError: there is no such file, it is not TOML, it was changed by hand, it is of another kind, or keys are
            unknown, missing or invalid (one error lists them all).
    """
    file = Path(path)
    if kind is not None:
        return read_hashed(file, kind, edited=edited)
    data = read_data(file)
    found = next((each for key, each in KINDS.items() if key in data), LoadCellCalibration)
    return read_hashed(file, found, edited=edited)


def accept_calibration(path: Path, today: date) -> Calibration | None:
    """Accept a calibration file that was edited by hand: hash it anew and note the day in it.

    Returns:
        The calibration; None: it had not been edited, and the file stays as it is.

    Raises:
        ConfigError: as in `read_calibration`, except that a change by hand is no error.
        RecordError: as in `write_calibration`.
    """
    found = read_calibration(path, edited=True)
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
    content = {"sha256": calibration.sha256(), **calibration.model_dump(exclude_none=True)}
    try:
        put_whole(path, tomli_w.dumps(content))
    except OSError as error:
        raise RecordError(f"{path}: cannot write the calibration: {reason(error)}; choose another folder") from error
