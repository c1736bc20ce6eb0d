"""Faults that are typed while a bench is served: given, listed, and taken away again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.errors import BenchError, ConfigError, LinkError, PalpateError, UsageError
from palpate.procedures.virtual.served_bench import Person
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import with_faults
from palpate.simulators.scenes.scene import Scene
from tests.conftest import hasty


@pytest.fixture
def bench(sim: SimulatedBench) -> Any:
    """A client that is there already when a fault comes, and does not wait long."""
    with Bench(hasty(sim.description), sim.clock, sim.operator) as opened:
        yield opened


def answer(person: Person, typed: str) -> str:
    found = person.do(typed)
    assert found is not None
    return found


def read_generator(bench: Bench) -> object:
    return bench.device("signal_generator").read()


def read_indicator(bench: Bench) -> object:
    bench.clock.wait(0.5)
    return bench.device("strain_indicator").read().sick


def record(bench: Bench) -> object:
    found = bench.device("sensor_node_1").acquire(0.05)
    return bool(found.saturated.any())


def amplifier_has_latched(bench: Bench) -> object:
    latched = bench.device("shaker_amplifier").read().faults_latched
    bench.device("shaker_amplifier").clear_faults()
    return set(latched)


MET: dict[str, tuple[Callable[[Bench], object], object]] = {
    "signal_generator device_busy": (read_generator, BenchError),
    "signal_generator connection_refused": (read_generator, LinkError),
    "signal_generator wrong_count": (read_generator, BenchError),
    "positioner silence": (lambda bench: bench.device("positioner").position(), LinkError),
    "line two_replies": (lambda bench: bench.device("positioner").position(), 0.0),
    "can lost_frame": (lambda bench: bench.device("sensor_node_1").get("serial"), LinkError),
    "shaker_amplifier over_temperature": (amplifier_has_latched, {"over_temperature"}),
    "strain_indicator bridge_open": (read_indicator, "bridge open"),
    "sensor_node_1 saturated_film channel=1": (record, True),
}


MORE = {"front_panel": " setting=frequency value=5"}
WAITED = {"positioner silence", "can lost_frame"}  # for an answer that never comes


@pytest.mark.parametrize(
    "typed", [pytest.param(typed, marks=[pytest.mark.slow] if typed in WAITED else []) for typed in MET]
)
def test_a_fault_begins_as_it_is_typed_and_ends_as_it_is_cleared(sim: SimulatedBench, bench: Bench, typed: str) -> None:
    person, (look, expected) = Person(sim), MET[typed]
    on, kind, *_ = typed.split()
    bench.device("sensor_node_1").set_sample_rate(1000.0)
    before = look(bench)
    sim.clock.wait(1.0)
    assert person.do(f"fault {typed}") is None
    if isinstance(expected, type):
        with pytest.raises(expected):
            look(bench)
    else:
        assert look(bench) == expected
    assert answer(person, "faults").startswith(f"{on} {kind} ")
    assert answer(person, f"clear {on} {kind}").startswith(f"cleared: {on} {kind} ")
    assert person.do("faults") == "no fault is given"
    assert look(bench) == before


def test_every_fault_can_be_given_and_taken_away_by_hand(sim: SimulatedBench, bench: Bench) -> None:
    """Nobody asks anything meanwhile; what a device has lost with its power is written again."""
    person = Person(sim)
    sim.clock.wait(1.0)
    for kind in FAULTS:
        place = next(iter(struck(fault_class(kind).targets, places(1))))
        person.do(f"fault {place} {kind}{MORE.get(kind, '')}")
        sim.clock.wait(0.01)
        person.do("clear all")
    bench.device("shaker_amplifier").clear_faults()
    bench.recover()
    bench.check_settings()


def test_several_are_told_apart_and_cleared_by_place_or_all_at_once(scene: Scene, nothing_left_behind: None) -> None:
    """Those of the scene, too."""
    with SimulatedBench(with_faults(scene, [{"kind": "bridge_open", "on": "strain_indicator", "at": "1 s"}])) as sim:
        person = Person(sim)
        for typed in ("line bit_error probability=0.5", "positioner silence transaction=9", "can error_frame"):
            person.do(f"fault {typed}")
        assert answer(person, "faults").splitlines() == [
            "strain_indicator bridge_open at=1 s: has struck 0 times",
            "line bit_error probability=0.5: has struck 0 times",
            "positioner silence transaction=9: has struck 0 times",
            "can error_frame at=0 s lasts=until it is cleared: has struck 0 times",
        ]
        sim.clock.wait(2.0)
        assert answer(person, "clear strain_indicator").endswith("has struck once")
        assert "read" not in vars(sim.indicator)
        person.do("clear positioner")
        assert len(answer(person, "faults").splitlines()) == 2
        person.do("clear all")
        assert person.do("faults") == "no fault is given"


WRONG: list[tuple[str, type[PalpateError], str]] = [
    ("fault", UsageError, "needs a PLACE and a KIND"),
    ("fault shaker_amplifier", UsageError, "needs a PLACE and a KIND"),
    ("fault shaker_amplifier over_temp", ConfigError, "fault: unknown fault 'over_temp' (did you mean"),
    ("fault amplifier over_current", ConfigError, "unknown place of a over_current 'amplifier'"),
    ("fault sensor_node_9 emergency", ConfigError, "'sensor_node_9'"),
    ("fault line silence 2s", UsageError, "'2s' is no NAME=VALUE"),
    ("fault line silence kind=x", UsageError, "given twice"),
    ("fault line silence lasts=5", ConfigError, "lasts: 5 needs a unit"),
    ("fault line silence lasts='-1 s'", ConfigError, "lasts: "),
    ("fault line silence probability=2", ConfigError, "probability: "),
    ("fault line silence at=1s transaction=2", ConfigError, "exactly one says when"),
    ("fault line silence often=2", ConfigError, "often: unknown key"),
    ("fault positioner front_panel setting=colour value=1", ConfigError, "colour"),
    ("fault line 'silence", UsageError, "close the quotation"),
    ("fault strain_indicator zero_drift", ConfigError, "has bridge_open already; clear that first"),
    ("fault strain_indicator bridge_open", ConfigError, "has bridge_open already; clear that first"),
    ("fault sample_changer power_cycle", ConfigError, "this bench has no sample_changer"),
    ("clear", UsageError, "and perhaps a KIND, or all"),
    ("clear line silence", UsageError, "there is no such fault; there are: strain_indicator bridge_open"),
    ("clear a b c", UsageError, "and perhaps a KIND, or all"),
    ("faults all", UsageError, "takes no argument, not 1"),
]


def test_what_is_wrong_with_a_typed_fault_is_said_and_nothing_is_changed(sim: SimulatedBench) -> None:
    person = Person(sim)
    person.do("fault strain_indicator bridge_open")
    for typed, error, says in WRONG:
        with pytest.raises(error) as told:
            person.do(typed)
        assert says in str(told.value)
        assert len(sim.injection.given) == 1
