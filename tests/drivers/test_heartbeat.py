"""The heartbeat of a program: when it beats, and when it ends."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices import canopen_device
from palpate.drivers.devices.canopen_device import Heartbeat


def test_a_heartbeat_beats_at_its_interval_until_it_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    said, intervals = list[str](), list[float | None]()
    threads, ends = list[threading.Thread](), list[threading.Event]()

    class Waits(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            ends.append(self)
            intervals.append(timeout)
            return len(intervals) > 3

    def thread(**told: Any) -> threading.Thread:
        threads.append(threading.Thread(**told))
        return threads[0]

    monkeypatch.setattr(canopen_device, "threading", SimpleNamespace(Event=Waits, Thread=thread))
    with Heartbeat(lambda: said.append("alive"), 0.5):
        threads[0].join()
    assert (said, intervals) == (["alive"] * 3, [0.5] * 4)
    assert ends[0].is_set()
    assert threads[0].daemon  # a program that ends does not wait for it
    assert threads[0].name == "heartbeat"  # in lists of threads
