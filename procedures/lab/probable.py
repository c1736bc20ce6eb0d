"""The calibrations that a bench will probably use, told from the store before it is known which bench will answer."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.calibration.files import read_calibration, read_film_calibration, read_model_calibration
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.errors import PalpateError
from palpate.procedures.lab.calibrations import checked, films_path, load_cell_path, model_path, stored_at

if TYPE_CHECKING:
    from palpate.instrument.findings.object_modulus import ByReferences
    from palpate.instrument.models.ratio import Question
    from palpate.procedures.lab.lab import Target


def probable_load_cell(simulated: bool) -> LoadCellCalibration | None:
    """The newest stored calibration of a load cell, before it is known which bench will answer; None: there is none."""
    found = []
    for path in load_cell_path("").parent.glob("load_cell-*.toml"):
        with suppress(PalpateError):
            found.append(read_calibration(path))
    found = [each for each in found if each.simulated == simulated]
    return max(found, key=lambda each: each.created, default=None)


def probable_references(question: Question, scene: str | None, today: date) -> ByReferences | None:
    """The newest stored calibration of the model that answers a question, before it is known which bench will answer.

    One of another scene is of another sensor. Of a real bench one that is damaged or has expired does not count: the
    bench will tell of it when it is open.

    Args:
        question: what is asked.
        scene: identity of the scene of a simulated bench; None: it is that of a bench file.
        today: date by which calibrations expire.

    Raises ConfigError: that of the scene is damaged, was changed by hand, or has expired.
    """
    from palpate.instrument.findings.object_modulus import ByReferences, answering

    thickness = question.load(question.sensor().ring.material.modulus).sensed.thickness
    path = model_path("*", question.design, answering(question), question.parameters, thickness, scene)

    def read(file: Path) -> ModelCalibration:
        return checked(file, read_model_calibration(file), lambda c: c.check_date(today))

    found = [each for each in stored_at(path, read, certain=scene is not None) if each.scene == scene]
    if not found:
        return None
    newest = max(found, key=lambda each: each.created)
    return ByReferences(newest, newest.film_calibration is None)


def references_on(target: Target, question: Question) -> ByReferences | None:
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
    design, simulated, today = target.design, target.scene is not None, datetime.now(UTC).date()

    def read(file: Path) -> FilmCalibration:
        return checked(file, read_film_calibration(file), lambda c: c.check_use(design, c.device, simulated, today))

    found = stored_at(films_path("*", design.name), read, certain=False)
    newest = max(found, key=lambda each: each.created, default=None)
    return target if newest is None else replace(target, design=newest.apply(design))
