"""`palpate accuracy numerics`: every method on one table, with its error and its time; integrators among them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.price_list import stored
from palpate.procedures.accuracy import numerics
from palpate.procedures.accuracy.numerics import BOUND, Task, Way, of_estimators, of_models
from palpate.procedures.virtual import numerics as collecting
from palpate.simulators.linear import integrators
from palpate.simulators.linear.integrators import STATES, STIFFNESS, IntegratorError, chain, compare
from tests.procedures.conftest import Palpate

FREQUENCY, RATE = 10.0, 250.0


@pytest.fixture(autouse=True)
def tasks_are_short_and_times_not_measured() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numerics, "seconds_of", lambda call: 1e-3)
        patch.setattr(numerics, "STEPS", 200_000)
        patch.setattr(collecting, "RECORD", 40.0)
        patch.setattr(integrators, "DURATION", 0.1)
        patch.setattr(integrators, "TOLERANCES", {})
        yield


def errors(task: Task) -> dict[tuple[str, str], float]:
    return {(way.method, way.setting): way.error for way in task.ways if way.error is not None}


def ratios(
    noise: float, other: float = 0.0, gain: float = 1.0, duration: float = 100.0
) -> dict[tuple[str, str], float]:
    """Errors of all estimators on two films with relative noise, of which the first has some of its own."""
    time = np.arange(round(duration * RATE)) / RATE
    amplitude = np.array([[0.2 * gain], [1.0]])
    scatter = np.random.default_rng(1).normal(size=(2, time.size)) * noise * amplitude
    scatter[0] += other * np.random.default_rng(2).normal(size=time.size)
    voltage = 3.0 + amplitude * np.cos(2 * np.pi * FREQUENCY * time + 0.3) + scatter
    return errors(of_estimators(time, voltage, 0.2, FREQUENCY, "films"))


def test_least_squares_follow_the_bound_down_with_the_dwell() -> None:
    found = ratios(0.05)
    for dwell, repeats in (("0.1 s", 1000), ("2 s", 50), ("10 s", 10)):
        assert found["least squares", dwell] == pytest.approx(found[BOUND, dwell], rel=3 / np.sqrt(2 * repeats))
    assert found[BOUND, "0.1 s"] / found[BOUND, "10 s"] > 10


def test_an_error_holds_the_bias_that_no_dwell_lowers() -> None:
    """Noise of one film alone raises what RMS and peak to peak read of it; a gain of 2 % is seen by all."""
    own = ratios(0.01, other=0.1)
    assert {name for (name, dwell), error in own.items() if dwell == "2 s" and error > 0.05} == {"RMS", "peak to peak"}
    assert ratios(0.001, gain=1.02)["least squares", "10 s"] == pytest.approx(0.02, abs=1e-4)


def test_a_silent_film_gives_no_ratio() -> None:
    time = np.arange(5000) / RATE
    with pytest.raises(EstimateError):
        of_estimators(time, np.zeros((2, 5000)), 0.2, FREQUENCY, "films")


def test_single_precision_loses_a_late_record_and_sums_lose_a_phase_and_noise_helps_a_register() -> None:
    """Half a step of 153 µV on 1.24 mV is 6 %, of 15 µV 0.6 %: the fit sees a good part of it, noise averages it."""
    fit, phase, samples, load = (errors(task) for task in numerics.arithmetic_tasks())
    assert fit["float64, centred QR", ""] < 1e-11 < 10 * fit["float64, normal equations", ""] < 1e-7
    assert fit["float32, normal equations", ""] > 1e-3
    assert phase["integer of 48 bits", ""] == 0.0 and phase["float32 sum", ""] > 0.1
    assert 1e-8 < phase["float64 sum", ""] < 1e-4
    assert 5e-3 < samples["int16 of 5 V", "quiet"] < 0.06
    assert 3 * samples["int16 of 500 mV", "in noise"] < samples["int16 of 500 mV", "quiet"] < 6e-3
    assert samples["float32", "quiet"] < 1e-7
    assert load["display of 1 mV", ""] == pytest.approx(0.5 / 30.9, rel=0.1)


def test_the_front_has_no_method_that_another_beats_in_both() -> None:
    ways = (
        Way("slow", "", 1e-6, 9.0), Way("fast", "", 1e-2, 1.0), Way("as fast", "", 1e-3, 1.0),
        Way("bad", "", 1e-3, 2.0), Way("broken", "", None, 0.1), Way(BOUND, "", 1e-9, 0.1),
    )  # fmt: skip
    assert Task("", "bench", ways).front() == [True, False, True, False, False, False]


def test_models_are_priced_as_callers_get_them_and_data_are_no_model() -> None:
    task = of_models(stored(), "single")
    offered = {price.answer_s for price in stored().prices if price.design == "single"}
    assert {way.seconds for way in task.ways} <= offered
    methods = {way.method for way in task.ways}
    assert {"column", "solid", "surface"} <= methods and "experiment" not in methods
    column, surface = (next(w.error for w in task.ways if w.method == name) for name in ("column", "surface"))
    assert column == pytest.approx(0.136, abs=2e-3) and surface == pytest.approx(3.7e-4, abs=1e-5)
    assert surface is not None and 0 < task.reference < surface


def test_the_command_joins_all_tasks_in_one_schema_with_a_picture(palpate: Palpate, tmp_path: Path) -> None:
    said = palpate("accuracy", "numerics", "--json", "--out", str(tmp_path / "new.svg"))
    assert said.err.startswith("palpate: note: measuring estimators, integrators and arithmetic takes about")
    found = said.object
    assert found["machine"]["cpu"] == stored().machine.cpu and Path(found["plot"]) == tmp_path / "new.svg"
    assert Path(found["plot"]).exists()
    assert [task["clock"] for task in found["tasks"]] == ["processor", "bench", *["processor"] * 6]
    for task in found["tasks"]:
        assert task.keys() == {"task", "clock", "reference", "ways"}
        for way in task["ways"]:
            assert (way.keys(), way["error"] is None) == (
                {"method", "setting", "error", "seconds", "failure", "front"},
                bool(way["failure"]),
            )
    failed = [(way["method"], way["failure"]) for task in found["tasks"] for way in task["ways"] if way["failure"]]
    assert failed[-1] == ("Bouc-Wen, explicit Euler", "runs away")


def test_people_get_tables_of_80_columns_with_machine_and_stamp(palpate: Palpate) -> None:
    said = palpate("accuracy", "numerics", "--design", "array").out
    assert "design array" in said and "SIMULATED force ratio of scene thesis_single" in said
    assert "integer of 48 bits" in said and stored().machine.date in said
    assert "Bouc-Wen, explicit Euler, 0.001: runs away" in said
    assert max(map(len, (line.rstrip() for line in said.splitlines() if not line.startswith("models")))) <= 80


@pytest.mark.slow
def test_the_bare_command_shows_the_modulus_and_refuses_what_it_does_not_know(palpate: Palpate) -> None:
    bare, named = (palpate("accuracy", *front, "--sample", "1", "--json").object for front in ((), ("front",)))
    assert bare["front"] == named["front"]
    assert "numerics" in palpate("accuracy", "--help").out
    assert "No such command 'dwel'" in palpate("accuracy", "dwel").err


# --- What each method that integrates in time costs, with its failures left in ------------------------


@pytest.fixture(scope="module")
def integrated() -> list[IntegratorError]:
    """Each method once, on a short record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(integrators, "DURATION", 1.0)
        patch.setattr(integrators, "REPEATED", 0.0)
        patch.setattr(integrators, "TOLERANCES", {"Radau": (1e-3,), "LSODA": (1e-6, 1e-9)})
        return list(compare())


def test_the_chain_is_as_stiff_and_as_large_as_is_said() -> None:
    rates = np.abs(np.linalg.eigvals(chain().a))
    assert (len(rates), rates.max() / rates.min()) == (STATES, pytest.approx(STIFFNESS, rel=1e-9))


def test_exact_methods_are_exact_and_the_others_as_good_as_their_order_says(integrated: list[IntegratorError]) -> None:
    rows: dict[str, list[IntegratorError]] = {}
    for row in integrated:
        rows.setdefault(row.method, []).append(row)
    errors: dict[str, Any] = {method: [row.error for row in own] for method, own in rows.items()}
    assert errors["closed form"][0] < 1e-12
    assert errors["matrix exponential, blocks"][0] < 1e-9
    for method in ("first-order hold", "trapezoid"):  # second order: a step ten times finer is a hundred times better
        assert errors[method][1] / errors[method][2] == pytest.approx(100, rel=0.05)
    assert errors["Radau"][0] < 1e-2
    assert errors["LSODA"][1] < errors["LSODA"][0] < 1e-4
    fails, holds = rows["explicit Euler"]  # 2.1 and 1.9 us: a microsecond is followed up to a step of two
    assert (fails.error, fails.failure) == (None, "diverges")
    assert holds.error is not None and holds.error < 1e-2
