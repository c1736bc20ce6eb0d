"""`palpate sweep position` finds a point load by the films, and says where it stood."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from palpate.instrument.thesis import read_table
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.procedures.conftest import Benches, Palpate, refused

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SWEEP = ("sweep", "position")


def test_a_load_between_the_teeth_is_found_with_its_size(palpate: Palpate) -> None:
    found = palpate(*SWEEP, "--positions", "10 mm, 12 mm", "--dwell", "0.5 s", "--json").object
    assert (found["design"], found["scene"]) == ("common_base", "thesis_common_base")
    table = read_table("A2.7")
    for point, place in zip(found["points"], (10.0, 12.0), strict=True):
        assert point["valid"]
        assert point["found_mm"] == pytest.approx(place, abs=3 * point["found_u"])
        assert point["found_u"] < 0.5
        assert point["found_force_N"] == pytest.approx(2.0, abs=3 * point["found_force_u"])
        assert point["share_left"] == pytest.approx(point["model_share_left"], abs=3 * point["share_left_u"])
        assert point["share_right"] == pytest.approx(point["model_share_right"], abs=3 * point["share_right_u"])
        (row,) = (i for i, x in enumerate(table.keys()) if x == place)
        assert point["thesis_share_left"] == table.values("force_pvdf3_N")[row]
    assert found["position_rms_mm"] < 0.5
    assert "Table A2.7" in found["thesis_doubt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--positions", "12 mm"), "1 position cannot make a sweep; give 2 or more"),
        (("--positions", "12 mm, 6 mm"), "positions 12 mm, 6 mm must be increasing and distinct"),
        (("--positions", "0 mm:26 mm:2 mm"), "position 26 mm is off the sensor, which reaches from 0 to 24 mm"),
        (("--positions", "1 N, 2 N"), "'1 N' is in N where m belongs"),
        (("--scene", "thesis_single"), "point loads are known for design 'common_base'"),
        (("--sample", "9"), "unknown sample '9'"),
        (("--dwell", "50 ms"), "below one cycle"),
        (("--load", "9.5 N"), "above the bench's force limit"),
    ],
)
def test_what_cannot_be_swept_is_refused_before_a_bench_starts(
    palpate: Palpate, benches: Benches, arguments: tuple[str, str], message: str
) -> None:
    assert message in refused(palpate(*SWEEP, *arguments), benches)


def test_a_probe_without_a_sample_is_refused() -> None:
    with SimulatedBench(read_scene("thesis_common_base")) as sim, pytest.raises(ValueError, match="no sample lies"):
        sim.operator.place_probe(6e-3, 6e-3)


def test_a_dry_run_lists_the_positions(palpate: Palpate, benches: Benches) -> None:
    found = palpate(*SWEEP, "--dry-run", "--json").object
    assert [p["position_mm"] for p in found["points"]] == pytest.approx(range(0, 25, 2))
    assert found["expected_seconds"] == pytest.approx(1181, rel=0.1)  # what the default sweep takes
    assert benches == []


def test_the_model_is_drawn_between_the_positions_and_places_by_how_far_they_are_off(
    palpate: Palpate, figures: list[Figure]
) -> None:
    printed = palpate(*SWEEP, "--positions", "6 mm, 10 mm", "--dwell", "0.1 s").out
    assert "0.998" in printed  # the thesis' shares have as many digits as ours
    assert "e-05" not in printed
    left, right = figures[0].axes
    (model,) = (line for line in left.lines if line.get_label() == "left, model")
    shares = np.asarray(model.get_ydata())
    assert shares[59:62] == pytest.approx(0.769, abs=1e-3)  # above the tooth, at 6 mm
    (found,) = right.containers
    assert list(found[0].get_xdata()) == [6.0, 10.0]
    assert np.abs(found[0].get_ydata()).max() < 2
