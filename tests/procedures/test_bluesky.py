"""Devices of the bench in a scan of bluesky's own engine, which takes its time to import."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from palpate import RangeError, get_design, get_sample
from palpate.extend import Bench, Films, LoadServo, Scene, press
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.procedures.bluesky import DeviceSetting, FilmSignals, MovableLoad
from palpate.simulators.bench import SimulatedBench

if TYPE_CHECKING:
    from bluesky import RunEngine

LOADS = (2.0, 4.0)
FREQUENCY, DWELL = 10.0, 0.5


@pytest.fixture
def engine(nothing_left_behind: None) -> Iterator[RunEngine]:
    from bluesky import RunEngine

    found = RunEngine(context_managers=[])  # no handler of Ctrl-C
    yield found
    found._loop.call_soon_threadsafe(found._loop.stop)
    found._th.join()
    found._loop.close()


def pressed(bench: Bench) -> tuple[Films, LoadServo]:
    """Films and servo with sample 1 under the probe."""
    films = Films(bench, get_design("single"), FREQUENCY, 4.0)
    preloaded = press(bench, THESIS_LOAD_CELL, get_sample("1"), 3.0)
    return films, LoadServo(bench, THESIS_LOAD_CELL, FREQUENCY, preloaded)


@pytest.mark.slow
def test_a_scan_of_the_engine_gives_the_numbers_of_the_procedures_own_calls(engine: RunEngine, scene: Scene) -> None:
    from bluesky.plans import scan

    own: list[list[float]] = []
    events: list[dict[str, Any]] = []
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        films, servo = pressed(bench)
        for load in LOADS:
            servo.set(load)
            own.append(list(2 * films.fit(films.acquire(DWELL)).amplitude))
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        films, servo = pressed(bench)
        plan = scan([FilmSignals(films, DWELL)], MovableLoad(bench, servo), *LOADS, len(LOADS))
        engine(plan, lambda name, document: events.append({name: document}))
    assert [name for event in events for name in event] == ["start", "descriptor", "event", "event", "stop"]
    found = [event["event"]["data"] for event in events if "event" in event]
    assert [[data["films_rigid"], data["films_total"]] for data in found] == own
    assert [data["load"] for data in found] == pytest.approx(LOADS, rel=0.03)
    keys = events[1]["descriptor"]["data_keys"]
    assert {name: key["units"] for name, key in keys.items()} == {"films_rigid": "V", "films_total": "V", "load": "N"}


def test_an_error_of_the_bench_ends_the_plan(engine: RunEngine, bench: Bench) -> None:
    from bluesky.plan_stubs import mv

    frequency = DeviceSetting(bench, bench.device("signal_generator"), "frequency")
    engine(mv(frequency, 12.5))
    assert frequency.read()["signal_generator_frequency"]["value"] == 12.5
    with pytest.raises(RangeError, match="frequency"):
        engine(mv(frequency, -1.0))
