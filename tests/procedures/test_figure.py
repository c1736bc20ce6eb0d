"""What figures have in common is read: labels of an axis, the stamp SIMULATED, load sets that were repeated."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import pytest

from palpate.procedures.showing.figure import logarithmic, new_figure, plot_over_loads


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
