"""What the figures of chapter 5 draw of our benches."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.reproduce.figures.chapter5 import _bench


def test_a_benchs_mean_ratio_stands_over_its_modulus_with_bars_of_its_standard_uncertainty() -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    means = [("1", 0.31, 0.02), ("2", 0.14, 0.01), ("3", None, None)]  # the third has no valid point
    swept = SimpleNamespace(
        samples=[SimpleNamespace(sample=s, force_ratio=ratio, force_ratio_u=u) for s, ratio, u in means]
    )
    _bench(axes, "single", swept, "C0", "ours")  # type: ignore[arg-type]
    (drawn,) = axes.containers
    line, _, (bars,) = drawn.lines
    assert drawn.get_label() == "ours"
    assert (line.get_marker(), line.get_linestyle(), line.get_color()) == ("s", "None", "C0")
    assert line.get_xydata().tolist() == [[SAMPLES["1"].modulus, 0.31], [SAMPLES["2"].modulus, 0.14]]
    ends = [[tuple(end) for end in segment] for segment in bars.get_segments()]
    for (low, high), (name, ratio, u) in zip(ends, means, strict=False):
        assert low == pytest.approx((SAMPLES[name].modulus, ratio - u))
        assert high == pytest.approx((SAMPLES[name].modulus, ratio + u))
