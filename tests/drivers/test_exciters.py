"""What shakes: an amplifier, which goes off on heat, silence or too much current; a generator; a drive with a list."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from random import Random
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import numpy.typing as npt
import pytest

from palpate.drivers.devices.exciter import FEWEST, Exciter, SetPointGrid, ShakerAmplifier, SignalGenerator, grid
from palpate.drivers.links.can import CanLink, Cyclic
from palpate.drivers.ownership import CLAIMS, claim
from palpate.drivers.safe_end import insist
from palpate.extend import Bench, BenchDescription, ModbusDevice, Refused, SimulatedDevice
from palpate.instrument.bench.kinds import AmplifierSettings
from palpate.instrument.contracts.declaration import MOST_CYCLIC
from palpate.instrument.contracts.own import SETTINGS, SHAKER_AMPLIFIER
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    LinkError,
    LinkTimeout,
    RangeError,
    SafetyError,
    SettingsLost,
)
from palpate.procedures.testing.wire import listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.exciter import SimulatedShakerAmplifier, SimulatedSignalGenerator
from palpate.simulators.linear.periodic import Periodic
from palpate.simulators.planning.settle import read_scene
from palpate.testing import ModbusConformance
from tests.conftest import latched
from tests.drivers.benches import altered, drive, open_bench
from tests.drivers.fake_links import Registers
from tests.shares import first_of

COIL = 3.5  # ohm


class TestShakerAmplifier(ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("shaker_amplifier"), sim.amplifier


def test_the_amplifier_measures_what_it_gives(bench: Bench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0)
    drive(bench, 3.0)
    state = bench.device("shaker_amplifier").read()
    assert state.voltage == pytest.approx(6 / math.sqrt(2), abs=0.005)
    assert state.current == pytest.approx(6 / math.sqrt(2) / COIL, abs=0.0005)
    assert (state.enabled, state.faults, state.faults_latched) == (True, frozenset(), frozenset())
    bench.device("shaker_amplifier").disable()
    state = bench.device("shaker_amplifier").read()
    assert (state.enabled, state.voltage, state.current) == (False, 0.0, 0.0)


def test_the_watchdog_drops_the_output_at_its_time_out_and_latches(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0.5)
    drive(bench, 1.0)
    bench.device("shaker_amplifier").feed()
    sim.clock.wait(0.499_999_999)
    assert (latched(sim), sim.amplifier.settings["enable"]) == (set(), 1)
    sim.clock.wait(0.000_000_001)
    assert (latched(sim), sim.amplifier.settings["enable"]) == ({"watchdog"}, 0)
    assert sim.rig.coil_voltage().at(np.array([sim.clock.now_ns() + 25_000_000])).tolist() == [0.0]
    assert bench.device("shaker_amplifier").read().faults_latched == {"watchdog"}
    with pytest.raises(DeviceError, match="answered exception 4, device failure, to enable = on"):
        bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").clear_faults()
    bench.device("shaker_amplifier").enable()
    assert bench.device("shaker_amplifier").read().enabled


def test_every_way_to_too_much_current_trips_at_its_peak(bench: Bench) -> None:
    generator, amplifier = bench.device("signal_generator"), bench.device("shaker_amplifier")
    amplifier.configure(gain=2.0, current_limit=1.0, watchdog=0)
    drive(bench, 1.7499)
    assert (amplifier.read().enabled, amplifier.read().faults_latched) == (True, set())
    for device, much, less in (
        (generator, {"amplitude": 1.7501}, {"amplitude": 1.0}),  # at the peak
        (generator, {"offset": -1.0}, {"offset": 0.0}),
        (amplifier, {"gain": 4.0}, {"gain": 2.0}),
        (amplifier, {"current_limit": 0.5}, {}),
        (amplifier, {}, {"current_limit": 1.0}),  # to enable it is enough
    ):
        amplifier.enable()
        if much:
            device.set(**much)
        assert (amplifier.read().enabled, amplifier.read().faults_latched) == (False, {"over_current"})
        amplifier.clear_faults()
        if less:
            device.set(**less)
    amplifier.enable()
    assert amplifier.read().enabled


def test_over_temperature_trips_and_cannot_be_cleared_while_hot(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=6.0, watchdog=0)
    drive(bench, 8.0)
    rise = COIL * 2.0 * (16 / math.sqrt(2) / COIL) ** 2
    trip = 300.0 * math.log(rise / (rise - 65.0))
    sim.clock.wait(trip - 1e-3)
    assert latched(sim) == set()
    sim.clock.wait(2e-3)
    assert latched(sim) == {"over_temperature"}
    bench.device("shaker_amplifier").clear_faults()
    state = bench.device("shaker_amplifier").read()
    assert not state.enabled
    assert state.faults == state.faults_latched == {"over_temperature"}
    assert state.temperature == pytest.approx(90.0, abs=0.05)
    sim.clock.wait(300.0 * math.log(65 / 55) + 1.0)  # cooled to 80 degrees
    assert bench.device("shaker_amplifier").read().faults == set()
    with pytest.raises(DeviceError):
        bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").clear_faults()
    bench.device("shaker_amplifier").enable()


# --- the driver by itself ------------------------------------------------------------------------------


def alone(**held: Any) -> tuple[ShakerAmplifier, Any]:
    """A driver that owns an amplifier without a wire, whose registers hold these values."""
    link: Any = Registers(SHAKER_AMPLIFIER, ticket=0x0007_0001, **held)
    driver = ShakerAmplifier(link, 1, VirtualClock())
    assert driver.claim()
    link.asked.clear()
    return driver, link


def orders(link: Any) -> list[dict[str, int]]:
    """What was written behind token and counter, and the counter, in order."""
    return [
        {"counter": registers[3], **({"order": registers[4], "value": registers[5]} if registers[4:] else {})}
        for start, registers in link.writes()
        if start == SHAKER_AMPLIFIER["token"].address
    ]


@pytest.mark.parametrize(
    ("held", "limit", "safe"),
    [
        ({"temperature": 85.0}, 5.0, True),
        ({"temperature": 85.1}, 5.0, False),
        ({"output_current": 0.707}, 1.0, True),  # 0.99985 A peak
        ({"output_current": 0.708}, 1.0, False),
        ({"output_current": 1.414}, 2.0, True),
        ({"output_current": 60.0}, None, True),  # nobody has said what it may give
    ],
)
def test_outputs_go_off_before_the_amplifier_trips_on_heat_or_on_its_peak_current(
    held: dict[str, float], limit: float | None, safe: bool
) -> None:
    driver, _ = alone(**held)
    if limit:
        driver.set(current_limit=limit)
    if safe:
        assert driver.check() == driver.read()
        return
    with pytest.raises(
        SafetyError, match=rf"heat sink at .* degC, .* A peak; limits are 85 degC and {limit:g} A\. Out"
    ):
        driver.check()


def test_who_owns_it_already_feeds_it_by_a_claim_and_takes_a_new_ticket_when_he_is_forgotten() -> None:
    driver, link = alone()
    assert driver.claim()
    assert [asked[0] for asked in link.asked] == ["write_registers"]
    link.asked.clear()
    for code in (3, 6):  # it was switched off, or somebody else has claimed it
        link.failures = [refused(code)]
        link.put(ticket=0x0009_0000 + code)
        assert driver.claim()
        assert link.held("token") == 0x0009_0000 + code
    link.failures = [refused(6), None, refused(6)]
    assert not driver.claim()
    link.asked.clear()
    driver.feed()
    assert [asked[0] for asked in link.asked] == ["read_registers"]  # as nobody's


def refused(code: int) -> DeviceError:
    return DeviceError(f"answered exception {code}", code=code)


def test_only_an_amplifier_without_the_register_of_the_owner_counts_as_one_without_owners() -> None:
    link: Any = Registers(SHAKER_AMPLIFIER)
    link.failures = [refused(4)]
    with pytest.raises(DeviceError, match="answered exception 4, to a read of ticket"):
        ShakerAmplifier(link, 1, VirtualClock()).claim()


@pytest.mark.parametrize(
    ("latched", "cleared", "trips"), [(0, False, False), (0b10000, True, False), (0b10001, False, True)]
)
def test_the_trip_that_every_killed_run_leaves_is_cleared_and_no_other(
    latched: int, cleared: bool, trips: bool
) -> None:
    driver, link = alone(faults_latched=latched)

    def clear() -> None:
        if link.words.get(SHAKER_AMPLIFIER["order"].address) == 0x13:
            link.put(faults_latched=0)

    link.written = clear
    settings = AmplifierSettings.model_validate({"gain": 4.0, "current_limit": "3 A"})
    if trips:
        with pytest.raises(SafetyError, match="tripped on over_current, watchdog"):
            driver.set_up(settings, 2.0)
    else:
        driver.set_up(settings, 2.0)
        values = [order["value"] for order in orders(link)]
        assert values == ([1] if cleared else []) + [400, 3000, 2000]


# --- who owns it ---------------------------------------------------------------------------------------


WATCHDOG = 2.0  # s
BUSY, ILLEGAL_VALUE = 6, 3


def test_a_setting_stands_where_its_order_says() -> None:
    assert {name: SHAKER_AMPLIFIER[name].address for name in SETTINGS} == SETTINGS


# --- a dead owner --------------------------------------------------------------------------------------


class Scene:
    """An amplifier alone, at whose wire owner and strangers are."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        sine = Periodic(0.0, 0, 0, 0, np.array([1]), np.array([1.0 + 0j]))
        self.device = SimulatedShakerAmplifier(self.clock, "SIM", lambda: sine, lambda: None, 3.5)

    def read(self, name: str) -> int:
        self.device.requested()
        return int(self.device.read(name))

    def write(self, **values: float) -> int:
        """Exception code of the answer, 0 for none."""
        self.device.requested()
        try:
            self.device.write(values)
        except Refused as refused:
            return refused.code
        return 0


STRANGERS: dict[str, Callable[[Scene, int], int]] = {
    "reads": lambda scene, _: scene.read("status") and BUSY,
    "claims": lambda scene, _: scene.write(token=scene.read("ticket"), counter=1),
    "says again what the owner said": lambda scene, token: scene.write(token=token, counter=1),
    "enables as the owner did": lambda scene, token: scene.write(
        token=token, counter=2, order=SETTINGS["enable"], order_value=1
    ),
    "enables": lambda scene, _: scene.write(enable=1.0),
    "sets": lambda scene, _: scene.write(gain=20.0, current_limit=6.0),
    "stops the watchdog": lambda scene, _: scene.write(watchdog=0.0),
    "releases": lambda scene, _: scene.write(release=scene.read("ticket")),
    "counts": lambda scene, _: scene.write(counter=2.0**32 - 1),
}


@pytest.mark.parametrize("seed", range(12))
def test_the_output_drops_within_the_time_out_whenever_its_owner_dies_and_whoever_else_is_there(seed: int) -> None:
    """The owner lives for so many pauses, in ms; `tried` ms after his last sign of life the others try again."""
    draw = Random(seed)
    strangers = draw.choices(sorted(STRANGERS), k=draw.randint(1, 31))
    pauses = [draw.randint(1, 1999) for _ in range(draw.randint(0, 5))]
    tried = draw.choice([0, 1999, draw.randint(0, 1999)])
    scene = Scene()
    token = scene.read("ticket")

    def tries() -> None:
        for stranger in strangers:
            assert STRANGERS[stranger](scene, token) in (BUSY, ILLEGAL_VALUE), stranger
        assert scene.device.settings["enable"] == 1.0
        assert scene.device.settings["gain"] == SHAKER_AMPLIFIER["gain"].default

    own = partial(scene.write, token=token)
    assert own(counter=1) == 0
    assert own(counter=1, order=SETTINGS["watchdog"], order_value=1000 * WATCHDOG) == 0
    assert own(counter=2, order=SETTINGS["enable"], order_value=1) == 0
    for count, pause in enumerate(pauses, 2):
        tries()
        scene.clock.wait(1e-3 * pause)
        tries()
        assert own(counter=count) == 0
    scene.clock.wait(1e-3 * tried)
    tries()
    scene.clock.wait(WATCHDOG - 1e-3 * tried)
    assert scene.device.settings["enable"] == 0.0
    assert scene.write(token=scene.read("ticket"), counter=1) == 0  # and another may follow him


# --- who may write -------------------------------------------------------------------------------------


def test_while_it_is_owned_others_may_switch_it_off_and_nothing_else(bench: Bench, sim: SimulatedBench) -> None:
    drive(bench)
    stranger = open_bench(sim).device("shaker_amplifier")
    stranger.afterwards = bench.device("shaker_amplifier").feed  # its owner lives on while the stranger asks again
    stranger.link.open()
    try:
        for write in (
            stranger.enable,
            stranger.clear_faults,
            lambda: stranger.configure(20.0, 6.0, 60.0),
            lambda: stranger.set(watchdog=60.0),
            lambda: stranger.set(release=1),
        ):
            with pytest.raises(DeviceError, match="device busy"):
                write()
        assert sim.amplifier.settings["enable"]
        assert sim.amplifier.settings["gain"] == bench.named(bench.device("shaker_amplifier")).settings.gain
        stranger.disable()
    finally:
        stranger.link.close()
    assert sim.amplifier.settings["enable"] == 0.0


def test_to_release_an_amplifier_switches_it_off_and_then_it_is_anybody_s_and_any_request_feeds_it(
    bench: Bench, sim: SimulatedBench
) -> None:
    drive(bench)
    bench.device("shaker_amplifier").release()
    assert (sim.amplifier.settings["enable"], sim.amplifier.read("token")) == (0.0, 0)
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0.5)
    bench.device("shaker_amplifier").enable()
    for _ in range(5):
        sim.clock.wait(0.4)
        bench.device("shaker_amplifier").get("gain")
    bench.device("shaker_amplifier").set(watchdog=0)
    sim.clock.wait(1000.0)
    assert bench.device("shaker_amplifier").read().enabled


# --- two programs, on two machines ---------------------------------------------------------------------


@pytest.fixture
def elsewhere(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> BenchDescription:
    """The same bench as another machine has it, whose locks are not ours."""
    monkeypatch.setattr("palpate.drivers.bench.BenchLock", lambda _description: ExitStack())
    return sim.description


def test_a_program_on_another_machine_is_refused_and_changes_nothing(
    sim: SimulatedBench, elsewhere: BenchDescription
) -> None:
    with open_bench(sim) as first:
        drive(first)
        waits = []

        class Feeding:
            """Time in which the first program goes on, too."""

            goes_on = False
            stepper = None
            now_ns = sim.clock.now_ns

            def wait(self, duration: float) -> None:
                waits.append(duration)
                first.clock.wait(duration)

        before = dict(sim.amplifier.settings), dict(sim.generator.settings)
        with pytest.raises(
            BenchInUse, match=r"shaker amplifier at .* belongs to another program.*wait for it or end it"
        ):
            Bench(elsewhere, Feeding(), sim.operator).__enter__()
        assert (dict(sim.amplifier.settings), dict(sim.generator.settings)) == before
        assert sum(waits) == pytest.approx(WATCHDOG) and len(waits) == CLAIMS
        assert sim.amplifier.settings["enable"]
        first.clock.wait(10.0)
        assert sim.amplifier.settings["enable"]


def test_a_program_that_was_killed_is_followed_within_the_watchdog_s_time(
    sim: SimulatedBench, elsewhere: BenchDescription
) -> None:
    killed = open_bench(sim)
    killed.__enter__()
    drive(killed)
    for link in killed.links.values():
        link.close()
    died = sim.clock.now_ns()
    second, told = open_bench(sim), []
    second.waits = told.append
    with second:
        assert [f"waiting {WATCHDOG:g} s" in why for why in told] == [True]
        assert WATCHDOG <= 1e-9 * (sim.clock.now_ns() - died) <= 1.2 * WATCHDOG
        drive(second)
        killed.device("shaker_amplifier").link.open()  # it was stopped, and goes on
        killed.device("shaker_amplifier").afterwards = second.device("shaker_amplifier").feed
        with closing(killed.device("shaker_amplifier").link):
            with pytest.raises(BenchInUse, match="belongs to another program"):
                killed.clock.wait(1.0)
            with pytest.raises(DeviceError, match="device busy"):
                killed.device("shaker_amplifier").release()
        killed.device("shaker_amplifier").afterwards = lambda: None
        assert sim.amplifier.settings["enable"]
    with suppress(BenchError):  # its links are closed
        killed.__exit__(None, None, None)


def test_an_amplifier_that_was_off_meanwhile_is_claimed_again_with_its_settings(
    bench: Bench, sim: SimulatedBench
) -> None:
    bench.device("shaker_amplifier").set(gain=3.0)
    sim.amplifier.reset()
    with pytest.raises(SettingsLost, match="does not know this program any more"):
        bench.device("shaker_amplifier").feed()
    bench.recover()
    assert sim.amplifier.settings["gain"] == 3.0
    drive(bench)
    bench.clock.wait(10.0)
    assert sim.amplifier.settings["enable"]


# --- amplifiers without owners -------------------------------------------------------------------------


def without_owners(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The registers are not there: every amplifier but ours."""
    fields = tuple(field for field in SHAKER_AMPLIFIER.fields if field.address < SHAKER_AMPLIFIER["ticket"].address)
    read, write = sim.amplifier.read, sim.amplifier.write
    monkeypatch.setattr(sim.amplifier, "contract", replace(SHAKER_AMPLIFIER, fields=fields))

    def refuse(call: Callable[..., object], asked: set[str], value: object) -> object:
        if not asked <= {field.name for field in fields}:
            raise Refused(2)
        return call(value)

    monkeypatch.setattr(sim.amplifier, "read", lambda name: refuse(read, {name}, name))
    monkeypatch.setattr(sim.amplifier, "write", lambda values: refuse(write, set(values), values))


def test_a_bench_that_stands_unusual_forces_says_so_before_it_drives(sim: SimulatedBench) -> None:
    with open_bench(sim) as bench:
        assert bench.cautions == []
    with open_bench(sim, altered(sim.description, force_limit="40 N", withstands="50 N")) as bench:
        assert bench.cautions == ["force limit 40 N: its bench file says that this bench stands 50 N"]


def test_an_amplifier_without_owners_is_refused_until_the_bench_file_says_so(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_owners(sim, monkeypatch)
    with pytest.raises(DeviceError, match=r'has no owners.* watchdog_fed_by = "any request" .*bench file'):
        open_bench(sim).__enter__()
    description = altered(sim.description, device={"shaker_amplifier": {"watchdog_fed_by": "any request"}})
    with open_bench(sim, description) as bench:
        assert len(bench.cautions) == 1
        assert bench.cautions[0].startswith(
            f"{bench.device('shaker_amplifier').name}: any request feeds its watchdog, so that whoever"
        )
        drive(bench)
        bench.clock.wait(10.0)
        assert sim.amplifier.settings["enable"]
        sim.clock.wait(WATCHDOG)
        assert not sim.amplifier.settings["enable"]


# --- the signal generator ----------------------------------------------------------------------------


class TestSignalGenerator(ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("signal_generator"), sim.generator


def volts_at(generator: SimulatedSignalGenerator, *times: float) -> npt.NDArray[np.float64]:
    """Output voltage `times` s after now."""
    now = generator.clock.now_ns()
    return generator.voltage().at(np.array([now + round(time * 1e9) for time in times]))


def test_a_frequency_change_is_one_request_and_keeps_the_phase(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.device("signal_generator").sine(10.0, 2.0)
    bench.device("signal_generator").output(True)
    sim.clock.wait(0.1234567)
    before = volts_at(sim.generator, 0.0)
    slope = np.diff(volts_at(sim.generator, 0.0, 1e-6))
    wire = listen(bench.device("signal_generator").link, monkeypatch)
    bench.device("signal_generator").sine(20.0, 2.0)
    assert [request[0] for request in wire.requests] == [16]
    assert volts_at(sim.generator, 0.0) == pytest.approx(before, abs=1e-12)
    assert np.diff(volts_at(sim.generator, 0.0, 1e-6)) == pytest.approx(2 * slope, rel=1e-3)


def test_a_peak_above_the_rail_is_refused_before_it_is_sent(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = listen(bench.device("signal_generator").link, monkeypatch)
    for amplitude, offset in ((6.0, 4.000001), (9.0, -1.1), (math.nan, 0.0), (0.1, math.nan)):
        with pytest.raises(RangeError, match="signal generator: "):
            bench.device("signal_generator").sine(10.0, amplitude, offset)
    assert wire.requests == []


def test_the_generator_says_why_it_refused(bench: Bench) -> None:
    generator = bench.device("signal_generator")
    reasons = []
    for address, microvolts in ((0x14, 5_000_000), (0x12, 6_000_000), (0x12, 10_000_001), (0x12, 1)):
        registers = [microvolts >> 16, microvolts & 0xFFFF]
        reply = generator.link.client.write_registers(address, registers, device_id=generator.unit)
        reasons.append((reply.isError(), generator.contract.choice("error", generator.get("error"))))
    assert reasons == [(False, "none"), (True, "amplitude_plus_offset"), (True, "range"), (False, "none")]
    assert generator.read() == (10.0, 1e-6, 5.0)


@pytest.mark.parametrize(
    ("shape", "harmonic"),
    [
        ("sine", lambda k: 1.0 if k == 1 else 0.0),
        ("square", lambda k: 4 / (np.pi * k)),
        ("triangle", lambda k: 8 / (np.pi * k) ** 2 * (-1) ** (k // 2)),
    ],
)
def test_a_waveform_has_the_harmonics_of_its_shape(
    shape: str, harmonic: Callable[[int], float], bench: Bench, sim: SimulatedBench
) -> None:
    bench.device("signal_generator").set(frequency=10.0, amplitude=3.0, offset=0.5, waveform=shape)
    bench.device("signal_generator").output(True)
    bench.device("signal_generator").set(phase_reset=1)
    spectrum = np.fft.rfft(volts_at(sim.generator, *(np.arange(100) / 1000))) / 50
    assert spectrum[0] / 2 == pytest.approx(0.5)
    for k in range(1, 30):
        expected = -3j * harmonic(k) if k % 2 and k <= 25 else 0.0
        assert spectrum[k] == pytest.approx(expected, abs=1e-9), k


# --- a stranger ----------------------------------------------------------------------------------------


def as_a_stranger(generator: SignalGenerator, microvolts: int) -> None:
    """Writes an amplitude that our driver does not know of."""
    reply = generator.link.client.write_registers(
        generator.contract["amplitude"].address, [microvolts >> 16, microvolts & 0xFFFF], device_id=generator.unit
    )
    assert not reply.isError()


def test_a_setting_that_a_stranger_has_changed_and_taken_back_is_noticed_once(
    bench: Bench, sim: SimulatedBench
) -> None:
    drive(bench)
    bench.check_settings()
    as_a_stranger(bench.device("signal_generator"), 3_000_000)
    as_a_stranger(bench.device("signal_generator"), 1_000_000)
    with pytest.raises(SettingsLost, match=r"signal generator at .*: counts \d+ writes instead of \d+"):
        bench.check_settings()
    bench.recover()
    bench.check_settings()


def test_a_generator_that_was_off_meanwhile_is_noticed_though_it_holds_its_settings(
    bench: Bench, sim: SimulatedBench
) -> None:
    before = dict(sim.generator.settings)
    sim.generator.reset()
    sim.generator.turn(before)
    with pytest.raises(SettingsLost, match=r"counts \d+ writes instead of \d+"):
        bench.check_settings()


@pytest.mark.parametrize("carried_out", [False, True])
def test_a_write_that_was_not_confirmed_may_have_been_taken_or_not(
    carried_out: bool, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    transact = bench.device("signal_generator").link.transact

    def unconfirmed(*asked: Any, **timing: Any) -> None:
        if carried_out:
            transact(*asked, **timing)
        raise LinkTimeout("no answer")

    bench.device("signal_generator").sine(10.0, 0.0)
    with monkeypatch.context() as patch, pytest.raises(LinkTimeout):
        patch.setattr(bench.device("signal_generator").link, "transact", unconfirmed)
        bench.device("signal_generator").sine(10.0, 0.0)
    bench.check_settings()
    as_a_stranger(bench.device("signal_generator"), 0)
    with pytest.raises(SettingsLost, match="writes instead of"):
        bench.check_settings()


# --- exciters that play a list -----------------------------------------------------------------------

SCENE = read_scene("ideal").with_devices({"drive": {"kind": "maxon-epos4", "full_scale": 0.5}})
PERCENT = 5.0 * 3.5 / 100  # V at the coil for a percent of the rated torque


@pytest.fixture(scope="module")
def listed() -> Iterator[SimulatedBench]:
    with SimulatedBench(SCENE) as simulated:
        yield simulated


def volts(sim: SimulatedBench) -> float:
    """Peak of the sine at the coil [V]."""
    return float(abs(sim.rig.coil_voltage().amplitude[0]))


@contextmanager
def driven(sim: SimulatedBench, amplitude: float) -> Iterator[tuple[Any, Any]]:
    """An open bench that drives at 10 Hz, and its exciter."""
    with open_bench(sim) as bench:
        bench.drive()
        drive = bench.role(Exciter)
        drive.sine(10.0, amplitude)
        yield bench, drive


# --- the stream ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [0.1, 3.7, 15.0, 33.4, 40.0])
def test_the_list_of_a_frequency_has_whole_periods_of_it_and_of_10_hz_exactly_100_set_points(frequency: float) -> None:
    found = grid(frequency, 1e-3, "drive")
    assert FEWEST * found.periods <= found.count <= MOST_CYCLIC
    assert found.step_us >= 1000
    assert found.frequency == pytest.approx(frequency, rel=2.01e-5)
    assert sum(found.sine(1.0)) == pytest.approx(0.0, abs=1e-9)
    usual = grid(10.0, 1e-3, "drive")
    assert usual == SetPointGrid(100, 1000, 1)
    assert usual.sine(2.0)[:2] == [0.0, pytest.approx(2.0 * math.sin(2 * math.pi / 100))]


@pytest.mark.parametrize("frequency", [50.1, 0.001, 200.0])
def test_a_frequency_that_no_list_reaches_is_refused(frequency: float) -> None:
    with pytest.raises(RangeError, match=rf"drive: frequency = {frequency:g} Hz is outside 0\.00391 to 50 Hz"):
        grid(frequency, 1e-3, "drive")


def test_a_stream_shakes_the_stack_with_its_amplitude_and_its_phase_goes_on(listed: SimulatedBench) -> None:
    with driven(listed, 1.0) as (bench, drive):
        begun = listed.clock.now_ns()
        assert (volts(listed), drive.effort()) == (pytest.approx(5.0 * PERCENT, rel=0.01), 5.0)
        bench.clock.wait(0.123)
        drive.sine(10.0, 4.0)
        assert (listed.clock.now_ns() - begun) % 100_000_000 == 0  # the new list begins where the old one crosses zero
        assert volts(listed) == pytest.approx(20.0 * PERCENT, rel=0.005)
        before = listed.rig.coil_voltage()
        assert np.angle(before.amplitude[0]) == pytest.approx(-math.pi / 2 - math.pi / 100)  # steps are late by half
        drive.sine(10.0, 0.0)
        assert volts(listed) == 0.0
    assert not listed.devices["drive"].driving


def test_an_amplitude_above_the_full_scale_is_refused_before_anything_is_sent(listed: SimulatedBench) -> None:
    with open_bench(listed) as bench:
        bench.drive()
        with pytest.raises(RangeError, match=r"amplitude = 10\.5 V is outside 0 to 10 V"):
            bench.role(Exciter).sine(10.0, 10.5)
        assert volts(listed) == 0.0


class Kernel:
    """Stands for a bus whose kernel sends cyclic frames."""

    def __init__(self) -> None:
        self.begun: list[tuple[list[bytes], float]] = []
        self.stopped = 0

    def send_periodic(self, messages: list[can.Message], period: float) -> Any:
        assert not any(each.is_extended_id for each in messages)
        self.begun.append(([bytes(each.data) for each in messages], period))
        return SimpleNamespace(stop=self._stop)

    def _stop(self) -> None:
        self.stopped += 1


def test_on_a_real_bus_the_kernel_sends_the_list_and_a_new_one_replaces_it() -> None:
    kernel: Any = Kernel()
    cyclic = Cyclic(kernel, "socketcan", "can0")
    cyclic.begin(0x401, [b"\x01\x00", b"\xff\xff"], 1000)
    cyclic.begin(0x401, [b"\x02\x00", b"\xfe\xff"], 500)
    assert kernel.begun == [([b"\x01\x00", b"\xff\xff"], 1e-3), ([b"\x02\x00", b"\xfe\xff"], 5e-4)]
    assert kernel.stopped == 1
    cyclic.end_all()
    assert kernel.stopped == 2


def test_an_interface_without_a_timer_of_the_kernel_is_refused_by_name() -> None:
    bus: Any = None
    with pytest.raises(LinkError, match=r"CAN bus can7: pcan cannot send set-points on time.* use an adapter"):
        Cyclic(bus, "pcan", "can7").begin(0x401, [b"\0\0"], 1000)


# --- who dies ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("after", "amplitude"), first_of([(3.21, 2.0), (0.0, 10.0), (0.4567, 0.05), (29.9, 5.0)]))
def test_whoever_dies_at_any_moment_the_output_is_off_within_the_time_out(
    after: float, amplitude: float, listed: SimulatedBench
) -> None:
    with driven(listed, amplitude) as (bench, _):
        bench.clock.wait(after)
        assert listed.devices["drive"].driving
        listed.clock.wait(WATCHDOG)  # nobody feeds: the program is dead, and kernel or bus go on with its list
        assert not listed.devices["drive"].driving
        assert volts(listed) == 0.0


@contextmanager
def another(sim: SimulatedBench) -> Iterator[Any]:
    """The driver of another program, which uses the drive and does not hold the lock of the bench."""
    described = sim.description.devices
    driver: Any = open_bench(sim).device("drive")
    driver.link.open()
    try:
        driver.connect()
        driver.set_up(described[0].settings, WATCHDOG)
        yield driver
    finally:
        driver.link.close()


def test_a_drive_that_another_program_has_stopped_on_the_bus_is_switched_off_at_once(
    listed: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driven(listed, 2.0) as (bench, drive):
        link: Any = bench.device("drive").link
        told: list[str] = []

        def command(node: Any, state: str) -> None:
            CanLink.command(link, node, state)
            told.append(state)

        def transfer(who: str, *_: Any) -> Any:
            if told[-1] == "STOPPED":  # instead of waiting for its answer in vain
                raise LinkError(f"{who}: no answer")
            return CanLink.transfer(link, who, *_)

        monkeypatch.setattr(link, "transfer", transfer)
        monkeypatch.setattr(link, "command", command)
        link.command(link.add_node(listed.devices["drive"].id), "STOPPED")
        with pytest.raises(LinkError, match="no answer"):
            drive.check()
        assert listed.devices["drive"].driving
        assert insist(drive.means(), bench.clock) == []
        assert not listed.devices["drive"].driving


def test_a_drive_that_another_program_has_made_deaf_to_set_points_hears_the_next_ones(listed: SimulatedBench) -> None:
    with driven(listed, 2.0) as (bench, drive):
        link: Any = bench.device("drive").link
        link.command(link.add_node(listed.devices["drive"].id), "PRE-OPERATIONAL")
        drive.check()  # an answer comes after what was sent before
        assert volts(listed) == 0.0
        drive.sine(10.0, 2.0)
        assert volts(listed) == pytest.approx(10.0 * PERCENT, rel=0.01)


def test_a_program_that_finds_the_drive_of_a_killed_one_waits_until_it_is_off(listed: SimulatedBench) -> None:
    with another(listed) as killed:
        killed.drive()
        killed.sine(10.0, 2.0)
        assert volts(listed) > 0.0
        with open_bench(listed) as bench:
            assert not listed.devices["drive"].driving
            bench.drive()  # which clears the fault that the master was lost
            bench.role(Exciter).sine(10.0, 1.0)
            assert volts(listed) == pytest.approx(5.0 * PERCENT, rel=0.01)


def test_a_drive_that_a_living_program_feeds_is_not_taken(listed: SimulatedBench) -> None:
    with another(listed) as first:
        first.drive()
    with another(listed) as second:

        def wait(duration: float) -> None:
            listed.clock.wait(duration)
            second.link.beat(127)  # what the first program does

        told: list[str] = []
        clock: Any = SimpleNamespace(wait=wait)
        with pytest.raises(BenchInUse, match="belongs to another program, which feeds its watchdog"):
            claim(second, clock, told.append)
        assert len(told) == 1
        second.rest()


def test_a_drive_that_watches_nobody_is_not_taken(listed: SimulatedBench) -> None:
    with another(listed) as first:
        first.drive()
        first.set("watchdog", 0.0)
    with another(listed) as second:
        with pytest.raises(DeviceError, match="is switched on, and watches nobody's heartbeat"):
            second.claim()
        second.rest()


def test_a_fault_stops_a_run_by_name_and_is_not_cleared(listed: SimulatedBench) -> None:
    with open_bench(listed) as bench:
        bench.drive()
        listed.devices["drive"].trip("over_current")
        with pytest.raises(SafetyError, match="has the fault 0x2310, and has switched its output off"):
            bench.role(Exciter).check()
        bench.rest()
        with pytest.raises(DeviceError, match="has the fault 0x2310; find its cause"):
            bench.drive()
    listed.devices["drive"].reset()


def test_a_drive_that_was_switched_off_and_on_has_its_set_up_again_and_gives_no_torque_before_it_is_asked(
    listed: SimulatedBench,
) -> None:
    with driven(listed, 1.0) as (bench, drive):
        listed.can.reboot(listed.devices["drive"])
        assert volts(listed) == 0.0
        with pytest.raises(SafetyError, match="its output was switched off"):
            drive.check()
        bench.recover()
        assert volts(listed) == 0.0
        bench.drive()
        drive.sine(10.0, 1.0)
        assert volts(listed) == pytest.approx(5.0 * PERCENT, rel=0.01)
