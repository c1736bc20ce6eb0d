"""What the house may never have, but for circles, which CI counts; and the counting."""

from __future__ import annotations

import ast

import pytest
import pytest_timeout

from tests import house
from tests.conftest import SLOW


def test_there_is_no_exemption_and_no_any_in_commands() -> None:
    assert house.exemptions() == []
    assert house.any_in_commands() == []


def test_a_circle_is_found_through_others_and_by_the_strictest_count() -> None:
    imports = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": set(), "f": {"g"}, "g": {"f"}}
    assert house.circles_of(imports) == ["a, b, c", "f, g"]
    assert house.circles_of({"a": {"b"}, "b": set()}) == []


@pytest.mark.parametrize(
    ("module", "package", "child"), [("a.b.c", "a", "a.b"), ("a.b", "a", "a.b"), ("a", "a", ""), ("ab.c", "a", "")]
)
def test_a_module_belongs_to_the_child_of_a_package_that_it_lies_in(module: str, package: str, child: str) -> None:
    assert house.child(module, package) == child


def test_any_is_counted_in_arguments_and_results_alone() -> None:
    text = "x: Any = 1\ndef f(a: dict[str, Any], *, b: int = 0, **c: Any) -> Any:\n    d: Any = a\n"
    assert house.anys(ast.parse(text)) == 3


def test_a_name_with_an_underscore_is_reached_where_it_is_not_of_the_files_own() -> None:
    own = "class Own:\n    def _b(self):\n        self._a = self._b()\n        os._exit(self._a)"
    reaching = "from x import _c\nx._d = y._e\npatch.setattr(x, '_f', 1)\npatch.setattr('x.y._g', 1)\nx.__name__"
    assert house.reaches(ast.parse(own)) == set()
    assert house.reaches(ast.parse(reaching)) == {"_c", "_d", "_e", "_f", "x.y._g"}


# --- no test can hang for ever -----------------------------------------------------------------------


def test_each_test_has_a_time_out_and_a_slow_one_a_longer(request: pytest.FixtureRequest) -> None:
    for item in request.session.items:
        seconds = pytest_timeout._get_item_settings(item).timeout
        least = SLOW if item.get_closest_marker("slow") else 60
        assert seconds is not None and seconds >= least, item.nodeid
