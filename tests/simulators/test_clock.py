"""Virtual time: integer nanoseconds, events in order, and no trace of how a wait was cut."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from palpate.simulators.clock import NEVER, VirtualClock

SECOND = 1_000_000_000
DAY = 86_400 * SECOND


class Metronome:
    """Ticks at every multiple of its period, and writes down what it lives through."""

    def __init__(self, clock: VirtualClock, name: str, period_ns: int, log: list[tuple[str, int]]) -> None:
        self.name, self.period_ns, self.log = name, period_ns, log
        self.clock = clock
        self.stretches: list[tuple[int, int]] = []
        clock.add(self)

    def next_event_ns(self) -> int:
        return (self.clock.now_ns() // self.period_ns + 1) * self.period_ns if self.period_ns else NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        assert self.clock.now_ns() == end_ns
        self.stretches.append((start_ns, end_ns))
        if self.period_ns and end_ns % self.period_ns == 0:
            self.log.append((self.name, end_ns))


def life(pieces: list[float]) -> tuple[list[tuple[str, int]], int]:
    clock, log = VirtualClock(), []  # type: ignore[var-annotated]
    for name, period in (("slow", 70_000_000), ("fast", 30_000_000), ("idle", 0)):
        Metronome(clock, name, period, log)
    for piece in pieces:
        clock.wait(piece)
    return log, clock.now_ns()


@pytest.mark.parametrize(
    "pieces", [[0.5, 0.5], [0.001] * 1000, [0.21, 0.0, 0.79], [0.3333, 0.3333, 0.3334], [1e-9, 0.999999999]]
)
def test_a_wait_cut_into_pieces_gives_the_same_events_and_the_same_end(pieces: list[float]) -> None:
    assert life(pieces) == life([1.0])


def test_events_come_in_order_and_those_of_one_moment_in_the_order_of_adding() -> None:
    log, now = life([1.0])
    assert now == SECOND
    assert [t for _, t in log] == sorted(t for _, t in log)
    assert len(log) == 1000 // 70 + 1000 // 30
    assert [name for name, t in log if t == 210_000_000] == ["slow", "fast"]


def test_all_live_through_every_moment_once() -> None:
    clock = VirtualClock()
    idle = Metronome(clock, "idle", 0, [])
    Metronome(clock, "fast", 30_000_000, [])
    for piece in (0.1, 0.05, 0.0, 0.25):
        clock.wait(piece)
    starts, ends = zip(*idle.stretches, strict=True)
    assert (starts[0], ends[-1]) == (0, 400_000_000)
    assert starts[1:] == ends[:-1]
    assert all(start < end for start, end in idle.stretches)


def test_an_empty_clock_waits_too() -> None:
    clock = VirtualClock()
    clock.wait(1.5)
    assert clock.now_ns() == 1_500_000_000


@pytest.mark.parametrize(("duration", "expected"), [(1.001, 1_001_000_000), (0.6e-9, 1), (0.4e-9, 0), (0.0, 0)])
def test_a_wait_is_rounded_to_the_nearest_nanosecond(duration: float, expected: int) -> None:
    clock = VirtualClock()
    clock.wait(duration)
    assert clock.now_ns() == expected


def test_ten_thousand_short_waits_are_one_long_one() -> None:
    clock, summed = VirtualClock(), 0.0
    for _ in range(10_000):
        clock.wait(1e-4)
        summed += 1e-4
    assert clock.now_ns() == SECOND
    assert summed != 1.0


@pytest.mark.parametrize("duration", [-1e-9, -1.0, float("nan"), float("inf"), -float("inf")])
def test_a_negative_or_not_finite_wait_is_refused_and_time_stands(duration: float) -> None:
    clock = VirtualClock()
    clock.wait(1.0)
    with pytest.raises(ValueError, match=rf"cannot wait {duration} s; a wait is finite and not negative"):
        clock.wait(duration)
    assert clock.now_ns() == SECOND


def test_the_scene_moves_on_under_the_lock_only() -> None:
    clock, entered = VirtualClock(), []

    class Watcher(Metronome):
        def advance(self, start_ns: int, end_ns: int) -> None:
            other = threading.Thread(target=lambda: entered.append(clock.lock.acquire(blocking=False)))
            other.start()
            other.join()

    Watcher(clock, "watcher", 0, [])
    clock.wait(1.0)
    assert entered == [False]


def test_with_a_pace_waits_take_the_time_of_the_wall_and_make_up_for_what_computing_took(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The wall's clock is played: computing takes 2 s of it in the middle."""
    wall = [100.0]
    played = SimpleNamespace(monotonic=lambda: wall[0], sleep=lambda seconds: wall.append(wall.pop() + seconds))
    monkeypatch.setattr("palpate.simulators.clock.time", played)
    clock = VirtualClock()
    clock.wait(10.0)
    assert wall == [100.0]
    clock.pace = 2.0
    clock.wait(3.0)
    assert wall == pytest.approx([101.5])
    wall[0] += 2.0
    clock.wait(1.0)
    assert wall == pytest.approx([103.5])
    clock.wait(6.0)
    assert wall == pytest.approx([105.0])
