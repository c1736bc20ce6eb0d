"""Labels of a logarithmic axis are read: at least two, and none touches the next."""

from __future__ import annotations

from itertools import pairwise

import pytest

from palpate.procedures.showing.figure import logarithmic, new_figure


@pytest.mark.parametrize("limits", [(8.7, 300.0), (24.0, 115.0), (31.0, 33.0), (14.0, 55.0), (2.0, 5000.0)])
def test_labels_of_a_logarithmic_axis_do_not_touch(limits: tuple[float, float]) -> None:
    figure, (axes, _) = new_figure(False, 2, "a title")
    logarithmic(axes, *limits)
    figure.draw_without_rendering()
    left, right = axes.get_window_extent().intervalx
    boxes = [label.get_window_extent() for label in axes.get_xticklabels(which="both") if label.get_text()]
    inside = [box for box in boxes if left <= (box.x0 + box.x1) / 2 <= right]
    assert len(inside) >= 2
    assert all(one.x1 < other.x0 for one, other in pairwise(sorted(inside, key=lambda box: box.x0)))
