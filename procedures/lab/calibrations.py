"""Stored calibrations: of each load cell with its indicator, of each sensor with its node, and of models by sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from palpate.drivers.roles import LoadIndicator, SensorNode
from palpate.instrument.bench.kinds import Role
from palpate.instrument.calibration.calibration import ANY, Calibration, CalibrationOwner
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.films import FilmCalibration, MountingScatterCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.config import read_hashed
from palpate.instrument.durable import make_folder
from palpate.instrument.errors import ConfigError, PalpateError, RecordError, UsageError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.lab.lab import owner
from palpate.procedures.lab.store import store
from palpate.procedures.records.run import Run, storing
from palpate.procedures.steps.checks import check_loads

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.instrument.findings.object_modulus import ByReferences
    from palpate.instrument.models.response import RatioQuestion
    from palpate.procedures.lab.lab import Target


NO_GAGE_FACTOR = 1.0  # of an indicator that has no such setting
KEPT = "calibration.toml"  # in the folder of a run: what it has for later runs
C = TypeVar("C", bound=Calibration)
Check = Callable[[C], None]


class Unstored(RecordError):
    """A calibration is kept in the folder of its run, but cannot be put into the store for later runs."""


def path_of(kind: type[Calibration], of: CalibrationOwner) -> Path:
    """File in the store for the calibration of a kind that belongs to an owner."""
    return store() / "calibrations" / of.file_name(kind.kind)


def stored(
    kind: type[C],
    of: CalibrationOwner,
    certain: bool,
    today: date | None = None,
    check: Check[C] = lambda _calibration: None,
) -> list[C]:
    """What the store has of a kind for an owner, which may be of `ANY` device; the newest comes first.

    What cannot be used does not count. Raises ConfigError instead, as `own` does, for what is `certain` to be the
    bench's own.
    """
    found = []
    path = path_of(kind, of)
    for each in path.parent.glob(path.name) if of.device == ANY else [path] * _is_there(path):
        try:
            read = read_hashed(each, kind)
            if read.belongs_to(of):
                found.append(_checked(each, read, today, check))
        except ConfigError:
            if certain:
                raise
    return sorted(found, key=lambda each: each.created, reverse=True)


def own(kind: type[C], of: CalibrationOwner, today: date, check: Check[C] = lambda _calibration: None) -> C | None:
    """The stored calibration of a kind that belongs to an owner; None: there is none.

    Raises ConfigError, which names the file: it cannot be read, was changed by hand, belongs to another owner, has
    expired, or the `check` refuses it.
    """
    path = path_of(kind, of)
    return _checked(path, read_hashed(path, kind), today, check, of) if _is_there(path) else None


def _is_there(path: Path) -> bool:
    """Whether there is a file. Raises ConfigError: nobody can tell, since a folder cannot be read."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; make it readable") from None
    return True


def _checked(
    path: Path,
    found: C,
    today: date | None,
    check: Check[C] = lambda _calibration: None,
    of: CalibrationOwner | None = None,
) -> C:
    """A calibration of a file, checked. Raises ConfigError, which names the file."""
    try:
        if of is not None:
            found.check_owner(of)
        if today is not None:
            found.check_date(today)
        check(found)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return found


def keep(calibration: Calibration, folder: Path, replayed: bool) -> Path:
    """Write a calibration into the folder of its run and, unless the run was replayed, into the store for later runs.

    Returns the file in the store.

    Raises:
        RecordError: it cannot be written into the folder.
        Unstored: it cannot be put into the store.
    """
    write_calibration(folder / KEPT, calibration)
    path = path_of(type(calibration), calibration.owner)
    if not replayed:
        try:
            install(calibration)
        except RecordError as error:
            raise Unstored(
                f"the calibration is kept in {folder}, and later runs do not use it: {error}; then run palpate runs"
                f" install {folder}"
            ) from error
    return path


def install(calibration: Calibration) -> bool:
    """Put a calibration into the store; returns False if it is there already.

    Raises RecordError: the store has a newer one, or cannot be written to.
    """
    path = path_of(type(calibration), calibration.owner)
    if (there := _before(calibration)) is not None:
        if there.sha256() == calibration.sha256():
            return False
        raise RecordError(f"{path} is newer, of {there.source}; remove it if this one shall be used instead")
    with storing(path, "a writable folder with $PALPATE_STORE"):
        make_folder(path.parent)
    write_calibration(path, calibration)
    return True


def install_of(run: Run, today: date) -> tuple[Path, bool]:
    """Put the calibration of a run into the store; returns its file there, and False if it was there already.

    Raises:
        UsageError: the run has no calibration, or is a replay.
        ConfigError: its calibration is damaged or has expired.
        RecordError: as `install`.
    """
    file = run.folder / KEPT
    if "replayed" in run.header:
        raise UsageError(
            f"{run.folder}: is the replay of a log, whose calibration stays there; install that of its run"
        )
    if not _is_there(file):
        raise UsageError(
            f"{run.folder}: has no calibration, since its procedure makes none or it has not ended; go on with one that"
            " has not ended by palpate runs resume"
        )
    found = _checked(file, read_calibration(file), today)
    return path_of(type(found), found.owner), install(found)


def is_unstored(folder: Path, calibrates: bool) -> bool:
    """Whether the calibration of a run is missing in the store, which has no newer one either.

    `calibrates` says whether the run must have one, so that it is missing in its folder, too, if it is not there.
    """
    if not (calibrates or _is_there(folder / KEPT)):
        return False
    try:
        return _before(read_calibration(folder / KEPT)) is None
    except ConfigError:
        return True


def _before(calibration: Calibration) -> Calibration | None:
    """What the store has in the place of a calibration: the same or a newer one; None: neither."""
    with suppress(ConfigError, ValueError):  # it is missing, damaged, or of another kind; or this one tells no time
        there = read_calibration(path_of(type(calibration), calibration.owner))
        same = there.sha256() == calibration.sha256()
        if same or there.newer_than(datetime.fromisoformat(calibration.created)):
            return there
    return None


def mountings_of(of: CalibrationOwner, today: date) -> MountingScatterCalibration | None:
    """The newest stored scatter of mountings of a sensor's design. None: none is stored, or it has expired.

    Raises ConfigError: it is damaged or was changed by hand. What may be of another real sensor does not count instead:
    the bench will tell of it when it is open.
    """
    found = stored(MountingScatterCalibration, of, certain=of.scene is not None or of.device != ANY)
    return next((each for each in found if each.lasts_on(today)), None)


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
    whose, gage_factor = owner(bench, LoadIndicator), bench.role(LoadIndicator).gage_factor
    found = own(LoadCellCalibration, whose, today, lambda c: c.check_gage_factor(gage_factor))
    if found is not None:
        return found
    if not bench.simulated:
        path = path_of(LoadCellCalibration, whose)
        raise ConfigError(f"{path}: this bench's load cell has no calibration; run palpate calibrate load-cell")
    if gage_factor != NO_GAGE_FACTOR:
        THESIS_LOAD_CELL.check_gage_factor(gage_factor)
    return THESIS_LOAD_CELL


def known_load_cell(bench: Bench) -> LoadCellCalibration:
    """The last calibration of a load cell, which may have expired, or the thesis', as what to expect of it."""
    return next(iter(stored(LoadCellCalibration, owner(bench, LoadIndicator), certain=False)), THESIS_LOAD_CELL)


def check_store(loads: Sequence[float], extrapolate: bool, scene: str | None, today: date) -> bool:
    """Check loads against the stored load-cell calibrations before a bench is opened.

    It is not known yet which indicator will answer, nor whether a bench file that names no scene leads to a simulated
    bench. So loads are refused only if they suit none of the calibrations that the bench could have.

    Args:
        loads: loads, peak to peak [N].
        extrapolate: whether loads outside the calibrated range are allowed.
        scene: identity of the scene that simulates the bench; None: it may be real.
        today: date by which calibrations expire.

    Returns:
        Whether a stored calibration suits the loads: one of a real bench, unless the bench is certainly simulated.

    Raises:
        ConfigError: the only calibration of the simulated bench has expired or is damaged.
        RangeError, UnreachableError: as `check_loads` raises them.
    """
    announced = False
    refusals: list[PalpateError] = []
    pattern = path_of(LoadCellCalibration, CalibrationOwner(ANY, scene, scene is not None))
    for path in sorted(pattern.parent.glob(pattern.name)):
        try:
            found = read_hashed(path, LoadCellCalibration)
            if found.scene != scene:
                continue
            _checked(path, found, today)
            check_loads(loads, found, extrapolate)
            if scene is not None or not found.simulated:
                return True
            announced = True
        except PalpateError as refused:
            refusals.append(refused)
    if scene is not None and refusals:
        raise refusals[0]
    if not announced:
        check_loads(loads, THESIS_LOAD_CELL, extrapolate)
    return False


def films_of(bench: Bench, design: Design, today: date) -> FilmCalibration | None:
    """The stored calibration of the sensor's films. None: there is none, and the design's sensitivities hold.

    Raises:
        ConfigError: the calibration is damaged, has expired, or belongs to another sensor; or the node cannot be told
            from others.
    """
    found = own(FilmCalibration, owner(bench, SensorNode, design.name), today, lambda c: c.check_films(design))
    if found is not None:
        check_nameable(bench, "sensor_node")
    return found


def model_of(
    bench: Bench, question: RatioQuestion, films: FilmCalibration | None, today: date
) -> ModelCalibration | None:
    """The stored calibration of the model that answers a question. None: there is none.

    Args:
        bench: the open bench.
        question: sensor, model, parameter set and thickness of the object.
        films: the calibration of the films that holds now.
        today: date by which calibrations expire.

    Raises:
        ConfigError: the calibration is damaged, has expired, or belongs to another sensor or other films.
        RangeError: model "auto" finds no model.
    """
    whose, sha256 = owner(bench, SensorNode, *asked_of(question)), None if films is None else films.sha256()
    found = own(ModelCalibration, whose, today, lambda c: c.check_films(sha256))
    if found is not None:
        check_nameable(bench, "sensor_node")
    return found


def asked_of(question: RatioQuestion) -> tuple[str, ...]:
    """What a calibration by references is of that answers a question, as for `CalibrationOwner`."""
    from palpate.instrument.findings.object_modulus import answering

    thickness = question.load(question.sensor().ring.material.modulus).sensed.thickness
    return question.design, answering(question), question.parameters, show(thickness, "m")


def by_references(path: Path, today: date) -> ByReferences:
    """The calibration of a model in a file, for ratios of which nothing else is known.

    Raises ConfigError: it is missing, damaged or expired.
    """
    from palpate.instrument.findings.object_modulus import ByReferences

    return ByReferences(_checked(path, read_calibration(path, ModelCalibration), today))


# -------------------------------------------------------------------------------------------------------
# The calibrations that a bench will probably use, told from the store before it is known which bench will
# answer


def probable_load_cell(scene: str | None) -> LoadCellCalibration | None:
    """The newest stored calibration of a load cell, before it is known which bench will answer; None: there is none.

    `scene` is the identity of the scene that simulates the bench; None: it may be real.
    """
    return next(iter(stored(LoadCellCalibration, CalibrationOwner(ANY, scene, scene is not None), certain=False)), None)


def probable_references(question: RatioQuestion, scene: str | None, today: date) -> ByReferences | None:
    """The newest stored calibration of the model that answers a question, before it is known which bench will answer.

    One of another scene is of another sensor. Of a real bench one that is damaged or has expired does not count: the
    bench will tell of it when it is open.

    Args:
        question: what is asked.
        scene: identity of the scene of a simulated bench; None: it is that of a bench file.
        today: date by which calibrations expire.

    Raises ConfigError: that of the scene is damaged, was changed by hand, or has expired.
    """
    from palpate.instrument.findings.object_modulus import ByReferences

    certain = scene is not None
    found = stored(ModelCalibration, CalibrationOwner(ANY, scene, certain, asked_of(question)), certain, today)
    return ByReferences(found[0], found[0].film_calibration is None) if found else None


def references_on(target: Target, question: RatioQuestion) -> ByReferences | None:
    """The model's calibration by references on a bench; before it is open, the one that it probably has."""
    if target.calibrated is not None:
        return target.references
    return probable_references(question, target.scene, datetime.now(UTC).date())


def with_films(target: Target) -> Target:
    """A bench whose films are calibrated as it probably has them; one that is open has them already.

    They are those of the newest stored calibration that holds for such a sensor, as the node's serial number is not
    known yet.
    """
    if target.calibrated is not None:
        return target
    design, today = target.design, datetime.now(UTC).date()
    whose = CalibrationOwner(ANY, target.scene, target.scene is not None, (design.name,))
    found = stored(FilmCalibration, whose, certain=False, today=today, check=lambda c: c.check_films(design))
    return replace(target, design=found[0].apply(design)) if found else target
