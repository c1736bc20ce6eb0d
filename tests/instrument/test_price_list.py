"""The cheapest model that meets a tolerance, on a list made up for it; `test_stored_prices.py` has the real one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from palpate.instrument import shipped
from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.models import price_list
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, SolidParameters
from palpate.instrument.models.price_list import (
    AUTO_TOLERANCE,
    Machine,
    Price,
    PriceList,
    ReferenceRatios,
    answers_cheapest,
    choose,
    fingerprint,
    stored,
)
from palpate.instrument.models.response import response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Load

Values = tuple[float | None, ...]
ROUND = get_design("single_round")
LOAD = PHYSICAL.load(50e3)
MODULI = (1e4, 1e5, 1e6, 1e9)


def price(
    model: str, errors: Values, seconds: float | None, estimates: Values = (None, None, None), refinement: str = "3"
) -> Price:
    return Price(
        design=ROUND.name, model=model, refinement=refinement, errors=errors, estimates=estimates,
        build_s=None, solve_s=None, evaluate_s=seconds, answer_s=seconds,
    )  # fmt: skip


LIST = PriceList(
    machine=Machine(cpu="abacus", cores=1, system="", python="", date=""),
    moduli_Pa=MODULI,
    references=(
        ReferenceRatios(
            design=ROUND.name, fingerprint=fingerprint(ROUND, LOAD), force_ratios=(1.0,) * 4, uncertainties=(0.0,) * 4,
            how="made up", seconds=0.0,
        ),
    ),
    prices=(
        price("column", (0.05, 0.08, 0.02), 1e-6),
        price("column_fitted", (0.03, None, None), 2e-6),
        price("beam", (0.001, 0.001, 0.001), None),  # nobody gets it
        price("surface", (1e-5, 1e-5, 1e-6), 5e-6, estimates=(4e-4, 4e-4, 4e-4)),
        price("axisymmetric", (1e-4, 2e-4, 1e-5), 0.5, estimates=(1e-3, 2e-3, 1e-4), refinement="2"),
        price("axisymmetric", (1e-6, 2e-6, 1e-7), 2.0, estimates=(1e-5, 2e-5, 1e-6), refinement="4"),
    ),
)  # fmt: skip


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(price_list, "stored", lambda: LIST)


# --- the choice ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "low, high, tolerance, model, error, seconds",
    [
        (2e4, 9e4, 0.1, "column", 0.05, 1e-6),
        (2e4, 9e4, 0.05, "column", 0.05, 1e-6),  # meets it exactly
        (2e4, 9e4, 0.049, "column_fitted", 0.03, 2e-6),
        (2e4, 9e4, 0.02, "surface", 4e-4, 5e-6),  # the beam is nearer, but not to be had
        (2e4, 9e4, 3e-4, "axisymmetric", 1e-5, 2.0),  # by its own estimate refinement 2 does not promise it
        (2e6, 1e9, 3e-4, "axisymmetric", 1e-4, 0.5),  # there it does
    ],
)
def test_the_cheapest_that_promises_the_tolerance_is_chosen(
    low: float, high: float, tolerance: float, model: str, error: float, seconds: float
) -> None:
    choice = LIST.choose(ROUND.name, low, high, tolerance)
    assert (choice.model, choice.error, choice.seconds) == (model, error, seconds)


@pytest.mark.parametrize(
    "low, high, error",
    [
        (2e4, 9e4, 0.05),
        (1e4, 1e5, 0.05),  # no interval is touched that the range only ends at
        (9e4, 2e5, 0.08),
        (1e5, 1e6, 0.08),
        (2e6, 3e6, 0.02),
        (5e4, 1e8, 0.08),
        (1e4, 1e4, 0.05),
        (1e9, 1e9, 0.02),
    ],
)
def test_the_error_is_the_greatest_of_the_intervals_that_the_range_touches(
    low: float, high: float, error: float
) -> None:
    assert LIST.choose(ROUND.name, low, high, 0.1).error == error


def test_a_tolerance_is_relative_to_the_smallest_ratio_of_each_interval() -> None:
    """What the column is off by is 0.05 of 0.1, 0.08 of 0.2, and 0.02 of 0.5."""
    ratios = replace(LIST.references[0], force_ratios=(0.1, 0.2, 0.5, 1.0))
    relative = replace(LIST, references=(ratios,), prices=LIST.prices[:1])
    for low, high, error in ((2e4, 9e4, 0.5), (2e5, 9e5, 0.4), (2e6, 9e6, 0.04), (2e4, 9e6, 0.5)):
        found = relative.choose(ROUND.name, low, high, 0.5)
        assert (found.error, found.bound) == pytest.approx((error, 0.02 if low > 1e6 else 0.08 if high > 1e5 else 0.05))
        with pytest.raises(RangeError, match="no model meets it"):
            relative.choose(ROUND.name, low, high, 0.99 * error)


def test_a_refusal_names_the_sensors_that_meet_the_tolerance() -> None:
    other = replace(LIST.references[0], design="other"), replace(LIST.prices[5], design="other", errors=(1e-9,) * 3)
    both = replace(
        LIST, references=(*LIST.references, other[0]), prices=(*LIST.prices, replace(other[1], estimates=(None,) * 3))
    )
    with pytest.raises(RangeError, match=r"give --tolerance 0.0011%, or --design other; palpate accuracy numerics"):
        both.choose(ROUND.name, 2e4, 9e4, 1e-6)


def test_a_model_that_does_not_answer_everywhere_is_not_chosen_where_it_does_not() -> None:
    assert LIST.choose(ROUND.name, 2e4, 9e4, 0.04).model == "column_fitted"
    assert LIST.choose(ROUND.name, 2e4, 2e5, 0.04).model == "surface"


def test_the_reason_names_model_refinement_error_time_and_range() -> None:
    why = LIST.choose(ROUND.name, 2e4, 9e4, 0.02).why
    for part in ("surface (3)", "± 0.04 %", "5 µs", "cheapest of 2", "0.02", "'single_round'", "20 kPa", "90 kPa"):
        assert part in why
    assert "\n" not in why
    assert LIST.choose(ROUND.name, 2e4, 2e4, 0.02).why.endswith("and a modulus of 20 kPa")


def test_a_tolerance_that_no_model_meets_is_refused_with_the_best_there_is() -> None:
    with pytest.raises(
        RangeError, match=r"1e-06: no model .*the best is 'axisymmetric', ± 0.001 % .*its mesh.*0.0011%"
    ) as raised:
        LIST.choose(ROUND.name, 2e4, 9e4, 1e-6)
    assert "20 kPa to 90 kPa" in str(raised.value)


@pytest.mark.parametrize("low, high", [(9e3, 1e5), (1e5, 2e9)])
def test_prices_say_nothing_outside_their_moduli(low: float, high: float) -> None:
    with pytest.raises(RangeError, match="no price was measured"):
        LIST.choose(ROUND.name, low, high, 0.1)


# --- what the list vouches for -------------------------------------------------------------------------

OBJECT = LOAD.sensed
OTHERS = {
    "thickness": replace(LOAD, sensed=replace(OBJECT, thickness=2e-3)),
    "Poisson ratio": replace(LOAD, sensed=replace(OBJECT, poisson=0.4)),
    "interface": replace(LOAD, interface="frictionless"),
    "a softer one": PHYSICAL.load(9.9e3),
    "a harder one": PHYSICAL.load(1.1e9),
}


@pytest.mark.parametrize("load", [LOAD, replace(LOAD, force=3.0), PHYSICAL.load(1e4), PHYSICAL.load(1e9)])
def test_the_list_vouches_for_what_was_measured_whatever_the_force(load: Load) -> None:
    assert LIST.vouches(ROUND, [load])


@pytest.mark.parametrize("other", OTHERS)
def test_for_another_object_the_model_with_an_own_estimate_is_taken(other: str, made_up: None) -> None:
    assert not LIST.vouches(ROUND, [LOAD, OTHERS[other]])
    choice = choose(ROUND, [LOAD, OTHERS[other]], 0.1)
    shipped = other in ("a softer one", "a harder one")  # there are curves of this sensor, for any modulus
    assert (choice.model, choice.error, choice.seconds) == ("surface" if shipped else "axisymmetric", None, None)
    assert "no prices were measured" in choice.why and "0.1" in choice.why


def stiffer_plate(design: Design) -> Design:
    plate = replace(design.plate, material=replace(design.plate.material, modulus=3e9))
    return replace(design, plate=plate)


@pytest.mark.parametrize(
    "design, load, model",
    [
        (stiffer_plate(ROUND), LOAD, "axisymmetric"),
        (replace(ROUND, ring=replace(ROUND.ring, height=4e-3)), LOAD, "surface"),  # only springs look at it
        (replace(ROUND, name="mine"), LOAD, "axisymmetric"),
        (get_design("single"), LOAD, "surface"),
        (stiffer_plate(get_design("single")), LOAD, "solid"),
        (stiffer_plate(get_design("array")), LOAD, "solid"),
        (ROUND, replace(LOAD, at=(5e-3, 5e-3)), "solid"),
    ],
)
def test_for_another_sensor_or_a_point_load_too(design: Design, load: Load, model: str, made_up: None) -> None:
    assert choose(design, [load], 0.1).model == model


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, float("nan"), float("inf")])
def test_a_tolerance_that_is_none_is_refused(tolerance: float) -> None:
    with pytest.raises(RangeError, match=r"tolerance .* (is not above 0|above the 50 %)"):
        choose(ROUND, [LOAD], tolerance)


# --- the answer ----------------------------------------------------------------------------------------


def test_the_answer_is_the_chosen_models_and_its_estimate_no_better_than_the_price(made_up: None) -> None:
    given = response(ROUND, LOAD, "auto", 0.06)
    own = response(ROUND, LOAD, "column")
    assert (given.model, given.force_ratio) == ("column", own.force_ratio)
    assert given.error_estimate == 0.05
    assert "cheapest" in given.why and own.why == ""


def test_an_estimate_of_the_models_own_counts_where_it_is_larger(
    made_up: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    coarse = axisymmetric.solve(RoundParameters(support="rigid"), 1)
    asked = []

    def solve_at(moduli: object, tolerance: float) -> list[tuple[object, float]]:
        asked.append(tolerance)
        return [(coarse, 1.7e-4)]

    monkeypatch.setattr(axisymmetric, "ladder", lambda _: SimpleNamespace(solve_at=solve_at))
    (given,) = answers_cheapest(ROUND, [LOAD], 2e-4)
    assert (given.model, asked) == ("axisymmetric", [2e-4])
    assert given.error_estimate == pytest.approx(1.7e-4 / coarse.force_ratio)


def test_without_a_tolerance_the_default_is_asked(made_up: None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def solve_at(moduli: object, tolerance: float) -> list[tuple[object, float]]:
        asked.append(tolerance)
        return [(solid.solve(SolidParameters(support="rigid", interface="frictionless"), 0), 1e-3)]

    monkeypatch.setattr(solid, "ladder", lambda _: SimpleNamespace(solve_at=solve_at))
    (given,) = answers_cheapest(stiffer_plate(get_design("single")), [LOAD], None)
    assert asked == [AUTO_TOLERANCE] == [2e-2]
    assert given.model == "solid" and given.error_estimate == pytest.approx(1e-3 / given.force_ratio)


# --- its file ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content", ["", "{}", '{"machine": 3}', shipped.text(LIST).replace('"format": 2', '"format": 1')]
)
def test_a_damaged_list_is_refused_with_the_remedy(
    content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "prices.json"
    path.write_text(content)
    monkeypatch.setattr(price_list, "STORED", path)
    with pytest.raises(
        ConfigError, match=r"prices\.json: is missing or no price list.*palpate accuracy numerics --store"
    ):
        stored.__wrapped__()


def test_prices_of_another_machine_are_told_with_their_age() -> None:
    here = Machine(cpu="abacus", cores=1, system="table", python="3.11", date="2026-03-01")
    earlier = replace(here, date="2026-01-30")
    assert earlier.provenance(here) == "measured on abacus, 1 cores, table, Python 3.11, 2026-01-30"
    other = replace(earlier, cpu="slide rule")
    assert other.provenance(here) == (
        "measured on slide rule, 1 cores, table, Python 3.11, 2026-01-30, 30 days ago;"
        " this is another machine: abacus, 1 cores, table, Python 3.11"
    )
