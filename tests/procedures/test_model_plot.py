"""What `palpate model plot` draws, where it goes, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from palpate.instrument.models.parameters import PHYSICAL
from palpate.instrument.models.response import RatioAnswer, RatioQuestion, response
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.showing import model_picture
from palpate.procedures.showing import model_picture as model_plot
from palpate.procedures.showing.model_picture import ModelPicture
from tests.procedures.conftest import Palpate, changed
from tests.settings import give_meshes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLOT = ("model", "plot", "--sensed-modulus", "100 kPa")
CLOSED = (*PLOT, "--model", "column")
ROUND = RatioQuestion("single", "axisymmetric", "identified", tolerance=1e-2)


@pytest.fixture
def few_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_picture, "CURVES", ("column", "axisymmetric", "experiment"))
    monkeypatch.setattr(model_picture, "CURVE_TOLERANCE", -1.0)  # finite elements are not solved for a line


@pytest.fixture(scope="module")
def picture() -> ModelPicture:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_picture, "CURVES", ("column",))
        patch.setattr(model_picture, "SECTION_REFINEMENT", 1)
        return model_picture.solve(ROUND, [1e5, 1e6])


@pytest.fixture(scope="module")
def panels(picture: ModelPicture) -> list[Axes]:
    """The panels of the figure in their order: deformation, pressure, ratio."""
    saved: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: saved.append(figure))
        model_plot.draw(picture, Path("sensor.png"))
    (figure,) = saved
    figure.draw_without_rendering()
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def labels(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]  # type: ignore[union-attr]


# --- what is drawn --------------------------------------------------------------------------------------


def test_the_section_shows_every_body_on_both_sides_of_the_axis(picture: ModelPicture, panels: list[Axes]) -> None:
    from matplotlib.collections import QuadMesh

    deformed = panels[0]
    meshes = [item for item in deformed.collections if isinstance(item, QuadMesh)]
    bodies = picture.sections[0].bodies
    # The object reaches the axis, the ring does not.
    assert ({name: len(pieces) for name, pieces in bodies.items()}, len(meshes)) == ({"object": 1, "ring": 2}, 3)
    for pieces in bodies.values():
        assert min(piece.x.min() for piece in pieces) == -max(piece.x.max() for piece in pieces)
    largest = max(picture.sections[0].largest.values())
    assert max(float(np.max(mesh.get_array())) for mesh in meshes) == pytest.approx(1e6 * largest)  # type: ignore[arg-type]
    assert {text.get_text() for text in deformed.texts} == {"object", "ring"}
    assert f"100 kPa, displacements × {picture.scale:g}" in deformed.get_title()


def test_the_largest_displacement_stays_small_in_the_drawing(picture: ModelPicture) -> None:
    section = picture.sections[0]
    assert 0.04 < picture.scale * max(section.largest.values()) / section.height <= 0.12
    digits = picture.scale / 10 ** np.floor(np.log10(picture.scale))
    assert digits == pytest.approx(min((1, 2, 5), key=lambda step: abs(step - digits)))


def test_the_pressure_is_broken_over_the_gap_and_says_what_the_tooth_takes(
    picture: ModelPicture, panels: list[Axes]
) -> None:
    pressure = panels[1]
    assert pressure.get_yscale() == "log"
    assert "clipped" in pressure.get_title()
    for line, section in zip(pressure.get_lines(), picture.sections, strict=False):
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        gap = int(np.flatnonzero(np.isnan(x))[0])
        assert x[gap - 1] < 1e3 * section.teeth[0][1] < 1.5 <= x[gap + 2]
        assert np.nanmin(y) > 0
    taken = [f"tooth takes {100 * answer.response.force_ratio:.1f} %" for answer in picture.answers]
    assert [label.split(": ")[1] for label in labels(pressure)[:2]] == taken
    highest = max(float(section.pressure.max()) for section in picture.sections) / 1e3
    assert pressure.get_ylim()[1] < highest


def test_the_ratio_panel_holds_the_models_the_thesis_and_what_was_asked(
    picture: ModelPicture, panels: list[Axes]
) -> None:
    ratio = panels[2]
    assert labels(ratio) == [
        "column, physical parameters", "thesis, finite elements (A2.1)",
        "thesis, measured means", "axisymmetric, as asked",
    ]  # fmt: skip
    asked = ratio.get_lines()[-1]
    assert list(np.asarray(asked.get_xdata())) == pytest.approx([100, 1000])
    assert list(np.asarray(asked.get_ydata())) == [answer.response.force_ratio for answer in picture.answers]


def test_the_data_are_those_of_the_picture(picture: ModelPicture) -> None:
    data = picture.data()
    assert [point["sensed_modulus_Pa"] for point in data["points"]] == [1e5, 1e6]
    assert (set(data["deformation"]["largest_displacement_m"]), len(data["pressure"])) == ({"object", "ring"}, 2)
    assert len(data["pressure"][0]["x_m"]) == len(data["pressure"][0]["pressure_Pa"]) > 20
    assert len(data["curves"]["column, physical parameters"]["force_ratio"]) == 200
    assert len(data["thesis"]["thesis, finite elements (A2.1)"]["force_ratio"]) == 48
    assert all(0 < ratio < 1 for ratio in data["thesis"]["thesis, finite elements (A2.1)"]["force_ratio"][:40])


def test_the_solid_model_shows_both_teeth_of_a_pair(monkeypatch: pytest.MonkeyPatch, few_curves: None) -> None:
    smallest = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
    give_meshes(monkeypatch, smallest)
    monkeypatch.setattr(model_picture, "SOLID_REFINEMENT", 0)
    saved: list[Figure] = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: saved.append(figure))
    sensor, load = get_design("common_base"), PHYSICAL.load(1e6)
    section = model_picture.SECTIONS["solid"](sensor, load)
    answer = RatioAnswer(1e6, response(sensor, load, "column"), 0.0)
    question = RatioQuestion("common_base", "solid")
    model_plot.draw(ModelPicture(question, [answer], [section], {}, {}), Path("sensor.png"))
    deformed, pressure, *_ = (axes for axes in saved[0].axes if axes.get_label() != "<colorbar>")

    assert {name: len(pieces) for name, pieces in section.bodies.items()} == {
        "lower plate": 1, "base film": 1, "upper plate": 1, "tooth film": 2, "tooth": 2, "ring": 4, "object": 1,
    }  # fmt: skip
    assert np.array(section.teeth) == pytest.approx(np.array([[4.6e-3, 7.4e-3], [16.6e-3, 19.4e-3]]))
    # Symmetric about the middle, and harder on the teeth than beside them.
    assert (section.x + section.x[::-1], section.pressure) == (
        pytest.approx(np.full(len(section.x), 24e-3)),
        pytest.approx(section.pressure[::-1]),
    )
    on_teeth = np.abs(section.x % 12e-3 - 6e-3) < 1.4e-3
    assert section.pressure[on_teeth].min() > section.mean > np.median(section.pressure[~on_teeth])
    assert (deformed.get_xlabel(), pressure.get_xlim()) == ("place along the sensor (mm)", (0, 24))
    assert "teeth take" in labels(pressure)[0]
    # Nothing is drawn across what the object does not touch: gaps around the teeth, and between the rings.
    x = np.asarray(pressure.get_lines()[0].get_xdata())
    for start, end in ((4.5, 4.6), (7.4, 7.5), (11.0, 13.0), (16.5, 16.6), (19.4, 19.5)):
        after = int(np.flatnonzero(x >= end)[0])
        assert np.isnan(x[after - 1]) and not ((x > start) & (x < end)).any()


def test_a_model_that_does_not_know_the_sensor_has_no_curve(few_curves: None) -> None:
    drawn = model_picture.solve(RatioQuestion("array", "column"), [1e5])
    assert (set(drawn.curves), drawn.thesis, drawn.sections) == ({"column"}, {}, [])


# --- where it goes --------------------------------------------------------------------------------------


def test_a_model_without_a_section_gets_the_ratio_alone(palpate: Palpate, few_curves: None) -> None:
    said = palpate(*CLOSED, "--out", "sensor.png", "--json")
    assert said.object["file"] == str(Path("sensor.png").absolute())
    assert Path("sensor.png").exists()
    assert said.object["deformation"] is None
    assert (said.object["pressure"], set(said.object["curves"])) == ([], {"column", "experiment"})


def test_without_a_name_each_picture_is_a_new_file_of_the_store(palpate: Palpate, few_curves: None) -> None:
    said = palpate(*CLOSED, "--design", "common_base")
    file = Path(said.out.strip())
    assert (said.status, said.err) == (0, "")
    assert file.is_file()
    assert file.parent == Path("runs/plots").absolute()
    assert file.name.endswith("-common_base-column.png")
    assert palpate("runs", "list", "--json").object == {"runs": []}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--out", "missing/sensor.png"), "missing/sensor.png: there is no folder missing; make it"),
        (("--out", "sensor.txt"), "sensor.txt does not end in .png or .svg"),
        (("--out", "taken.png"), "taken.png exists and is not overwritten"),
        (("--sensed-modulus", "0 Pa"), "--sensed-modulus: '0 Pa' is not above 0 and finite"),
        (("--sensed-modulus", "24 kPa,"), "'' is not a quantity"),
        (("--design", "singel"), "did you mean 'single'?"),
        (("--model", "colum"), "did you mean 'column'?"),
        (("--model", "axisymmetric", "--design", "common_base"), "has 2 teeth, not one; take model 'solid'"),
    ],
)
def test_bad_input_is_one_error_and_leaves_no_file(palpate: Palpate, wrong: tuple[str, ...], message: str) -> None:
    Path("taken.png").touch()
    said = palpate(*changed((*CLOSED, "--out", "new.png"), *wrong))
    assert said.status == 2
    assert message in said.complaint
    assert (len(said.complaint.splitlines()), [file.name for file in Path().iterdir()]) == (1, ["taken.png"])


def test_an_empty_name_is_refused(palpate: Palpate) -> None:
    said = palpate(*CLOSED, "--out", "")
    assert (said.status, said.out) == (2, "")
    assert "the name is empty" in said.err
