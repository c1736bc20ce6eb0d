"""palpate model shear."""

from __future__ import annotations

import pytest

from palpate.instrument.models import shear as model
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from tests.procedures.conftest import Palpate


@pytest.fixture
def felt(monkeypatch: pytest.MonkeyPatch) -> None:
    def of_meshes(design: Design, sample: Sample, refinement: int) -> dict[str, model.FilmShear]:
        assert (design.name, sample.name) == ("common_base", "1")
        dragged = {"tooth": 1e-12, "object": 0.02 + 0.001 * refinement}
        return {
            "rigid_1": model.FilmShear(0.2, 21.0, dragged, 24e-3),
            "total": model.FilmShear(1.0, 0.0, dict.fromkeys(model.DRAGGED, 0.0), 24e-3),
        }

    monkeypatch.setattr(model, "shear", of_meshes)


@pytest.mark.usefixtures("felt")
def test_the_command_gives_forces_places_and_the_change_from_the_mesh_before(palpate: Palpate) -> None:
    found = palpate("model", "shear", "--json").object
    first, total = found["films"]
    assert first == {
        "film": "rigid_1", "pressed_N": 0.2, "change_N": pytest.approx(0.001), "tooth_N": 0.0,
        "tooth_off_centre_m": pytest.approx(0, abs=1e-12), "object_N": 0.021,
        "object_off_centre_m": pytest.approx(1e-3),
    }  # fmt: skip
    assert total["object_off_centre_m"] is None
    assert found["told"] == "off centre"
    shown = palpate("model", "shear")
    assert "+0.02100" in shown.out
    assert "+1.000" in shown.out
    assert "shear looks like a load off centre" in shown.out
    assert shown.err == "palpate: note: solving the finer mesh of common_base takes about 5 s\n"


def test_an_unknown_design_or_sample_and_several_rows_are_refused(palpate: Palpate) -> None:
    assert "design 'array' has 2 rows of teeth" in palpate("model", "shear", "--design", "array").complaint
    assert "unknown sample '9'" in palpate("model", "shear", "--sample", "9").complaint
    assert "did you mean 'single'" in palpate("model", "shear", "--design", "singel").complaint
