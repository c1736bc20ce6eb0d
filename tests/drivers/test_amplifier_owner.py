"""The amplifier obeys its owner: strangers neither keep its output on nor set it, but anybody may switch it off."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from functools import partial
from random import Random

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.ownership import CLAIMS
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.contracts.own import SETTINGS, SHAKER_AMPLIFIER
from palpate.instrument.errors import BenchError, BenchInUse, DeviceError, SettingsLost
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.exciter import SimulatedShakerAmplifier
from palpate.simulators.linear.periodic import Periodic
from palpate.simulators.wire.device import Refused
from tests.drivers.benches import altered, drive, open_bench

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
