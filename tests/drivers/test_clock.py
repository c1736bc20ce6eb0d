"""Every wait goes through the bench's clock, which feeds the amplifier's watchdog while the bench drives."""

from __future__ import annotations

import math

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.instrument.errors import SafetyError
from palpate.simulators.bench import SimulatedBench


def drive(bench: Bench) -> None:
    bench.drive()
    bench.device("signal_generator").sine(10.0, 1.0)


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
