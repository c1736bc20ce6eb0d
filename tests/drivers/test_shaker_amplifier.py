"""The amplifier drops its output on too much current, heat or silence, and obeys its owner alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any

import numpy as np
import pytest

from palpate.drivers.devices.exciter import ShakerAmplifier
from palpate.drivers.ownership import CLAIMS
from palpate.extend import Bench, BenchDescription, ModbusDevice, Refused, SimulatedDevice
from palpate.instrument.bench.kinds import AmplifierSettings
from palpate.instrument.contracts.own import SETTINGS, SHAKER_AMPLIFIER
from palpate.instrument.errors import BenchError, BenchInUse, DeviceError, SafetyError, SettingsLost
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.exciter import SimulatedShakerAmplifier
from palpate.simulators.linear.periodic import Periodic
from palpate.testing import ModbusConformance
from tests.conftest import latched
from tests.drivers.benches import altered, drive, open_bench
from tests.drivers.fake_links import Registers

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


@pytest.mark.parametrize(("amplitude", "trips"), [(1.7499, False), (1.7501, True)])
def test_over_current_trips_at_the_peak(amplitude: float, trips: bool, bench: Bench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=1.0, watchdog=0)
    drive(bench, amplitude)
    state = bench.device("shaker_amplifier").read()
    assert state.enabled is not trips
    assert state.faults_latched == ({"over_current"} if trips else set())


def test_every_way_to_too_much_current_trips(bench: Bench) -> None:
    generator, amplifier = bench.device("signal_generator"), bench.device("shaker_amplifier")
    amplifier.configure(gain=2.0, current_limit=1.0, watchdog=0)
    drive(bench, 1.0)
    for device, much, less in (
        (generator, {"offset": -1.0}, {"offset": 0.0}),
        (amplifier, {"gain": 4.0}, {"gain": 2.0}),
        (amplifier, {"current_limit": 0.5}, {}),
        (amplifier, {}, {"current_limit": 1.0}),  # to enable it is enough
    ):
        amplifier.enable()
        if much:
            device.set(**much)
        assert amplifier.read().faults_latched == {"over_current"}
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
