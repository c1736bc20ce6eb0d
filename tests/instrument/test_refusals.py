"""What is wrong with a value of a file is told in palpate's words: the value, what is allowed, and what to do."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, Field, ValidationError

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.role_maps import ROLE_MAPS
from palpate.instrument.config import Config, check
from palpate.instrument.errors import ConfigError
from palpate.instrument.quantity import Seconds

BENCH: dict[str, Any] = {
    "name": "makers",
    "link": {
        "can": {"kind": "canopen", "interface": "socketcan", "channel": "can9"},
        "line": {"kind": "modbus-rtu", "port": "/dev/ttyUSB9"},
    },
    "device": {
        "load_cell": {"kind": "flintec-dad-141", "link": "line", "unit": 1, "inventory": "LAB-1", "span": 10.306},
        "films": {"kind": "canopennode-io", "link": "can", "node": 3, "set_to_link": True},
    },
}


class Everything(Config):
    number: Annotated[float, Field(gt=0, lt=9, strict=True)] = 1.0
    whole: Annotated[int, Field(ge=2, le=8, strict=True)] = 2
    yes: Annotated[bool, Field(strict=True)] = True
    text: Annotated[str, Field(min_length=2, max_length=3)] = "ab"
    name: Annotated[str, Field(min_length=1, pattern="^[a-z]*$")] = "a"
    words: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)] = ("a",)
    one: Literal["fast", "slow"] = "fast"
    time: Annotated[Seconds, Field(ge=1e-3, le=60)] | None = None
    table: dict[str, int] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("number", "x" * 300, f"'{'x' * 199}... is no number; give one without quotes"),
        ("number", float("nan"), "nan is not finite; give a number"),
        ("number", 0.0, "0.0 is too small; give more than 0"),
        ("number", 9.0, "9.0 is too large; give less than 9"),
        ("whole", 1.5, "1.5 is no whole number; give one without quotes"),
        ("whole", 1, "1 is too small; give at least 2"),
        ("whole", 300, "300 is too large; give at most 8"),
        ("yes", 1, "1 is neither true nor false; give one of them without quotes"),
        ("text", 5, "5 is no text; put it in quotes"),
        ("text", "a", "'a' is too short; give at least 2 characters"),
        ("text", "abcd", "'abcd' is too long; give at most 3 characters"),
        ("name", "", "'' is empty; give a text"),
        ("name", "A", "'A' does not have the form ^[a-z]*$"),
        ("words", "ab", "'ab' is no list; put its values in square brackets"),
        ("words", [], "[] has too few values; give at least 1 value"),
        ("words", ["a", "b", "c"], "['a', 'b', 'c'] has too many values; give at most 2 values"),
        ("one", "fas", "'fas' is not known (did you mean 'fast'?); valid: 'fast' or 'slow'"),
        ("time", "70 s", "'70 s' is too large; give at most 60 s"),
        ("time", "1 µs", "'1 µs' is too small; give at least 1 ms"),
        ("table", 3, "3 is no table; give its keys, each with its value"),
    ],
)
def test_a_wrong_value_is_told_with_what_is_allowed(key: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        check({key: value}, Everything, "lab.toml")
    assert str(refused.value) == f"lab.toml: {key}: {message}"


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        (("device", "load_cell"), "unit", 300, "device.load_cell: unit: 300 is too large; give at most 255"),
        (("device", "films"), "node", 128, "device.films: node: 128 is too large; give at most 127"),
        (("device", "films"), "inventry", "A", "unknown key (did you mean 'inventory'?); valid: confirmed, inventory,"),
        (("device", "load_cell"), "span", 1e-300, "1e-300 is too small; give at least 1e-06: the mV of the load cell"),
        (("link", "line"), "parity", "X", "link.line: parity: 'X' is not known; valid: 'N', 'E' or 'O'"),
    ],
)
def test_a_bench_of_makers_devices_is_refused_so(place: tuple[str, str], key: str, value: object, message: str) -> None:
    section, name = place
    tables = BENCH[section]
    told = {**BENCH, section: {**tables, name: {**tables[name], key: value}}}
    with pytest.raises(ConfigError) as refused:
        check(told, BenchDescription, "lab.toml")
    assert message in str(refused.value)


def numbers() -> list[tuple[type[BaseModel], str]]:
    settings = [each.settings for each in ROLE_MAPS.values() if each.settings is not None]
    return [(kind, name) for kind in settings for name, info in kind.model_fields.items() if info.annotation is not int]


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_no_number_of_a_devices_section_is_without_both_limits(size: float) -> None:
    """A share of 1e-300 divides the effort to infinity, and steps of 1e300 of a display hide every load."""
    for settings, name in numbers():
        for value in (size, *(f"{size:g} {unit}" for unit in ("m", "Hz"))):
            with pytest.raises(ValidationError) as refused:
                settings.model_validate({name: value})
            assert any(error["loc"] == (name,) for error in refused.value.errors())
