"""`palpate sweep frequency` finds the charge amplifiers' corner and the shaker's resonance."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.frequency_response import high_pass
from palpate.procedures.measurements.frequency import (
    FilmFrequencyResponse,
    FrequencyPoint,
    dwell_at,
    evaluate,
    parse_frequencies,
)
from palpate.procedures.records.run import Run
from tests.procedures.conftest import IDEAL_SCENE, Benches, Palpate, refused

SWEEP = ("sweep", "frequency")


@pytest.mark.slow
def test_the_corner_of_each_film_is_that_of_its_charge_amplifier(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "slow.toml"
    scene.write_text(IDEAL_SCENE + '[effects.charge_amplifier]\ntime_constant = "0.5 s"\n[effects.load_cell]\n')
    arguments = ("--scene", str(scene), "--frequencies", "0.2 Hz, 0.5 Hz, 30 Hz", "--dwell", "0.1 s", "--json")
    found = palpate(*SWEEP, *arguments, "--budget").object
    of_rigid, above, *_ = found["budgets"]
    assert [each["quantity"] for each in (of_rigid, above)] == ["corner of film rigid", "gain of film rigid"]
    assert (of_rigid["u"], above["u"]) == (found["corners"][0]["corner_u"], found["corners"][0]["gain_u"])
    assert [part["name"] for part in above["components"]] == ["points of the sweep", "load cell"]
    for corner in found["corners"]:
        assert corner["corner_Hz"] == pytest.approx(1 / math.pi, abs=2 * corner["corner_u"])
        assert corner["corner_Hz"] == pytest.approx(1 / math.pi, rel=0.03)
    assert [(p["frequency_Hz"], p["tactile"], p["valid"]) for p in found["points"]] == [
        (0.2, True, True), (0.5, True, True), (30.0, False, True),
    ]  # fmt: skip
    for point in found["points"]:
        rigid, total = point["films"]
        assert abs(rigid["phase_deg"]) < 0.2  # both amplifiers are alike
        assert (total["phase_deg"], total["phase_u"]) == (0, 0)
    assert found["points"][2]["films"][1]["gain_V_per_N"] == pytest.approx(68.6e-3, rel=0.02)
    assert len(Run.open(Path(found["run"])).points()) == 3


@pytest.mark.slow
def test_stated_uncertainties_hold_where_all_points_share_the_load_cell_s_error() -> None:
    """The load cell's curve is made to err by much: that is no scatter of the gains, and does not move the corner."""
    random, design, frequency = np.random.default_rng(7), get_design("single"), np.geomspace(0.1, 100, 13)
    calibration = THESIS_LOAD_CELL.model_copy(update={"sensitivity_u": 0.05 * THESIS_LOAD_CELL.sensitivity_mV_per_N})
    load, load_u = calibration.load(calibration.reading(2.0))
    curve_u, exact = calibration.curve_u(load) / load, np.exp(high_pass(frequency, 0.0, 0.159))
    z = []
    for _ in range(40):
        shared = curve_u * random.standard_normal()
        own = math.sqrt((load_u / load) ** 2 - curve_u**2) * random.standard_normal(13)
        points = []
        for f, gain, error in zip(frequency.tolist(), exact.tolist(), own.tolist(), strict=True):
            films = [
                FilmFrequencyResponse(
                    film.name,
                    gain * (1 + shared + error + film.scatter * random.standard_normal()),
                    gain * math.hypot(film.scatter, load_u / load),
                    phase_deg=0.0,
                    phase_u=0.0,
                )
                for film in design.films
            ]
            points.append(FrequencyPoint(f, False, load, load_u, 1.0, tuple(films), True, 1.0, 0.0, 1, ()))
        corners = evaluate(points, design, calibration).corners.values()
        z += [[(c.gain - 1) / c.gain_u, (c.corner_Hz - 0.159) / c.corner_u] for c in corners if c is not None]
    assert len(z) == 80
    assert np.std(z, axis=0) == pytest.approx([1, 1], rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frequencies", "1 Hz, 2 Hz"), "2 frequencies; give 3 to 200 to find a corner"),
        (("--frequencies", "1 Hz:2 Hz:2"), "a count of 3 to 200"),
        (("--frequencies", "3 Hz, 2 Hz, 5 Hz"), "they must increase"),
        (("--frequencies", "0.01 Hz, 1 Hz, 2 Hz"), "frequency 0.01 Hz is outside 0.1 to 100 Hz"),
        (("--frequencies", "1 Hz, 9 Hz, 1 kHz"), "frequency 1000 Hz is outside 0.1 to 100 Hz"),
        (("--frequencies", "1.00049 Hz, 2 Hz, 3 Hz"), "lies between the exciter's steps"),
        (("--dwell", "2 h"), "dwell 7200 s is not above 0 and at most 3600 s"),
        (("--dwell", "-1 s"), "dwell -1 s is not above 0"),
        (("--load", "0 N"), "load 0 N peak to peak is not above zero"),
        (("--load", "9.5 N"), "above the bench's force limit of 10 N"),
        (("--sample", "7"), "unknown sample '7'"),
    ],
)
def test_what_cannot_be_swept_is_refused_before_a_bench_starts(
    palpate: Palpate, benches: Benches, arguments: tuple[str, str], message: str
) -> None:
    assert message in refused(palpate(*SWEEP, *arguments), benches)


def test_frequencies_are_even_in_the_logarithm_and_whole_millihertz() -> None:
    assert parse_frequencies("0.1 Hz:100 Hz:4") == (0.1, 1.0, 10.0, 100.0)
    assert parse_frequencies("1 Hz:2 Hz:3") == (1.0, 1.414, 2.0)
    assert parse_frequencies("1 Hz, 3 Hz, 5 Hz") == (1.0, 3.0, 5.0)


def test_a_dwell_is_of_whole_cycles_three_at_least() -> None:
    assert dwell_at(0.1, 1.0) == pytest.approx(30.0)
    assert dwell_at(10.0, 1.0) == pytest.approx(1.0)
    assert dwell_at(17.783, 1.0) * 17.783 == pytest.approx(18)
