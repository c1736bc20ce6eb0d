"""The bench ends with its outputs off, on every way out."""

from __future__ import annotations

import os
import re
import signal
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices.exciter import Amplified
from palpate.drivers.safe_end import insist
from palpate.extend import DEVICE_FAILURE, Bench, Refused
from palpate.instrument.errors import BenchError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.benches import drive, driving, is_closed, off_the_main_thread, open_bench

ENDING = pytest.mark.parametrize(
    ("number", "raised"),
    [(signal.SIGTERM, SystemExit), (signal.SIGHUP, SystemExit), (signal.SIGINT, KeyboardInterrupt)],
)


pytestmark = pytest.mark.usefixtures("foreground")
REQUESTS = 100  # more than any that a signal can be late by


class Failure(Exception):
    """Nothing that palpate raises itself."""


@pytest.mark.parametrize("error", [Failure, KeyboardInterrupt])
def test_outputs_are_off_after_whatever_is_raised_inside(error: type[BaseException], sim: SimulatedBench) -> None:
    with pytest.raises(error), open_bench(sim) as bench:
        drive(bench)
        raise error
    assert not driving(sim)
    assert is_closed(bench)


@ENDING
def test_outputs_are_off_after_a_signal(
    number: signal.Signals, raised: type[BaseException], sim: SimulatedBench
) -> None:
    before = signal.getsignal(number)
    with pytest.raises(raised) as ended, open_bench(sim) as bench:
        drive(bench)
        os.kill(os.getpid(), number)
        bench.clock.wait(1.0)
    assert not driving(sim)
    assert signal.getsignal(number) == before
    if isinstance(ended.value, SystemExit):
        assert ended.value.code == 128 + number


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGTERM, SystemExit), (signal.SIGINT, KeyboardInterrupt)])
@pytest.mark.parametrize("name", ["shaker_amplifier", "signal_generator"])
def test_outputs_are_off_after_a_signal_in_the_middle_of_a_request(
    number: signal.Signals,
    raised: type[BaseException],
    name: str,
    sim: SimulatedBench,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulated = sim.devices[name]

    def kill() -> None:
        monkeypatch.undo()
        os.kill(os.getpid(), number)

    with pytest.raises(raised), open_bench(sim) as bench:
        drive(bench)
        monkeypatch.setattr(simulated, "requested", kill)
        for _ in range(REQUESTS):
            bench.device(name).get("probe")
    assert not driving(sim)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_that_the_program_was_started_to_ignore_ends_nothing(
    number: signal.Signals, sim: SimulatedBench
) -> None:
    """nohup does so, and a shell that starts a program in the background."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with open_bench(sim) as bench:
            drive(bench)
            os.kill(os.getpid(), number)
            bench.clock.wait(1.0)
            assert driving(sim)
            assert signal.getsignal(number) == signal.SIG_IGN
        assert not driving(sim)
        assert signal.getsignal(number) == signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_outputs_are_switched_off_does_not_stop_that(
    number: signal.Signals, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_bench(sim) as bench:
        drive(bench)
        monkeypatch.setattr(sim.amplifier, "requested", lambda: os.kill(os.getpid(), number))
    assert not driving(sim)


def test_a_bench_off_the_main_thread_ends_safe_too(sim: SimulatedBench) -> None:
    def use() -> None:
        with pytest.raises(Failure), open_bench(sim) as bench:
            drive(bench)
            raise Failure

    off_the_main_thread(use)
    assert not driving(sim)


def refuse(_: object) -> None:
    raise Refused(DEVICE_FAILURE)


def test_a_device_that_fails_during_shutdown_is_named_and_the_others_are_switched_off(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = open_bench(sim)
    with pytest.raises(BenchError, match=r"outputs could not all be switched off: .*shaker amplifier.*by eye"), bench:
        drive(bench)
        monkeypatch.setattr(sim.amplifier, "write", refuse)
    assert sim.amplifier.settings["enable"] == 0.0  # by its watchdog, while it was told again and again
    assert sim.generator.settings["output"] == sim.generator.settings["amplitude"] == 0.0
    assert is_closed(bench)


def test_a_failed_shutdown_is_noted_on_the_error_that_led_to_it(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Failure) as failure, open_bench(sim) as bench:
        drive(bench)
        monkeypatch.setattr(sim.generator, "write", refuse)
        raise Failure
    assert re.search("could not all be switched off: .*signal generator.*watchdog.*2 s", failure.value.__notes__[0])
    assert sim.amplifier.settings["enable"] == 0.0


def test_the_amplifier_is_off_though_the_generator_is_gone(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = open_bench(sim)
    with pytest.raises(BenchError, match=r"could not all be switched off: .*nothing answers at"), bench:
        drive(bench)
        bench.device("signal_generator").link.close()
        monkeypatch.setattr(bench.device("signal_generator").link.client, "connect", lambda: False)
    assert sim.amplifier.settings["enable"] == 0.0


def test_rest_switches_everything_off_and_stops_watching(bench: Bench, sim: SimulatedBench) -> None:
    drive(bench)
    bench.rest()
    assert not driving(sim)
    sim.clock.wait(10.0)
    bench.clock.wait(10.0)
    assert bench.device("shaker_amplifier").read().faults_latched == frozenset()


# --- the usual exciter ---------------------------------------------------------------------------------


class Told:
    """A device that keeps what it is told."""

    def __init__(self, who: str, told: list[Any], fails: bool = False, watched: bool = True) -> None:
        self.who, self.told, self.fails = who, told, fails
        self.contract = SimpleNamespace(has=lambda name: watched and name == "watchdog")
        self.current = 2.0

    def __getattr__(self, name: str) -> Any:
        def tell(*given: Any) -> Any:
            self.told.append((self.who, name, *given))
            if self.fails:
                raise ZeroDivisionError(f"{self.who} {name}")
            return self if name == "check" else 3.5

        return tell


QUIET = ("source", "sine", 10.0, 0.0)


@pytest.mark.parametrize(
    ("action", "told"),
    [
        ("drive", [QUIET, ("amplifier", "enable"), ("source", "output", True)]),
        ("rest", [QUIET, ("source", "output", False), ("amplifier", "disable")]),
        ("quiet", [("source", "output", False), QUIET]),
        ("halt", [("amplifier", "disable")]),  # the source is not open yet
    ],
)
def test_an_exciter_is_switched_on_and_off_at_no_amplitude(action: str, told: list[Any]) -> None:
    seen = list[Any]()
    getattr(Amplified(Told("source", seen), Told("amplifier", seen)), action)()
    assert seen == told


def test_an_exciter_is_switched_off_by_every_means_there_is_the_safest_first() -> None:
    for fails in (False, True):
        told = list[Any]()
        exciter = Amplified(Told("source", told, fails), Told("amplifier", told, fails))
        failures = insist(exciter.means(), VirtualClock())
        assert told == [("amplifier", "disable"), ("source", "output", False), QUIET]
        assert failures == (["amplifier disable", "source output", "source sine"] if fails else [])
