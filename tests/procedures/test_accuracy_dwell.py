"""palpate accuracy dwell: what a dwell buys, by whom, and what none buys."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.estimate import ESTIMATORS, LEAST_SQUARES, Floats
from palpate.procedures.accuracy.dwell import (
    COHERENT,
    SCATTER,
    DwellPrices,
    EstimatorPoint,
    measure,
    plot_dwell,
    print_dwell,
)
from palpate.procedures.virtual import waveforms as dwell
from tests.procedures.conftest import Palpate

FREQUENCY, RATE = 10.0, 250.0
COMMAND = ("accuracy", "dwell", "--scene", "noisy_lab")


@dataclass(frozen=True)
class Record:
    time: Floats
    voltage: Floats
    saturated: bool
    ratio: float
    scatter: float


def record(relative: float, duration: float = 100.0, gain: float = 1.0, scatter: float = 0.04) -> Record:
    time = np.arange(round(duration * RATE)) / RATE
    amplitude = np.array([[0.2 * gain], [1.0]])
    noise = np.random.default_rng(1).normal(size=(2, time.size)) * relative * amplitude
    voltage = 3.0 + amplitude * np.cos(2 * np.pi * FREQUENCY * time + 0.3) + noise
    return Record(time, voltage, False, 0.2, scatter)


def rows(prices: DwellPrices, estimator: str) -> list[EstimatorPoint]:
    return [p for p in prices.points if p.estimator == estimator]


def test_its_plot_says_that_it_is_simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure))
    plot_dwell(measure(record(0.05), FREQUENCY, (1.0,)), "scene noisy_lab", tmp_path)
    assert figures[0].get_suptitle() == "SIMULATED: scene noisy_lab"


def test_nothing_is_recommended_by_films_that_are_over_ranged(capsys: pytest.CaptureFixture[str]) -> None:
    prices = measure(record(0.05), FREQUENCY, (1.0,), (LEAST_SQUARES,))
    said = []
    for saturated in (False, True):
        print_dwell(replace(prices, saturated=saturated), "scene noisy_lab", None)
        said.append(capsys.readouterr().out)
    assert ["for 10 %: " in text for text in said] == [True, False]
    assert ["a film is over-ranged" in text for text in said] == [False, True]


def test_least_squares_follow_the_bound_down_with_the_dwell() -> None:
    prices = measure(record(0.05), FREQUENCY, (0.1, 1.0, 10.0))
    for point in rows(prices, LEAST_SQUARES):
        assert point.u == pytest.approx(point.bound, abs=3 * point.u_u)
        assert abs(point.bias) < 4 * point.bias_u
    first, *_, last = rows(prices, LEAST_SQUARES)
    assert first.bound / last.bound > 10
    assert (first.repeats, last.repeats) == (1000, 10)


def test_peak_to_peak_and_rms_show_their_bias() -> None:
    """The relative noise of the films differs; else it would cancel in the ratio."""
    taken = record(0.01)
    taken.voltage[0] += 0.1 * np.random.default_rng(2).normal(size=taken.time.size)
    prices = measure(taken, FREQUENCY, (1.0,))
    for name in ESTIMATORS:
        (point,) = rows(prices, name)
        biased = name in ("RMS", "peak to peak")
        assert (point.bias > 0.05) == biased, name


def test_the_floor_holds_the_scatter_and_what_moves_with_the_drive() -> None:
    prices = measure(record(0.01, gain=1.02), FREQUENCY, (1.0,), (LEAST_SQUARES,))
    assert prices.floor[SCATTER] == 0.04
    assert prices.floor[COHERENT] == pytest.approx(0.02, abs=1e-3)
    assert prices.floor_u == pytest.approx(math.hypot(0.04, 0.02), abs=1e-3)
    assert [each.dwell_s is None for each in prices.recommended] == [False, True, True, True]
    assert "in step with the drive leaves 2.0" in prices.recommended[1].why


def test_a_bias_within_its_noise_is_no_floor() -> None:
    prices = measure(record(0.3, scatter=0.0), FREQUENCY, (1.0,), (LEAST_SQUARES,))
    assert prices.floor_u == 0.0
    recommended = {each.target: each.dwell_s for each in prices.recommended}
    assert {each.sets for each in prices.recommended} == {1}
    assert recommended[0.01] == pytest.approx(2 * 2 * 0.3**2 / RATE / 0.01**2, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequency", "told"),
    [("10 Hz", "tells the mains' hum from the drive"), ("48 Hz", "over 0.1 s lets 0.89 of the mains' hum into")],
)
def test_hum_that_a_dwell_cannot_tell_from_the_drive_is_named(palpate: Palpate, frequency: str, told: str) -> None:
    said = palpate("accuracy", "dwell", "--scene", "ideal", "--dwell", "0.1 s", "--frequency", frequency).out
    assert f"least squares {told}" in said


def test_no_whole_uncertainty_of_a_load_set_is_below_the_floor() -> None:
    prices = measure(record(0.01, gain=1.02), FREQUENCY, (0.1, 1.0, 10.0))
    assert all(point.whole_u >= prices.floor_u for point in prices.points)
    assert all(point.whole_u > max(point.u, abs(point.bias)) for point in prices.points)


def test_below_the_floor_the_mean_of_load_sets_leads_there_and_the_table_has_its_numbers() -> None:
    prices = measure(record(0.01, scatter=0.04), FREQUENCY, (0.2, 2.0), (LEAST_SQUARES,))
    found = prices.recommended[1]
    assert (found.target, found.sets, found.dwell_s) == (0.01, 17, 0.2)
    point = rows(prices, LEAST_SQUARES)[0]
    assert found.u == pytest.approx(math.hypot(0.04, point.u) / math.sqrt(17), rel=1e-6)
    assert found.seconds == pytest.approx(17 * point.seconds)


def test_a_silent_film_gives_no_prices() -> None:
    silent = Record(np.arange(5000) / RATE, np.zeros((2, 5000)), False, 0.2, 0.0)
    with pytest.raises(EstimateError):
        measure(silent, FREQUENCY, (1.0,))


def test_the_command_gives_a_table_a_plot_and_json(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dwell, "RECORD", 60.0)
    said = palpate(*COMMAND, "--dwell", "0.2 s, 2 s", "--json", "--out", str(tmp_path / "new")).object
    assert set(said) == {
        "simulated", "scene", "sample", "load_N", "frequency_Hz", "sample_rate_Hz", "points", "floor", "floor_u",
        "noise", "saturated", "recommended", "plot",
    }  # fmt: skip
    assert said["simulated"] is True and Path(said["plot"]).exists()
    assert {p["estimator"] for p in said["points"]} == set(ESTIMATORS)
    by = {(p["estimator"], p["dwell_s"]): p for p in said["points"]}
    assert by["RMS", 2.0]["bias"] > 0.2  # hum
    found = by[LEAST_SQUARES, 2.0]  # cables move with the load
    assert 0 < found["bias_u"] < 0.003
    assert found["bias"] == pytest.approx(0.02, abs=3 * found["bias_u"])
    assert said["floor"][COHERENT] == pytest.approx(0.02, abs=3 * found["bias_u"])


def test_people_see_bound_bias_floor_and_stamp(palpate: Palpate) -> None:
    said = palpate("accuracy", "dwell", "--dwell", "1 s", "--estimator", LEAST_SQUARES).out
    assert "SIMULATED" in said and "bound" in said and "bias" in said
    assert "floor that no dwell beats: 4.10%" in said and "for 1 %: the mean of " in said


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--dwell", "50 ms"), "dwell 50 ms is below one cycle of 10 Hz"),
        (("--rate", "15 Hz"), "10 Hz is not above 0 and below half the sample rate, 7.5 Hz"),
        (("--rate", "0 Hz"), "10 Hz is not above 0 and below half the sample rate, 0 Hz"),
        (("--rate", "1 GHz"), "has more than 10,000,000 samples; take a shorter dwell or a lower rate"),
        (("--dwell", "1e9 s"), "has more than 10,000,000 samples"),
        (("--estimator", "least sqares"), "unknown estimator 'least sqares' (did you mean 'least squares'?)"),
        (("--scene", "noisy_lap"), "did you mean 'noisy_lab'?"),
        (("--sample", "9"), "unknown sample"),
        (("--dwell", "1 N"), "1 N"),
    ],
)
def test_what_gives_no_estimate_is_refused(palpate: Palpate, options: tuple[str, ...], part: str) -> None:
    said = palpate("accuracy", "dwell", *options)
    assert said.status == 2
    assert part in said.err and said.out == ""


def test_a_plot_that_cannot_be_kept_is_told_before_anything_is_measured(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dwell, "price", None)
    said = palpate("accuracy", "dwell", "--out", __file__)
    assert said.status == 1 and "cannot write" in said.err
