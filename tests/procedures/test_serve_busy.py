"""A program that computes for longer than the watchdog's time keeps the shaker of a bench that goes by the wall."""

from __future__ import annotations

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses
from palpate.simulators.scenes.scene import Scene

WATCHDOG = 1.0  # s


@pytest.mark.slow
def test_a_program_that_neither_waits_nor_asks_for_three_time_outs_does_not_trip_the_watchdog(scene: Scene) -> None:
    with serving(Wish(scene, BenchAddresses(), None, 1.0, None, (), None)) as served:
        description = served.description.model_copy(update={"watchdog": WATCHDOG})
        clock = served.sim.clock
        with Bench(description, WallClock(), served.sim.operator) as bench:
            bench.drive()
            end = clock.now_ns() + 3e9 * WATCHDOG
            while clock.now_ns() < end:  # it computes
                pass
            bench.clock.wait(0.0)
            assert served.sim.amplifier.settings["enable"]
