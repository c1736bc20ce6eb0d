"""The sample changer lays what is ordered by name, says what lies there, and is asked whether it lies there still."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sample_changer import POLL, ChangerState, ModbusSampleChanger
from palpate.extend import Bench, ModbusDevice, Scene, SimulatedDevice
from palpate.instrument.contracts.own import SAMPLE_CHANGER
from palpate.instrument.errors import DeviceError, SampleError, UnknownName
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.testing.wire import listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.testing import ModbusConformance
from tests.drivers.fake_links import Registers

EXCHANGE = 5.0  # s, as the simulated one comes


class WithChanger:
    @pytest.fixture(scope="class")
    @classmethod
    def sim(cls, scene: Scene) -> Iterator[SimulatedBench]:
        with SimulatedBench(scene, samples=[SAMPLES[name] for name in "123"]) as simulated:
            yield simulated


class TestSampleChanger(WithChanger, ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        assert sim.changer is not None
        return bench.device("sample_changer"), sim.changer


@pytest.fixture
def sim(nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    with SimulatedBench(scene, samples=[SAMPLES[name] for name in "123"]) as simulated:
        yield simulated


@pytest.fixture
def changer(bench: Bench) -> ModbusSampleChanger:
    return bench.device("sample_changer")


def test_a_sample_is_laid_by_its_name_and_takes_its_time(changer: ModbusSampleChanger, sim: SimulatedBench) -> None:
    assert changer.samples == ("1", "2", "3")
    before = sim.clock.now_ns()
    changer.mount("2")
    assert sim.clock.now_ns() - before == EXCHANGE * 1e9
    assert (changer.mounted(), sim.rig.sample) == (ChangerState("2", 2, moving=False), SAMPLES["2"])
    changer.mount("2")
    assert sim.clock.now_ns() - before == EXCHANGE * 1e9
    changer.mount("1")
    assert changer.mounted().sample == "1"


def test_nothing_lies_under_the_probe_while_the_carriage_moves_and_whoever_comes_waits_for_it(
    changer: ModbusSampleChanger, sim: SimulatedBench
) -> None:
    changer.mount("2")
    changer.set(order="3")
    sim.clock.wait(EXCHANGE / 2)
    assert (changer.mounted(), sim.rig.sample) == (ChangerState("", 3, moving=True), None)
    with pytest.raises(DeviceError, match=r"exception 6, .* to order = '1'"):
        changer.set(order="1")
    changer.mount("1")  # after that of the other
    assert changer.mounted() == ChangerState("1", 6, moving=False)
    changer.set(order="3")
    changer.connect()  # a killed run has left it on its way
    assert changer.mounted() == ChangerState("3", 8, moving=False)


def test_a_name_that_no_place_holds_is_refused_by_the_driver_and_by_the_device(
    changer: ModbusSampleChanger, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire = listen(changer.link, monkeypatch)
    with pytest.raises(UnknownName, match=r"sample of the sample changer at .* '12' .*; valid: 1, 2, 3"):
        changer.mount("12")
    assert wire.requests == []
    for name in ("12", "", "4"):
        with pytest.raises(DeviceError, match=f"exception 3, .* to order = '{name}'"):
            changer.set(order=name)
    assert changer.mounted() == ChangerState("", 0, moving=False)


def test_nothing_is_moved_below_a_probe_that_is_down(changer: ModbusSampleChanger, bench: Bench) -> None:
    changer.mount("1")
    bench.device("positioner").move(5e-3)
    assert changer.contract.set_bits("status", changer.get("status")) == {"probe_down"}
    with pytest.raises(DeviceError, match="exception 4"):
        changer.mount("2")
    assert changer.mounted().sample == "1"


def by_hand(name: str) -> Callable[[ModbusSampleChanger, SimulatedBench], None]:
    return lambda _changer, sim: sim.rig.mount(SAMPLES[name])


def away_and_back(changer: ModbusSampleChanger, sim: SimulatedBench) -> None:
    by_hand("1")(changer, sim)
    by_hand("2")(changer, sim)


def ordered(changer: ModbusSampleChanger, sim: SimulatedBench) -> None:
    assert sim.changer is not None
    sim.changer.write_text("order", "3")


def has_ordered(changer: ModbusSampleChanger, sim: SimulatedBench) -> None:
    ordered(changer, sim)
    sim.clock.wait(EXCHANGE)


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (by_hand("3"), "has '3' mounted, '2' was ordered; exchanged 1 times since"),
        (away_and_back, "has '2' mounted, '2' was ordered; exchanged 2 times since"),
        (ordered, "moves, '2' was ordered; exchanged 1 times since"),
        (has_ordered, "has '3' mounted, '2' was ordered; exchanged 2 times since"),
        (lambda _, sim: sim.rig.press_tooth(0), "has nothing mounted, '2' was ordered; exchanged 1 times since"),
    ],
)
def test_what_anybody_else_has_done_to_the_sample_is_found(
    other: Callable[[ModbusSampleChanger, SimulatedBench], None], says: str, bench: Bench, sim: SimulatedBench
) -> None:
    bench.device("sample_changer").mount("2")
    bench.check_settings()
    other(bench.device("sample_changer"), sim)
    with pytest.raises(SampleError, match=f"^sample changer at .*: {says}"):
        bench.check_settings()


def test_a_power_cycle_neither_moves_a_sample_nor_hides_that_one_was_moved(
    changer: ModbusSampleChanger, sim: SimulatedBench
) -> None:
    assert sim.changer is not None
    changer.mount("2")
    sim.changer.reset()
    changer.check()
    away_and_back(changer, sim)
    sim.changer.reset()
    with pytest.raises(SampleError):
        changer.check()


def test_what_a_person_is_asked_to_lay_there_is_no_stranger(bench: Bench, sim: SimulatedBench) -> None:
    for lay in (lambda: bench.operator.lay_on_support(SAMPLES["1"]), lambda: bench.operator.press_tooth(0)):
        bench.operator.mount(SAMPLES["2"])
        lay()
        bench.check_settings()


# --- the driver by itself ------------------------------------------------------------------------------


MOVING = 1


def alone(**held: Any) -> tuple[ModbusSampleChanger, Any, VirtualClock]:
    link: Any = Registers(SAMPLE_CHANGER, **{"place_1": "a", "place_8": "b", **held})
    clock = VirtualClock()
    driver = ModbusSampleChanger.at(DevicePlace(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


def lays(link: Any, clock: VirtualClock, name: str, after: float) -> None:
    """From the order on the alone moves for some seconds; then this sample lies there."""
    begun = list[int]()

    def look(reply: Any) -> Any:
        if begun and 1e-9 * (clock.now_ns() - begun[0]) >= after:
            link.put(status=0, mounted=name, exchanges=link.held("exchanges") + 1 if link.held("status") else 1)
        return reply

    def ordered() -> None:
        begun.append(clock.now_ns())
        link.put(status=MOVING, mounted="")

    link.written, link.replied = ordered, look


def test_another_sample_than_was_ordered_is_told() -> None:
    driver, link, clock = alone()
    lays(link, clock, "a", 0.0)
    with pytest.raises(DeviceError, match=r"^sample changer at .*: has mounted 'a', was ordered 'b'; look at it$"):
        driver.mount("b")
    driver.check()  # nothing was laid by an order


@pytest.mark.parametrize(("timeout", "done"), [(1.0, False), (1.5, True)])
def test_a_changer_is_waited_for_no_longer_than_it_may_take(timeout: float, done: bool) -> None:
    driver, link, clock = alone()
    lays(link, clock, "b", 2 * POLL - 0.1)
    begun = clock.now_ns()
    if done:
        driver.mount("b", timeout)
        return
    with pytest.raises(DeviceError, match=rf"^sample changer at .* after {timeout:g} s; look at it$"):
        driver.mount("b", timeout)
    assert 1e-9 * (clock.now_ns() - begun) == pytest.approx(timeout)
