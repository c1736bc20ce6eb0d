"""Stored calibrations: of each load cell with its indicator, of each sensor with its node, and of models by sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, SensorNode
from palpate.instrument.bench.kinds import Role
from palpate.instrument.calibration.files import (
    read_calibration,
    read_film_calibration,
    read_model_calibration,
    read_mounting_scatter,
    write_calibration,
)
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_fit import THESIS_LOAD_CELL
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.calibration.mounting_scatter import MountingScatter
from palpate.instrument.config import Hashed
from palpate.instrument.errors import ConfigError, PalpateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.lab.store import store
from palpate.procedures.records.run import storing
from palpate.procedures.steps.checks import check_loads

if TYPE_CHECKING:
    from palpate.instrument.findings.object_modulus import ByReferences
    from palpate.instrument.models.ratio import Question

C = TypeVar("C", LoadCellCalibration, FilmCalibration, ModelCalibration)
K = TypeVar("K", FilmCalibration, ModelCalibration, MountingScatter)


def load_cell_path(serial: str) -> Path:
    """File for the load-cell calibration of an indicator, by the indicator's serial number."""
    return _path(f"load_cell-{serial or 'unknown'}")


def films_path(serial: str, design: str) -> Path:
    """File for the film calibration of a sensor, by the serial number of its node and its design."""
    return _path(f"films-{serial or 'unknown'}-{design}")


def model_path(serial: str, design: str, model: str, parameters: str, thickness: float, scene: str | None) -> Path:
    """File for the calibration of a model with a parameter set, for a sensor and objects of a thickness [m].

    The sensor is told by the serial number of its node and its design; a simulated one is another in each scene.
    """
    of = f"model-{serial or 'unknown'}-{design}-{model}-{parameters}-{show(thickness, 'm')}"
    return _path(f"{of}-{scene}" if scene else of)


def mountings_path(serial: str, design: str, scene: str | None) -> Path:
    """File for the scatter of mountings of a sensor, which is told as for `model_path`."""
    of = f"mountings-{serial or 'unknown'}-{design}"
    return _path(f"{of}-{scene}" if scene else of)


def mountings_of(
    design: str, scene: str | None, simulated: bool, today: date, serial: str = "*"
) -> MountingScatter | None:
    """The newest stored scatter of mountings of a sensor. None: none is stored, or it has expired.

    Args:
        design: design of the sensor.
        scene: identity of a simulated sensor; None: a real one.
        simulated: whether the bench is simulated.
        today: date by which it expires.
        serial: serial number of the sensor node; "*": it is not known yet which bench will answer.

    Raises ConfigError: it is damaged or was changed by hand. What may be of another real sensor does not count instead:
    the bench will tell of it when it is open.
    """
    certain = scene is not None or serial != "*"
    found = stored_at(mountings_path(serial, design, scene), read_mounting_scatter, certain)
    mine = [each for each in found if serial in ("*", each.device) and each.holds_for(design, scene, simulated, today)]
    return max(mine, key=lambda each: each.created, default=None)


def stored_at(path: Path, read: Callable[[Path], K], certain: bool) -> list[K]:
    """What is stored at the path of a calibration, with "*" as serial number at those of all devices.

    One that cannot be read does not count. Raises ConfigError instead: it is certain to be one of the bench's own.
    """
    found = []
    for each in path.parent.glob(path.name.replace("---", "-*-", 1)):
        try:
            found.append(read(each))
        except ConfigError:
            if certain:
                raise
    return found


def _path(name: str) -> Path:
    return store() / "calibrations" / f"{''.join(c if c.isalnum() or c in '-_' else '-' for c in name)}.toml"


def keep(calibration: Hashed, folder: Path, replayed: bool, path: Path) -> None:
    """Write a calibration into the folder of its run and, unless the run was replayed, to `path` for later runs.

    Raises RecordError: a file cannot be written.
    """
    write_calibration(folder / "calibration.toml", calibration)
    if replayed:
        return
    with storing(path, "a writable folder with $PALPATE_STORE"):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, calibration)


def check_nameable(bench: Bench, role: Role) -> None:
    """Check that the calibration of a device can be known to be its own.

    Raises ConfigError: a device of a real bench tells no serial number, and its section has no label instead.
    """
    found = next(iter(bench.description.filling(role)), None)
    if bench.simulated or found is None or found.inventory or found.kind.contract.tells_serial:
        return
    raise ConfigError(
        f"device.{found.name}: a {found.kind.name} tells no serial number, so the calibration of another one would "
        'pass for its own; write inventory = "LABEL" in its section, as it is labelled'
    )


def load_cell_of(bench: Bench, today: date) -> LoadCellCalibration:
    """The stored load-cell calibration of a bench. A simulated bench without one takes the thesis' calibration.

    Raises:
        ConfigError: a real bench has no calibration, or its indicator cannot be told from others; or the calibration is
            damaged, has expired, or belongs to another device or gage factor.
    """
    check_nameable(bench, "load_indicator")
    indicator = bench.role(LoadIndicator)
    path = load_cell_path(indicator.serial)
    if not path.exists():
        if not bench.simulated:
            raise ConfigError(f"{path}: this bench's load cell has no calibration; run palpate calibrate load-cell")
        return THESIS_LOAD_CELL
    serial, gage_factor = indicator.serial or "unknown", indicator.gage_factor
    return checked(path, read_calibration(path), lambda c: c.check_use(serial, bench.simulated, gage_factor, today))


def known_load_cell(bench: Bench) -> LoadCellCalibration:
    """The last calibration of a load cell, which may have expired, or the thesis', as what to expect of it."""
    path = load_cell_path(bench.role(LoadIndicator).serial)
    with suppress(PalpateError):
        if (found := read_calibration(path)).simulated == bench.simulated:
            return found
    return THESIS_LOAD_CELL


def check_store(loads: Sequence[float], extrapolate: bool, simulated: bool, today: date) -> bool:
    """Check loads against the stored load-cell calibrations before a bench is opened.

    It is not known yet which indicator will answer, nor whether a bench file leads to a simulated bench. So loads are
    refused only if they suit none of the calibrations that the bench could have.

    Args:
        loads: loads, peak to peak [N].
        extrapolate: whether loads outside the calibrated range are allowed.
        simulated: whether the bench is certainly simulated.
        today: date by which calibrations expire.

    Returns:
        Whether a stored calibration suits the loads: one of a real bench, unless the bench is certainly simulated.

    Raises:
        ConfigError: the only calibration of the simulated bench has expired or is damaged.
        RangeError, UnreachableError: as `check_loads` raises them.
    """
    told = False
    refusals: list[PalpateError] = []
    for path in sorted(_path("").parent.glob("load_cell-*.toml")):
        try:
            found = read_calibration(path)
            if simulated and not found.simulated:
                continue
            checked(path, found, lambda c: c.check_use(c.device, c.simulated, c.gage_factor, today))
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
    """The stored calibration of the sensor's films. None: there is none, and the design's sensitivities hold.

    Raises:
        ConfigError: the calibration is damaged, has expired, or belongs to another sensor; or the node cannot be told
            from others.
    """
    serial = bench.role(SensorNode).serial or "unknown"
    path = films_path(serial, design.name)
    if not path.exists():
        return None
    check_nameable(bench, "sensor_node")
    found = read_film_calibration(path)
    return checked(path, found, lambda c: c.check_use(design, serial, bench.simulated, today))


def model_of(
    bench: Bench, question: Question, films: FilmCalibration | None, scene: str | None, today: date
) -> ModelCalibration | None:
    """The stored calibration of the model that answers a question. None: there is none.

    Args:
        bench: the open bench.
        question: sensor, model, parameter set and thickness of the object.
        films: the calibration of the films that holds now.
        scene: the simulated sensor; None: a real one.
        today: date by which calibrations expire.

    Raises:
        ConfigError: the calibration is damaged, has expired, or belongs to another sensor or other films.
        RangeError: model "auto" finds no model.
    """
    from palpate.instrument.findings.object_modulus import answering

    serial = bench.role(SensorNode).serial or "unknown"
    thickness = question.load(question.sensor().ring.material.modulus).sensed.thickness
    path = model_path(serial, question.design, answering(question), question.parameters, thickness, scene)
    if not path.exists():
        return None
    check_nameable(bench, "sensor_node")

    def check(calibration: ModelCalibration) -> None:
        calibration.check_use(question.design, serial, scene, bench.simulated, today)
        calibration.check_films(None if films is None else films.sha256())

    return checked(path, read_model_calibration(path), check)


def by_references(path: Path, today: date) -> ByReferences:
    """The calibration of a model in a file, for ratios of which nothing else is known.

    Raises ConfigError: it is missing, damaged or expired.
    """
    from palpate.instrument.findings.object_modulus import ByReferences

    found = checked(path, read_model_calibration(path), lambda c: c.check_date(today))
    return ByReferences(found)


def checked(path: Path, calibration: C, check: Callable[[C], None]) -> C:
    """A calibration of a file, checked. Raises ConfigError, which names the file: the check refuses it."""
    try:
        check(calibration)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return calibration
