"""No test can hang for ever."""

from __future__ import annotations

import pytest
import pytest_timeout

from tests.conftest import SLOW


def test_each_test_has_a_time_out_and_a_slow_one_a_longer(request: pytest.FixtureRequest) -> None:
    for item in request.session.items:
        seconds = pytest_timeout._get_item_settings(item).timeout
        least = SLOW if item.get_closest_marker("slow") else 60
        assert seconds is not None and seconds >= least, item.nodeid
