"""Load cell: line fit of a dead-weight series, the calibration that it gives, and its file."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
import tomli_w
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from instrument.config import Config, check, read
from instrument.errors import EstimateError, RangeError, RecordError

STANDARD_GRAVITY = 9.80665
"""m/s², turns the gram-force of dead weights into newtons."""


@dataclass(frozen=True, slots=True)
class LineFit:
    """`reading = zero + slope·load`.

    Args:
        slope, slope_u: reading per N, with standard uncertainty.
        zero, zero_u: reading at no load, with standard uncertainty.
        covariance: of slope and zero.
        residual_sd: of the readings about the line.
        degrees_of_freedom: of `residual_sd`, points − 2.
    """

    slope: float
    slope_u: float
    zero: float
    zero_u: float
    covariance: float
    residual_sd: float
    degrees_of_freedom: int


def fit_line(load: npt.ArrayLike, reading: npt.ArrayLike, reading_u: float) -> LineFit:
    """Least-squares line through readings at known loads.

    Centred loads make the two columns orthogonal: they are their own QR factor, and a large load or
    reading offset costs no digits (normal equations of the plain columns were seen 1.4 N off [M]).

    Args:
        load: (n,) N.
        reading: (n,) in the indicator's unit.
        reading_u: standard uncertainty that no reading is better than, such as resolution/√12. It
            stands in for the scatter where the scatter is smaller: a series in which each reading rounds the
            same way every time shows less scatter than error.

    Raises:
        EstimateError: shapes that differ, values that are not finite, fewer than 3 distinct loads, a negative
            `reading_u`.
    """
    x = np.asarray(load, dtype=np.float64)
    y = np.asarray(reading, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape:
        raise EstimateError(f"loads have shape {x.shape} and readings {y.shape}; both must be (n,)")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        bad = np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))
        raise EstimateError(f"load or reading is not finite at {', '.join(f'point {i}' for i in bad)}; repeat it")
    if not (math.isfinite(reading_u) and reading_u >= 0):
        raise EstimateError(f"standard uncertainty {reading_u} of a reading must be zero or more; give resolution/√12")
    distinct = np.unique(x).size
    if distinct < 3:
        raise EstimateError(f"{distinct} distinct loads cannot give a line and its uncertainty; use at least 3")
    x_mean, y_mean = float(x.mean()), float(y.mean())
    x_centred, y_centred = x - x_mean, y - y_mean
    length = float(np.linalg.norm(x_centred))
    slope = float((x_centred / length) @ y_centred) / length
    degrees_of_freedom = x.size - 2
    residual_sd = float(np.linalg.norm(y_centred - slope * x_centred)) / math.sqrt(degrees_of_freedom)
    u = max(residual_sd, reading_u)
    slope_u = u / length
    return LineFit(
        slope=slope,
        slope_u=slope_u,
        zero=y_mean - slope * x_mean,
        zero_u=math.hypot(u / math.sqrt(x.size), slope_u * x_mean),
        covariance=-x_mean * slope_u**2,
        residual_sd=residual_sd,
        degrees_of_freedom=degrees_of_freedom,
    )


_Positive = Annotated[float, Field(gt=0)]
_Fraction = Annotated[float, Field(ge=0)]
_Name = Annotated[str, Field(min_length=1)]


class LoadCellCalibration(Config):
    """`reading_mV = zero_mV + sensitivity_mV_per_N · load_N`, of one load cell with its indicator.

    The field names are the keys of the calibration file.

    Args:
        sensitivity_mV_per_N, sensitivity_u: slope of the line, with standard uncertainty.
        zero_mV, zero_u: reading at no load, with standard uncertainty.
        covariance: mV²/N, of sensitivity and zero.
        linearity: largest deviation of a mean reading from the line, as a fraction of the span.
        reversibility: largest difference of loading and unloading at one load, as a fraction of the span.
        resolution_mV: smallest step of the indicator.
        device: serial number of the load cell.
        simulated: whether the readings come from a simulated bench.
        source: where the readings are to be found.
        created: date and time, ISO 8601.
    """

    model_config = ConfigDict(strict=True)

    sensitivity_mV_per_N: _Positive
    sensitivity_u: _Positive
    zero_mV: float
    zero_u: _Positive
    covariance: float
    linearity: _Fraction
    reversibility: _Fraction
    resolution_mV: _Positive
    device: _Name
    simulated: bool
    source: _Name
    created: _Name

    @field_validator("covariance")
    @classmethod
    def _is_a_covariance(cls, value: float, info: ValidationInfo) -> float:
        bound = info.data.get("sensitivity_u", math.inf) * info.data.get("zero_u", math.inf)
        if not abs(value) <= bound:
            raise ValueError(f"{value:g} exceeds sensitivity_u · zero_u = {bound:g} in size")
        return value

    def load(self, reading_mV: float) -> tuple[float, float]:
        """Load in N that gives this reading, and its standard uncertainty in N.

        The uncertainty holds the line (with covariance) and the indicator's resolution over √12; scatter of
        the reading itself is the reader's to add.

        Raises:
            EstimateError: the reading is not finite.
        """
        if not math.isfinite(reading_mV):
            raise EstimateError(f"reading {reading_mV} mV is not finite, so it has no load; repeat it")
        load = (reading_mV - self.zero_mV) / self.sensitivity_mV_per_N
        line = self.zero_u**2 + (load * self.sensitivity_u) ** 2 + 2 * load * self.covariance
        return load, math.sqrt(max(line, 0.0) + self.resolution_mV**2 / 12) / self.sensitivity_mV_per_N

    def reading(self, load_N: float) -> float:
        """Reading in mV that this load gives."""
        return self.zero_mV + self.sensitivity_mV_per_N * load_N

    def resolution(self) -> float:
        """Load in N of the smallest step of the indicator."""
        return self.resolution_mV / self.sensitivity_mV_per_N


def calibrate_load_cell(
    load_N: npt.ArrayLike,
    loading_mV: npt.ArrayLike,
    unloading_mV: npt.ArrayLike,
    resolution_mV: float,
    *,
    device: str,
    simulated: bool,
    source: str,
    created: str,
) -> LoadCellCalibration:
    """Calibration from a series of dead weights put on and taken off again.

    The line goes through the mean reading at each load, since repeats at one load share its rounding.
    The span is that of the line between the least and the greatest load.

    Args:
        load_N: (k,) N.
        loading_mV: (k, repeats) mV, row by row at `load_N`, weights put on.
        unloading_mV: (k, repeats) mV, row by row at `load_N` (same order), weights taken off.
        resolution_mV: smallest step of the indicator.
        device, simulated, source, created: as in `LoadCellCalibration`.

    Raises:
        EstimateError: as `fit_line`; shapes that do not match; a sensitivity not above three of its standard
            uncertainties.
        RangeError: resolution not positive.
        ConfigError: an empty text.
    """
    load = np.asarray(load_N, dtype=np.float64)
    up = np.asarray(loading_mV, dtype=np.float64)
    down = np.asarray(unloading_mV, dtype=np.float64)
    if any(series.ndim != 2 or series.shape[0] != load.size or series.shape[1] == 0 for series in (up, down)):
        raise EstimateError(
            f"{load.size} loads, but loading readings of shape {up.shape} and unloading readings of shape "
            f"{down.shape}; both must be ({load.size}, repeats)"
        )
    if not (math.isfinite(resolution_mV) and resolution_mV > 0):
        raise RangeError(f"resolution {resolution_mV} mV must be positive: it is the indicator's smallest step")
    up_mean, down_mean = up.mean(axis=1), down.mean(axis=1)
    mean = 0.5 * (up_mean + down_mean)
    line = fit_line(load, mean, resolution_mV / math.sqrt(12))
    if not line.slope > 3 * line.slope_u:
        raise EstimateError(
            f"sensitivity {line.slope:.4g} mV/N with standard uncertainty {line.slope_u:.2g} mV/N is not above "
            "three of them; check the weights, the bridge and its polarity"
        )
    span = line.slope * float(np.ptp(load))
    fields = {
        "sensitivity_mV_per_N": line.slope,
        "sensitivity_u": line.slope_u,
        "zero_mV": line.zero,
        "zero_u": line.zero_u,
        "covariance": line.covariance,
        "linearity": float(np.abs(mean - (line.zero + line.slope * load)).max()) / span,
        "reversibility": float(np.abs(up_mean - down_mean).max()) / span,
        "resolution_mV": float(resolution_mV),
        "device": device,
        "simulated": simulated,
        "source": source,
        "created": created,
    }
    return check(fields, LoadCellCalibration, "load cell calibration")


THESIS_LOAD_CELL = calibrate_load_cell(
    np.arange(140.0, 741.0, 100.0) * 1e-3 * STANDARD_GRAVITY,
    [[16.0], [26.0], [36.0], [47.0], [56.0], [67.0], [77.0]],
    [[16.0], [26.0], [36.0], [46.0], [57.0], [66.0], [76.0]],
    1.0,
    device="thesis load cell",
    simulated=False,
    source="thesis Table 5.1",
    created="not recorded",
)
"""10.306 ± 0.056 mV/N, zero 1.81 mV, resolution 1 mV: thesis Table 5.1 [T]. Serves until a bench has its own."""


def read_calibration(path: Path) -> LoadCellCalibration:
    """The calibration in a TOML file.

    Raises:
        ConfigError: no such file, not TOML, or keys that are unknown, missing or invalid: all of them at once.
    """
    return read(path, LoadCellCalibration)


def write_calibration(path: Path, calibration: LoadCellCalibration) -> None:
    """Write a calibration as TOML; after a crash the file is the old one or the new one, never a part.

    Raises:
        RecordError: the folder is missing, full or read-only.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        try:
            with draft.open("wb") as file:
                tomli_w.dump(calibration.model_dump(), file)
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
