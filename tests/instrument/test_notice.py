"""The price of a long computation is told before it begins."""

from __future__ import annotations

import pytest

from palpate.instrument.notice import notices_to, price


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (2.0, []),
        (2.1, ["solving takes about 2 s; kept"]),
        (9.7, ["solving takes about 10 s; kept"]),
        (14.2, ["solving takes about 14 s; kept"]),
        (47.0, ["solving takes about 50 s; kept"]),
        (600.0, ["solving takes about 10 min; kept"]),
        (9000.0, ["solving takes about 2.5 h; kept"]),
    ],
)
def test_what_takes_more_than_two_seconds_is_told_with_its_price(seconds: float, said: list[str]) -> None:
    heard: list[str] = []
    with notices_to(heard.append):
        price("solving", seconds, "; kept")
    price("solving", seconds, "; kept")  # nobody listens
    assert heard == said
