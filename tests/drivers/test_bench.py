"""The bench opens with what the bench file says or not at all, and notices a device that holds something else later."""

from __future__ import annotations

import math
import os
import re
import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from pymodbus.pdu import ModbusPDU

from palpate.drivers.clock import WallClock
from palpate.drivers.devices import canopen_device
from palpate.drivers.devices.canopen_device import Heartbeat
from palpate.drivers.devices.exciter import Amplified
from palpate.drivers.incident import Incidents
from palpate.drivers.safe_end import insist
from palpate.extend import DEVICE_FAILURE, Bench, Identity, Refused
from palpate.instrument.bench.description import PATIENCE
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    IdentityError,
    LinkTimeout,
    SafetyError,
    SettingsLost,
)
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.benches import drive, driving, is_closed, open_bench

# --- opening -------------------------------------------------------------------------------------------


def test_an_opened_bench_has_its_outputs_off_and_its_watchdog_set(sim: SimulatedBench) -> None:
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    with open_bench(sim):
        assert not driving(sim)
        assert sim.amplifier.settings["watchdog"] == sim.description.watchdog == 2.0


@pytest.mark.parametrize("name", ["shaker_amplifier", "positioner"])
def test_another_device_at_an_address_is_refused_and_not_written_to_and_the_rest_closed_again(
    name: str, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated, written = sim.devices[name], list[Any]()
    monkeypatch.setattr(simulated, "write", written.append)
    stranger = replace(simulated.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(simulated, "contract", stranger)
    bench = open_bench(sim)
    with pytest.raises(IdentityError, match=f"{stranger.title} at .*Acme XY-9 1.0"):
        bench.__enter__()
    assert is_closed(bench) and written == []
    monkeypatch.undo()
    with bench:
        assert bench.simulated


def test_a_bench_whose_opening_fails_leaves_the_outputs_off_and_gives_its_amplifier_up(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bench that was left driving must not go on because one device of it cannot be opened."""
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    sim.nodes[0].settings["product"] = 7.0
    bench = open_bench(sim)
    with pytest.raises(IdentityError):
        bench.__enter__()
    assert not driving(sim)
    assert (bench.is_open, sim.amplifier.read("token")) == (False, 0)  # so that no other program waits for the watchdog


def test_an_amplifier_that_tripped_is_refused_with_its_fault(sim: SimulatedBench) -> None:
    sim.amplifier.trip("over_current")
    with pytest.raises(SafetyError, match=r"shaker amplifier .* tripped on over_current"):
        open_bench(sim).__enter__()


# --- simulated or not ----------------------------------------------------------------------------------


def test_devices_that_do_not_call_themselves_simulated_are_taken_for_real(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def real(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and hasattr(pdu, "information"):
            del pdu.information[6]
        return pdu

    assert all(device.simulated for device in bench.devices)
    for device in bench.devices[:4]:
        monkeypatch.setattr(device.link.client.transaction, "trace_pdu", real)
        device.connect()
        assert not device.simulated
    assert bench.simulated
    read = sim.nodes[0].read
    monkeypatch.setattr(sim.nodes[0], "read", lambda f: "1.0" if f.name == "hardware_version" else read(f))
    bench.device("sensor_node_1").connect()
    assert not bench.simulated


def test_mounting_a_sample_needs_the_probe_at_home(bench: Bench) -> None:
    bench.operator.mount(SAMPLES["2"])
    bench.device("positioner").move(5e-3)
    with pytest.raises(BenchError, match="stands at 5 mm: move it home"):
        bench.operator.mount(SAMPLES["3"])


# --- a bench ---------------------------------------------------------------------------------------------


def test_an_opened_bench_holds_what_its_file_says(bench: Bench, sim: SimulatedBench) -> None:
    said = {device.name: device.settings for device in bench.description.devices}
    assert sim.amplifier.settings["gain"] == said["shaker_amplifier"].gain
    assert sim.amplifier.settings["current_limit"] == said["shaker_amplifier"].current_limit
    assert sim.indicator.settings["gage_factor"] == said["strain_indicator"].gage_factor
    assert sim.indicator.settings["full_scale"] == 1e3 * said["strain_indicator"].full_scale
    sim.amplifier.settings["enable"] = 0.0
    sim.generator.settings["amplitude"] = 3.0
    bench.drive()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)
    bench.rest()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)


def test_a_bench_whose_load_cell_reads_nothing_does_not_go_on(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = {"status": 4.0, "reading_float": math.nan, "reading": 0.0}
    read = sim.indicator.read
    monkeypatch.setattr(sim.indicator, "read", lambda name: opened[name] if name in opened else read(name))
    with pytest.raises(DeviceError, match="bridge open; check the bridge and its wires") as caught:
        bench.recover()
    assert caught.value.device == bench.device("strain_indicator").name


def test_what_was_lost_and_written_again_is_told_to_the_record(bench: Bench, sim: SimulatedBench) -> None:
    told = list[str]()
    bench.attend(lambda _kind, what, _ns: told.append(what))
    sim.amplifier.settings["gain"] = 7.0
    with pytest.raises(
        SettingsLost, match=f"{re.escape(bench.device('shaker_amplifier').name)}: gain is 7, was set to .*; look at"
    ):
        bench.check_settings()
    bench.recover()
    assert [what for what in told if what.startswith(f"{bench.device('shaker_amplifier').name}: gain is 7")] != []
    assert all(what.endswith("; written again") for what in told if "was set to" in what)
    bench.check_settings()


def test_error_frames_of_the_bus_are_told_and_nothing_that_comes_after_a_bench_is_closed(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted, errors = list[str](), iter((0, 3))
    with open_bench(sim) as bench:
        bench.attend(lambda _kind, what, _ns: noted.append(what))
        link = bench.device("sensor_node_1").link
        monkeypatch.setattr(link, "error_frames", lambda: next(errors))
        for _ in range(2):
            bench.check_settings()
    bench.incidents.note("too late")
    assert noted == [f"{link.name}: 3 error frames"]


@pytest.mark.parametrize("safe", [True, False])
def test_an_amplifier_is_given_up_only_when_all_outputs_are_off(
    safe: bool, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If an output cannot be switched off, the watchdog must do it, for which the owner must fall silent."""
    bench = open_bench(sim)
    bench.__enter__()
    drive(bench)
    released = list[bool]()
    release = bench.device("shaker_amplifier").release
    monkeypatch.setattr(bench.device("shaker_amplifier"), "release", lambda: released.append(True) or release())
    if safe:
        bench.__exit__(None, None, None)
    else:
        monkeypatch.setattr(bench.device("signal_generator"), "output", lambda _on: _fails())
        with pytest.raises(BenchError, match="could not all be switched off: it is stuck"):
            bench.__exit__(None, None, None)
    assert released == ([True] if safe else [])


def _fails() -> None:
    raise DeviceError("it is stuck")


# --- incidents -----------------------------------------------------------------------------------------


def test_incidents_are_stored_with_their_time_also_those_from_before_the_record() -> None:
    clock, stored = VirtualClock(), list[tuple[str, str, int]]()
    incidents, begun = Incidents(clock), clock.now_ns()
    incidents.note("first")
    clock.wait(1.0)
    incidents.note("second")
    incidents.tell(lambda *event: stored.append(event))
    clock.wait(1.0)
    incidents.note("third")
    assert stored == [
        ("incident", "first", begun),
        ("incident", "second", begun + 1_000_000_000),
        ("incident", "third", begun + 2_000_000_000),
    ]


# --- what a device gives -------------------------------------------------------------------------------


MODBUS = [
    ("strain_indicator", "mode", 9.0, r"mode = 9 is no choice; valid: track \(0\), peak_to_peak \(1\)"),
    ("strain_indicator", "decimals", 400.0, "decimals = 400 is outside 0 to 9"),
    ("strain_indicator", "command_result", 77.0, r"command_result = 77 is no choice; valid: none \(0\)"),
    ("shaker_amplifier", "temperature", 3200.0, "temperature = 3200 degC is outside -40 to 150 degC"),
    ("positioner", "limit_high", -1.0, "limit_high = -1 m is outside 0 to 0.025 m"),
    ("signal_generator", "frequency", 30_000.0, "frequency = 30000 Hz is outside 0 to 20000 Hz"),
]
CANOPEN = [
    ("range_1", 9.0, r"range_1 = 9 is no choice; valid: 5 V \(0\), 500 mV \(1\)"),
    ("heartbeat", 65.0, "heartbeat = 65 s is outside 0 to 60 s"),
    ("sync_period", 11.0, "sync_period = 11 s is outside 0.0001 to 10 s"),
    ("emergency_cob_id", 1.0, "emergency_cob_id = 2 is outside 129 to "),
]


def test_a_modbus_value_outside_its_contract_is_refused_with_device_field_value_limit_and_remedy(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for device, field, value, message in MODBUS:
        driver, simulated = bench.device(device), sim.devices[device]
        with monkeypatch.context() as patch:
            read = simulated.read
            patch.setattr(simulated, "read", lambda name, f=field, v=value, r=read: v if name == f else r(name))
            with pytest.raises(
                DeviceError, match=f"^{driver.name}: reads {message}.*; not used. Set it within"
            ) as seen:
                driver.get(field)
        assert seen.value.device == driver.name


def test_an_object_outside_its_contract_is_refused_where_the_node_is_opened(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for field, value, message in CANOPEN:
        with monkeypatch.context() as patch:
            patch.setitem(sim.can.nodes[0].settings, field, value)
            with pytest.raises(DeviceError, match=f"^sensor node 1 at .*: reads {message}"):
                bench.device("sensor_node_1").connect()


def test_a_fault_bit_that_the_contract_does_not_name_is_a_fault(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    amplifier: Any = sim.amplifier
    read = amplifier.read
    monkeypatch.setattr(amplifier, "read", lambda name: 512.0 if name == "faults_latched" else read(name))
    assert bench.device("shaker_amplifier").read().faults_latched == {"bit 9"}


# --- the end: outputs are off on every way out -------------------------------------------------------

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

    thread = threading.Thread(target=use)  # what it raises fails the test
    thread.start()
    thread.join()
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


# --- waits, and what is fed meanwhile ----------------------------------------------------------------


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
def beat(monkeypatch: pytest.MonkeyPatch) -> Callable[[], float | None]:
    """Lets a heartbeat's thread take its turn and returns when it has, with the interval that it waits for.

    The time of the wall plays no part.
    """
    turn, turned = threading.Semaphore(0), threading.Semaphore(0)
    intervals = list[float | None]()

    class Turns(threading.Event):
        """Instead of the interval, a turn is waited for."""

        begun = False

        def wait(self, timeout: float | None = None) -> bool:
            intervals.append(timeout)
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

    def beat() -> float | None:
        turn.release()
        turned.acquire()
        return intervals[-1]

    return beat


def test_a_bench_whose_time_goes_on_is_fed_at_an_interval_while_the_program_does_something_else(
    sim: SimulatedBench, beat: Callable[[], float | None]
) -> None:
    with Bench(sim.description, GoesOn(sim), sim.operator) as bench:
        drive(bench)
        for _ in range(5):
            sim.clock.wait(1.5)  # nobody waits: a plot is drawn
            assert beat() == sim.description.watchdog / 4
        assert sim.amplifier.settings["enable"]
        (thread,) = (each for each in threading.enumerate() if each.name == "heartbeat")
        assert thread.daemon  # a program that ends does not wait for it
        with pytest.raises(SafetyError, match="tripped on watchdog"):
            bench.clock.wait(2.0)  # the heartbeat has stopped


def test_a_wait_ends_when_the_heartbeat_finds_another_owner(
    sim: SimulatedBench, beat: Callable[[], float | None]
) -> None:
    with Bench(sim.description, GoesOn(sim), sim.operator) as bench:
        drive(bench)
        sim.amplifier.reset()  # switched off and on again
        beat()
        with pytest.raises(DeviceError, match="does not know this program any more"):
            bench.clock.wait(0.1)


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
