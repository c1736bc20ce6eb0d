"""The calibrations that a bench will probably use, told from the store before it is known which bench will answer."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING

from palpate.instrument.calibration.calibration import ANY, CalibrationOwner
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.procedures.lab.calibrations import asked_of, stored

if TYPE_CHECKING:
    from palpate.instrument.findings.object_modulus import ByReferences
    from palpate.instrument.models.ratio import RatioQuestion
    from palpate.procedures.lab.lab import Target


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
