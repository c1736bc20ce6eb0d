"""What the house may not become: what is counted without grimp, and the counting; CI counts the circles."""

from __future__ import annotations

import ast

import pytest

from tests import house


def test_the_house_is_as_it_is_listed() -> None:
    listed, found = house.known(), house.numbers()
    told = list(house.complaints({name: listed[name] for name in found}, found))
    assert told == [], "python -m tests.house --accept lists it; take it only where it became less"


def test_a_circle_is_found_through_others_and_by_the_strictest_count() -> None:
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": set(), "f": {"g"}, "g": {"f"}}
    assert house._circles(imports) == ["a, b, c", "f, g"]
    assert house._circles({"a": {"b"}, "b": set()}) == []


@pytest.mark.parametrize(
    ("module", "package", "child"), [("a.b.c", "a", "a.b"), ("a.b", "a", "a.b"), ("a", "a", ""), ("ab.c", "a", "")]
)
def test_a_module_belongs_to_the_child_of_a_package_that_it_lies_in(module: str, package: str, child: str) -> None:
    assert house._child(module, package) == child


def test_any_is_counted_in_arguments_and_results_alone() -> None:
    text = "x: Any = 1\ndef f(a: dict[str, Any], *, b: int = 0, **c: Any) -> Any:\n    d: Any = a\n"
    assert house._anys(ast.parse(text)) == 3


def test_what_is_more_and_what_is_gone_but_still_listed_fail_both() -> None:
    listed = {"exemptions": 3, "of_modules": ["a, b"]}
    assert list(house.complaints(listed, {"exemptions": 3, "of_modules": ["a, b"]})) == []
    assert list(house.complaints(listed, {"exemptions": 2, "of_modules": ["c, d"]})) == [
        "exemptions: 2, 3 are listed",
        "of_modules: new: c, d",
        "of_modules: gone, still listed: a, b",
    ]
