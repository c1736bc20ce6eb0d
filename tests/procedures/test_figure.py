"""What figures have in common is read: labels of an axis, the stamp SIMULATED, load sets that were repeated."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from PIL import Image

from palpate.extend import Column
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, plot_over_loads, with_u, write
from tests.procedures.conftest import Palpate


@pytest.mark.parametrize("limits", [(24.0, 115.0), (31.0, 33.0), (2.0, 5000.0)])
def test_labels_of_a_logarithmic_axis_do_not_touch(limits: tuple[float, float]) -> None:
    figure, (axes, _) = new_figure(False, 2, "a title")
    logarithmic(axes, *limits)
    figure.draw_without_rendering()
    left, right = axes.get_window_extent().intervalx
    boxes = [label.get_window_extent() for label in axes.get_xticklabels(which="both") if label.get_text()]
    inside = [box for box in boxes if left <= (box.x0 + box.x1) / 2 <= right]
    assert len(inside) >= 2
    assert all(one.x1 < other.x0 for one, other in pairwise(sorted(inside, key=lambda box: box.x0)))


@dataclass(frozen=True)
class Set:
    load_N: float
    force_ratio: float
    force_ratio_u: float = 0.01
    valid: bool = True


def test_repeated_loads_have_one_line_through_the_mean_of_the_valid_sets() -> None:
    _, (axes,) = new_figure(False, 1, "a title")
    sets = [Set(2, 0.30), Set(3, 0.32), Set(4, 0.31, valid=False), Set(2, 0.32), Set(3, 0.9, valid=False)]
    plot_over_loads(axes, 0, "sample 1", sets)
    lines = [line for line in axes.lines if line.get_linestyle() == "-" and line.get_marker() == "None"]
    assert [list(map(tuple, line.get_xydata())) for line in lines] == [[(2, pytest.approx(0.31)), (3, 0.32)]]


def test_bars_and_bands_do_not_cover_the_stamp() -> None:
    _, (axes,) = new_figure(True, 1, "a title")
    axes.axhspan(0, 1)
    axes.barh([0, 1], [1, 2])
    axes.errorbar([0, 1], [0, 1], [1, 1])
    (stamp,) = axes.texts
    assert stamp.get_text() == "SIMULATED"
    drawn = max(each.get_zorder() for each in (*axes.patches, *axes.lines, *axes.collections))
    assert drawn < stamp.get_zorder() < axes.legend([], []).get_zorder()


# --- the file: its format, and its text for who cannot see it -------------------------------------------


def drawn() -> Figure:
    figure, (left, right) = new_figure(True, 2, "films <1> & 2")
    left.plot([0, 1], [0, 1], label="F1")
    left.set(xlabel="load (N)", ylabel="voltage (mV)")
    right.set(xlabel="time (s)", ylabel="change (%)")
    name_all(left)
    return figure


TOLD = "SIMULATED: films <1> & 2. Panel 1: voltage (mV) over load (N); F1. Panel 2: change (%) over time (s)."


def test_a_png_or_svg_says_what_it_shows_and_is_the_same_each_time(tmp_path: Path) -> None:
    for kind in ("png", "svg"):
        for name in ("one", "other"):
            write(drawn(), tmp_path / f"{name}.{kind}")
        assert (tmp_path / f"one.{kind}").read_bytes() == (tmp_path / f"other.{kind}").read_bytes()
    with Image.open(tmp_path / "one.png") as image:
        told = [("title", image.info["Title"]), ("desc", image.info["Description"])]
    root = ElementTree.parse(tmp_path / "one.svg").getroot()
    assert [(each.tag.partition("}")[2], each.text) for each in root[:2]] == told
    assert [text for _, text in told] == ["SIMULATED: films <1> & 2", TOLD]


@dataclass(frozen=True)
class Pressed:
    volts: Annotated[tuple[float, ...], Column("voltages", "V", u="volts_u")]
    volts_u: tuple[float, ...]
    mean: Annotated[float | None, Column("mean", "V")] = None


def test_values_for_a_plot_have_the_uncertainties_of_their_column() -> None:
    rows = [Pressed((1.0, 2.0), (0.1, 0.2)), Pressed((3.0, 4.0), (0.3, 0.4), 3.5)]
    assert with_u(rows, "volts", 1e3, 1) == ([2e3, 4e3], [200.0, 400.0])
    values, u = with_u(rows, "mean")
    assert values == [pytest.approx(float("nan"), nan_ok=True), 3.5]
    assert u is None
    assert with_u([], "mean") == ([], None)


# --- the plots of procedures ----------------------------------------------------------------------------

WITHOUT_UNIT = ("strain", "sample", "object", "force ratio", "mean force ratio", "number of the set", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        "sweep loads --samples 1,2 --loads 2N,3N",
        "sweep frequency",
        "sweep temperature",
        "sweep position",
        "calibrate load-cell",
        "calibrate films",
        "characterise",
        "test modulus --sample 1",
        "softness --samples 1,3",
        "measure modulus --sample 1 --time 3min --relative-to-model",
    ],
)
def test_a_plot_has_bars_units_and_a_legend_that_covers_no_point(
    command: str, palpate: Palpate, figures: list[Figure]
) -> None:
    assert palpate(*command.split(), "--quiet").status == 0
    (figure,) = figures
    figure.draw_without_rendering()
    assert any(each.has_yerr for each in figure.axes[0].containers if isinstance(each, ErrorbarContainer))
    for axes in figure.axes:
        if (legend := axes.get_legend()) is not None:
            assert legend.get_window_extent().y0 >= axes.get_window_extent().y1
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert "(" in label or label in WITHOUT_UNIT, label
