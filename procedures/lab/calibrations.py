"""Stored calibrations: one of each load cell with its indicator, one of each sensor on its node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import TypeVar

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, SensorNode
from palpate.instrument.calibration.files import read_calibration, read_film_calibration, write_calibration
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.config import Hashed
from palpate.instrument.errors import ConfigError, PalpateError
from palpate.instrument.sensor.design import Design
from palpate.procedures.lab.store import store
from palpate.procedures.records.run import storing
from palpate.procedures.steps.checks import check_loads

C = TypeVar("C", LoadCellCalibration, FilmCalibration)


def load_cell_path(serial: str) -> Path:
    """Where the load-cell calibration of an indicator is kept."""
    return _path(f"load_cell-{serial or 'unknown'}")


def films_path(serial: str, design: str) -> Path:
    """Where the film calibration of a sensor of this design on a node is kept."""
    return _path(f"films-{serial or 'unknown'}-{design}")


def _path(name: str) -> Path:
    return store() / "calibrations" / f"{''.join(c if c.isalnum() or c in '-_' else '-' for c in name)}.toml"


def keep(calibration: Hashed, folder: Path, replayed: bool, path: Path) -> None:
    """Write a calibration into the folder of its run and, unless that was a replay, where later runs look for it.

    Raises RecordError.
    """
    write_calibration(folder / "calibration.toml", calibration)
    if replayed:
        return
    with storing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, calibration)


def load_cell_of(bench: Bench, today: date) -> LoadCellCalibration:
    """The stored calibration of this bench's indicator; a simulated one that has none takes the thesis' own.

    Raises:
        ConfigError: a real bench has none, or it is damaged, expired, or not of this device and gage factor.
    """
    indicator = bench.role(LoadIndicator)
    path = load_cell_path(indicator.serial)
    if not path.exists():
        if not bench.simulated:
            raise ConfigError(f"{path}: this bench's load cell has no calibration; run palpate calibrate load-cell")
        return THESIS_LOAD_CELL
    serial, gage_factor = indicator.serial or "unknown", indicator.gage_factor
    return _checked(path, read_calibration(path), lambda c: c.check_use(serial, bench.simulated, gage_factor, today))


def check_store(loads: Sequence[float], extrapolate: bool, simulated: bool, today: date) -> bool:
    """Refuse, before a bench is opened, loads [N, peak to peak] that none of the calibrations it may have tells.

    Which indicator will answer is not known yet, nor whether behind a bench file there is a simulated one.

    Args:
        simulated: it surely is.

    Returns:
        Whether one of those stored tells them for whatever bench will answer, a real one if it may be real.

    Raises:
        ConfigError: the only one for a simulated bench has expired or is damaged.
        RangeError, UnreachableError: as `check_loads`.
    """
    told = False
    refusals: list[PalpateError] = []
    for path in sorted(_path("").parent.glob("load_cell-*.toml")):
        try:
            found = read_calibration(path)
            if simulated and not found.simulated:
                continue
            _checked(path, found, lambda c: c.check_use(c.device, c.simulated, c.gage_factor, today))
            check_loads(loads, found, extrapolate)
            if simulated or not found.simulated:
                return True
            told = True
        except PalpateError as refused:
            refusals.append(refused)
    if simulated and refusals:
        raise refusals[0]
    if not told:
        check_loads(loads, THESIS_LOAD_CELL, extrapolate)
    return False


def films_of(bench: Bench, design: Design, today: date) -> FilmCalibration | None:
    """The stored calibration of this sensor's films; without one the design's sensitivities serve.

    Raises:
        ConfigError: it is damaged, expired, or not of this sensor.
    """
    serial = bench.role(SensorNode).serial or "unknown"
    path = films_path(serial, design.name)
    if not path.exists():
        return None
    found = read_film_calibration(path)
    return _checked(path, found, lambda c: c.check_use(design, serial, bench.simulated, today))


def _checked(path: Path, calibration: C, check: Callable[[C], None]) -> C:
    try:
        check(calibration)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return calibration
