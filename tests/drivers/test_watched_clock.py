"""Every wait goes through the bench's clock, and what drives is fed and looked at, whatever the program does."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.drivers.devices import canopen_device
from palpate.drivers.devices.canopen_device import Heartbeat
from palpate.instrument.bench.description import PATIENCE
from palpate.instrument.errors import BenchInUse, DeviceError, LinkTimeout, SafetyError
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import drive


def test_requests_that_take_longer_than_the_watchdog_s_time_in_all_do_not_trip_it(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a slow serial line they do."""
    drive(bench)
    monkeypatch.setattr(sim.indicator, "requested", lambda: sim.clock.wait(0.4))
    for _ in range(20):
        bench.device("strain_indicator").get("gage_factor")
    assert sim.amplifier.settings["enable"]


def test_a_heartbeat_speaks_for_who_drives_and_no_longer_than_he_is_heard_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that computes, or waits for a processor, keeps its shaker; one that hangs loses it."""
    said: list[None] = []
    heartbeat = Heartbeat(lambda: said.append(None), 1.0)
    monkeypatch.setattr("time.monotonic", lambda: 100.0)
    heartbeat.turn(1e9)
    assert len(said) == 1  # nothing is driven
    heartbeat.expect(5.0)
    heartbeat.turn(105.0 + PATIENCE)
    assert len(said) == 2
    heartbeat.turn(105.1 + PATIENCE)
    assert len(said) == 2
    heartbeat.expect(math.inf)
    heartbeat.turn(1e9)
    assert len(said) == 3


@pytest.mark.parametrize(
    ("error", "kept"), [(LinkTimeout("late"), False), (BenchInUse("taken"), True), (ZeroDivisionError("defect"), True)]
)
def test_what_a_heartbeat_meets_is_told_once_but_for_links_that_come_back(error: Exception, kept: bool) -> None:
    def fail() -> None:
        raise error

    heartbeat = Heartbeat(fail, 1.0)
    heartbeat.turn(0.0)
    assert heartbeat.failure() is (error if kept else None)
    assert heartbeat.failure() is None


class GoesOn:
    """The bench's clock as that of a wall, which a test moves on itself."""

    goes_on = True
    stepper = None

    def __init__(self, sim: SimulatedBench) -> None:
        self.now_ns, self.wait = sim.clock.now_ns, sim.clock.wait


@pytest.fixture
def beat(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Lets a heartbeat's thread take its turn and returns when it has; the time of the wall plays no part."""
    turn, turned = threading.Semaphore(0), threading.Semaphore(0)

    class Turns(threading.Event):
        """Instead of the interval, a turn is waited for."""

        begun = False

        def wait(self, timeout: float | None = None) -> bool:
            if self.begun:
                turned.release()
            self.begun = True
            turn.acquire()
            return self.is_set()

        def set(self) -> None:
            super().set()
            turn.release()

    monkeypatch.setattr(canopen_device, "threading", SimpleNamespace(Event=Turns, Thread=threading.Thread))
    monkeypatch.setattr(canopen_device, "time", SimpleNamespace(monotonic=lambda: 0.0))

    def beat() -> None:
        turn.release()
        turned.acquire()

    return beat


def test_a_bench_whose_time_goes_on_is_fed_while_the_program_does_something_else(
    sim: SimulatedBench, beat: Callable[[], None]
) -> None:
    with Bench(sim.description, GoesOn(sim), sim.operator) as bench:
        drive(bench)
        for _ in range(5):
            sim.clock.wait(1.5)  # nobody waits: a plot is drawn
            beat()
        assert sim.amplifier.settings["enable"]
        with pytest.raises(SafetyError, match="tripped on watchdog"):
            bench.clock.wait(2.0)  # the heartbeat has stopped


def test_a_wait_ends_when_the_heartbeat_finds_another_owner(sim: SimulatedBench, beat: Callable[[], None]) -> None:
    with Bench(sim.description, GoesOn(sim), sim.operator) as bench:
        drive(bench)
        sim.amplifier.reset()  # switched off and on again
        beat()
        with pytest.raises(DeviceError, match="does not know this program any more"):
            bench.clock.wait(0.1)


# --- when a heartbeat beats ----------------------------------------------------------------------------


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


# --- waits ---------------------------------------------------------------------------------------------


def test_a_dead_cable_drops_the_output_by_the_watchdog(bench: Bench, sim: SimulatedBench) -> None:
    drive(bench)
    sim.clock.wait(2.0)  # the bench's clock would feed it
    assert sim.amplifier.settings["enable"] == 0.0
    with pytest.raises(SafetyError, match=r"tripped on watchdog; the output is off.*Ctrl-Z.*next run clears"):
        bench.clock.wait(0.1)


def test_a_trip_ends_a_wait_within_half_the_watchdog(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=0.5, watchdog=2.0)
    bench.drive()
    bench.device("signal_generator").sine(10.0, 1.0)
    before = sim.clock.now_ns()
    with pytest.raises(SafetyError, match=r"shaker amplifier .* tripped on over_current.*clear the faults"):
        bench.clock.wait(10.0)
    assert sim.clock.now_ns() - before == 1_000_000_000
    assert not sim.amplifier.settings["enable"]


def test_a_wait_that_is_no_time_is_refused_at_once(bench: Bench) -> None:
    for duration in (math.nan, math.inf, -1.0):
        with pytest.raises(ValueError, match="a wait is finite and not negative"):
            bench.clock.wait(duration)


def test_a_wall_clock_counts_from_its_start_and_takes_waits_that_are_over() -> None:
    clock = WallClock()
    clock.wait(0.0)
    clock.wait(-1e-9)
    first = clock.now_ns()
    assert 0 <= first <= clock.now_ns()
