"""What the house may never have, but for circles, which CI counts; and the counting.

Its private functions are tested by themselves, as the whole house has none of what they look for.
"""

from __future__ import annotations

import ast

import pytest

from tests import house


def test_there_is_no_exemption_and_no_any_in_commands() -> None:
    assert house.exemptions() == []
    assert house.any_in_commands() == []


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
