"""What a solve of the solid model was said to take, and what it takes on this machine."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import replace
from unittest import mock

from palpate.instrument.models.finite_elements import kept
from palpate.instrument.models.parameters import solid_parameters
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.solid import model
from tests.benchmarks.row import Row

AT = (3e-3, 3e-3)
CASES = (("single", AT), ("common_base", None), ("common_base", AT), ("array", None))
WITHIN = 2.0


def measure() -> list[Row]:
    """A row for the first two meshes of each case."""
    rows = []
    for design, at in CASES:
        question = RatioQuestion(design, "solid", at=at)
        parameters = replace(solid_parameters(question.sensor(), question.load(1.0)), sensed_modulus=1.0, force=1.0)
        with tempfile.TemporaryDirectory() as room, mock.patch.dict(os.environ, {kept.VARIABLE: room}):
            asked = model._new(parameters, 2)  # the command tells the price alone, not each mesh
            said = model._cost(asked, {}).seconds
            start = time.process_time()
            for each in asked:
                model.found_on(*each)
            took = time.process_time() - start
        met = 1 / WITHIN <= said / took <= WITHIN
        figure = f"price of a solve, {design}{' under a load in one point' if at else ''}"
        rows.append(
            Row(figure, f"said {said:.1f} s, took {took:.1f} s of processor time", f"within {WITHIN:g} times", met)
        )
    return rows
