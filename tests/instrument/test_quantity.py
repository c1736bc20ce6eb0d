"""Text with units at the edge."""

from __future__ import annotations

import copy
import json
import math

import pint
import pytest

from palpate.instrument.errors import QuantityError
from palpate.instrument.quantity import Typed, as_typed, parse, plus_minus, show, show_with_u


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("3 N", "N", 3.0),
        ("24 kPa", "Pa", 24_000.0),
        ("10 Hz", "Hz", 10.0),
        ("140 gf", "N", 0.140 * 9.80665),
        ("3 mm", "m", 0.003),
        ("1e-3 s", "s", 0.001),
        ("-2.5N", "N", -2.5),
        ("0.5", "", 0.5),
    ],
)
def test_text_becomes_an_SI_value(text: str, unit: str, value: float) -> None:
    assert parse(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize("written", ["N", "m", "V/√Hz", "N s/m", "g", "bit/s"])
def test_a_prefix_means_what_pint_makes_of_it_to_the_last_digit(written: str) -> None:
    unit, registry = written.replace("g", "kg"), pint.get_application_registry()
    spelled, its = (each.replace("√Hz", "Hz**0.5") for each in (written, unit))
    for value in (0.3, 7.1, 12345.678):
        for prefix in "pnµmkMG":
            by_pint = registry.Quantity(value, f"{prefix}{spelled}").to(its).magnitude
            assert parse(f"{value} {prefix}{written}", unit) == by_pint


@pytest.mark.parametrize(("text", "unit"), [("3 mkg", "kg"), ("3 m", ""), ("3 k", "")])
def test_neither_a_kilogram_nor_a_plain_number_takes_a_prefix(text: str, unit: str) -> None:
    with pytest.raises(QuantityError):
        parse(text, unit)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("24 kPa", "in kPa where N belongs"),
        ("3", "has no unit where N belongs"),
        ("three N", "is not a quantity"),
        ("", "is not a quantity"),
        ("nan N", "is not a quantity"),
        ("1e999 N", "is not finite"),
        ("3 bananas", "'bananas' is no unit"),
        ("3 xN", "'xN' is no unit"),
        ("3 mm", "in mm where N belongs"),
        ("1 N,", "is not a quantity"),
        ("__import__('os').getcwd()", "is not a quantity"),
        ("9**9**9**9 N", "is not a quantity"),  # would be computed for ever
        ("1 N**99999999", "is not a quantity"),
    ],
)
def test_what_is_no_force_is_refused_with_the_text_and_an_example(text: str, says: str) -> None:
    with pytest.raises(QuantityError, match=says):
        parse(text, "N")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (24_000.0, "Pa", "24 kPa"),
        (0.0969, "N", "96.9 mN"),
        (1234.5, "N", "1234 N"),
        (12_000.0, "Hz", "12 kHz"),
        (0.0, "V", "0 V"),
        (3e-6, "m", "3 µm"),
        (-0.002, "V", "-2 mV"),
        (0.0301, "mV/N", "0.0301 mV/N"),
        (-0.0055, "1/K", "-0.0055 1/K"),
        (0.265, "dB", "0.265 dB"),
        (0.0107, "N/K", "10.7 mN/K"),
    ],
)
def test_a_value_is_shown_with_a_prefix(value: float, unit: str, text: str) -> None:
    assert show(value, unit) == text


def test_hundreds_are_shown_without_an_exponent() -> None:
    assert [show(u, "V/N", 2) for u in (1.43e-4, 9.96e-4, 1.43e-5)] == ["140 µV/N", "1000 µV/N", "14 µV/N"]


@pytest.mark.parametrize(
    ("value", "u", "unit", "texts"),
    [
        (1.7768e-3, 1.4e-4, "V/N", ("1.78 mV/N", "0.14 mV/N")),
        (112.43e3, 3.04e3, "Pa", ("112.4 kPa", "3.0 kPa")),
        (3.0052e-3, 15.1e-6, "m", ("3.005 mm", "0.015 mm")),
        (269.81e-6, 10.96e-6, "N", ("270 µN", "11 µN")),
        (-1e-6, 2e-3, "N", ("0.0 mN", "2.0 mN")),
        (10.3009, 0.0210, "mV/N", ("10.301 mV/N", "0.021 mV/N")),
        (-0.005510, 0.0038, "1/K", ("-0.0055 1/K", "0.0038 1/K")),
        (0.002179, 0.003, "", ("0.0022", "0.0030")),
        (56.3, 0.123, "dB", ("56.30 dB", "0.12 dB")),
        (1e-12, 1e-13, "", ("1e-12", "1e-13")),
        (1e10, 3e8, "", ("1e+10", "3e+08")),
        (5.0, 0.0, "N", ("5 N", "0 N")),
        (4.25, math.inf, "N", ("4.25 N", "inf N")),
    ],
)
def test_a_value_and_its_uncertainty_share_prefix_and_last_digit(
    value: float, u: float, unit: str, texts: tuple[str, str]
) -> None:
    assert show_with_u(value, u, unit) == texts


def test_a_quantity_is_told_as_it_was_typed_unless_that_is_long() -> None:
    typed = Typed(7200.0, "2 h")
    assert (typed == 7200.0, as_typed(typed, "s"), as_typed(7200.0, "s")) == (True, "2 h", "7200 s")
    assert as_typed(copy.deepcopy(typed), "s") == "2 h"
    assert json.dumps(typed) == "7200.0"
    assert as_typed(Typed(0.1, "0.1" + 100 * "0" + " s"), "s") == "100 ms"


@pytest.mark.parametrize(
    ("half", "text"),
    [
        (0.0318, "± 3.2 %"),
        (0.2, "± 20 %"),
        (0.4055, "× 1.5"),  # e^0.4055
        (math.log(123), "× 123"),
        (0.0004, "± 0.04 %"),
    ],
)
def test_a_half_width_is_told_in_percent_and_above_a_fifth_as_a_factor(half: float, text: str) -> None:
    assert plus_minus(half) == text
