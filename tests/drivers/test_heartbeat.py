"""The heartbeat of a program: when it beats, and when it ends."""

from __future__ import annotations

import pytest

from palpate.drivers.devices.canopen_device import Heartbeat


def test_a_heartbeat_beats_at_its_interval_until_it_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    said, intervals = list[str](), list[float]()
    heartbeat = Heartbeat(lambda: said.append("alive"), 0.5)

    def wait(interval: float) -> bool:
        intervals.append(interval)
        return len(intervals) > 3

    monkeypatch.setattr(heartbeat._end, "wait", wait)
    with heartbeat:
        heartbeat._thread.join()
    assert (said, intervals) == (["alive"] * 3, [0.5] * 4)
    assert heartbeat._end.is_set()
    assert heartbeat._thread.daemon  # a program that ends does not wait for it
    assert heartbeat._thread.name == "heartbeat"  # in lists of threads
