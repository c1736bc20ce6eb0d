"""palpate accuracy: one page of what everything costs, and the arithmetic on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.models.price_list import stored
from palpate.procedures.accuracy import arithmetic, page
from palpate.procedures.accuracy.arithmetic import ArithmeticPrice
from palpate.procedures.accuracy.page import MethodPoint, cheapest
from palpate.procedures.virtual import waveforms as dwell
from palpate.simulators.linear import integrators
from tests.procedures.conftest import Palpate


@pytest.fixture(autouse=True)
def records_are_short_and_times_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arithmetic, "seconds_of", lambda call: 1e-3)
    monkeypatch.setattr(arithmetic, "STEPS", 200_000)
    monkeypatch.setattr(dwell, "RECORD", 40.0)
    monkeypatch.setattr(integrators, "DURATION", 0.1)
    monkeypatch.setattr(integrators, "TOLERANCES", {})


@pytest.fixture(scope="module")
def prices() -> dict[str, ArithmeticPrice]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arithmetic, "seconds_of", lambda call: 1e-3)
        return {price.way: price for price in arithmetic.measure()}


def test_single_precision_loses_a_late_record_and_centred_qr_does_not(prices: dict[str, ArithmeticPrice]) -> None:
    exact, double, single = (
        prices[way].error
        for way in ("float64, centred QR", "float64, normal equations", "float32, normal equations")
    )  # fmt: skip
    assert exact < 1e-11 < double * 10 and double < 1e-8
    assert single > 1e-3


def test_an_integer_phase_is_exact_and_sums_are_not(prices: dict[str, ArithmeticPrice]) -> None:
    assert prices["integer of 48 bits"].error == 0.0
    assert 1e-8 < prices["float64 sum"].error < 1e-4
    assert prices["float32 sum"].error > 0.1


def test_registers_cost_what_their_steps_say_and_noise_helps(prices: dict[str, ArithmeticPrice]) -> None:
    """Half a step of 153 µV on 1.24 mV is 6 %, of 15 µV 0.6 %: the fit sees a good part of it, noise averages it."""
    wide, fine = prices["int16 of 5 V, quiet"].error, prices["int16 of 500 mV, quiet"].error
    assert 5e-3 < wide < 0.06 and 5e-4 < fine < 6e-3
    assert prices["int16 of 500 mV, in noise"].error < fine / 3
    assert prices["float32, quiet"].error < 1e-7
    assert prices["display of 1 mV"].error == pytest.approx(0.5 / 30.9, rel=0.1)


def test_the_cheapest_way_within_the_tolerance_is_recommended() -> None:
    ways = [
        MethodPoint("slow", "", 1e-6, 9.0),
        MethodPoint("fast", "", 1e-2, 1.0),
        MethodPoint("as fast", "", 1e-3, 1.0),
        MethodPoint("broken", "", None, 0.1),
    ]
    assert cheapest(ways, 0.1).name == "as fast"
    assert cheapest(ways, 1e-4).name == "slow"
    none = cheapest(ways, 1e-9)
    assert none.name is None and "off by 1e-06" in none.why
    assert cheapest([ways[3]], 0.1).why == "none answers"


def test_models_are_recommended_as_callers_get_them() -> None:
    part = page.of_models(stored(), "single")
    best = [each for each in part.recommended if each.name is not None]
    assert best and all(each.error is not None and each.error <= each.tolerance for each in best)
    offered = {price.answer_s for price in stored().prices if price.design == "single"}
    assert {each.seconds for each in best} <= offered
    assert {"column", "solid"} <= {way.name for way in part.ways}
    assert all(way.seconds in offered for way in part.ways)


def test_the_page_joins_all_five(palpate: Palpate, tmp_path: Path) -> None:
    said = palpate("accuracy", "--json", "--out", str(tmp_path / "new")).object
    names = [part["name"] for part in said["parts"]]
    assert names[:4] == [page.MODULUS, page.DWELL, page.MODELS, page.INTEGRATORS]
    assert all(name.startswith(page.ARITHMETIC) for name in names[4:]) and len(names) == 8
    for part in said["parts"]:
        assert set(part) == {"name", "error_of", "time", "ways", "recommended", "floor", "floor_of", "note"}
        if part["name"] != page.MODULUS:
            assert [each["tolerance"] for each in part["recommended"]] == [0.1, 0.01, 1e-3, 1e-4]
    dwell = said["parts"][1]
    assert dwell["floor"] == pytest.approx(0.041, abs=1e-3)
    assert {each["name"] for each in dwell["recommended"]} == {page.MEAN}
    for part in said["parts"]:  # what the table recommends is among what the picture draws
        drawn = {(way["name"], way["setting"], way["error"], way["seconds"]) for way in part["ways"]}
        told = [(each["name"], each["setting"], each["error"], each["seconds"]) for each in part["recommended"]]
        assert part["name"] == page.MODULUS or {each for each in told if each[0] is not None} <= drawn
    assert Path(said["plot"]).exists()


def test_people_get_one_table_and_the_help_names_the_parts(palpate: Palpate) -> None:
    said = palpate("accuracy").out
    assert "mean of load sets" in said and "integer of 48 bits" in said
    assert "absolute: no bench time gets below" in said
    helped = palpate("accuracy", "--help").out
    for name in ("dwell", "models", "integrators"):
        assert name in helped


def test_options_before_a_command_are_not_lost_in_silence(palpate: Palpate) -> None:
    said = palpate("accuracy", "--json", "dwell")
    assert said.status == 2 and "give the options of 'dwell' after it" in said.err
