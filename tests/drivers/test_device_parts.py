"""Sample changer, exciter, positioner and heartbeat by themselves."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices.device import Place
from palpate.drivers.devices.exciter import Amplified, Exciter
from palpate.drivers.devices.heartbeat import Heartbeat
from palpate.drivers.devices.positioner import Positioner
from palpate.drivers.devices.sample_changer import POLL, Mounted, SampleChanger
from palpate.instrument.contracts import positioner as stage
from palpate.instrument.contracts import sample_changer
from palpate.instrument.errors import DeviceError, UnknownName
from palpate.simulators.clock import VirtualClock
from tests.drivers.registers import Registers

# --- sample changer ------------------------------------------------------------------------------------

MOVING = 1


def changer(**held: Any) -> tuple[SampleChanger, Any, VirtualClock]:
    link: Any = Registers(sample_changer.CONTRACT, **{"place_1": "a", "place_8": "b", **held})
    clock = VirtualClock()
    driver = SampleChanger.at(Place(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


def lays(link: Any, clock: VirtualClock, name: str, after: float) -> None:
    """From the order on it moves for so many s, then this lies there."""
    begun = list[int]()

    def look(reply: Any) -> Any:
        if begun and 1e-9 * (clock.now_ns() - begun[0]) >= after:
            link.put(status=0, mounted=name, exchanges=link.held("exchanges") + 1 if link.held("status") else 1)
        return reply

    def ordered() -> None:
        begun.append(clock.now_ns())
        link.put(status=MOVING, mounted="")

    link.written, link.replied = ordered, look


def test_a_changer_knows_the_samples_in_all_its_places() -> None:
    assert changer()[0].samples == ("a", "b")


def test_a_sample_is_ordered_by_its_name_and_waited_for() -> None:
    driver, link, clock = changer()
    begun = clock.now_ns()
    lays(link, clock, "b", 3 * POLL)
    driver.mount("b")
    assert driver.mounted() == Mounted("b", 1, moving=False)
    assert 3 * POLL <= 1e-9 * (clock.now_ns() - begun) <= 4 * POLL
    driver.check()


def test_another_sample_than_was_ordered_is_told() -> None:
    driver, link, clock = changer()
    lays(link, clock, "a", 0.0)
    with pytest.raises(DeviceError, match=r"^sample changer at .*: has mounted 'a', was ordered 'b'; look at it$"):
        driver.mount("b")
    driver.check()  # nothing was laid by an order


@pytest.mark.parametrize(("timeout", "done"), [(1.0, False), (1.5, True)])
def test_a_changer_is_waited_for_no_longer_than_it_may_take(timeout: float, done: bool) -> None:
    driver, link, clock = changer()
    lays(link, clock, "b", 2 * POLL - 0.1)
    begun = clock.now_ns()
    if done:
        driver.mount("b", timeout)
        return
    with pytest.raises(DeviceError, match=rf"^sample changer at .* after {timeout:g} s; look at it$"):
        driver.mount("b", timeout)
    assert 1e-9 * (clock.now_ns() - begun) == pytest.approx(timeout)


def test_a_sample_that_no_place_holds_is_refused_before_anything_is_sent() -> None:
    driver, link, _ = changer()
    with pytest.raises(UnknownName, match=r"sample of the sample changer at rack unit 1 'c'.*; valid: a, b"):
        driver.mount("c")
    assert link.asked == []


# --- exciter -------------------------------------------------------------------------------------------


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
        failures = exciter.switch_off()
        assert told == [("amplifier", "disable"), ("source", "output", False), QUIET]
        assert failures == (["amplifier disable", "source output", "source sine"] if fails else [])


def test_an_exciter_drives_by_its_source_and_its_effort_is_the_amplifier_s_peak_current() -> None:
    told = list[Any]()
    exciter = Amplified(source := Told("source", told), amplifier := Told("amplifier", told))
    exciter.sine(12.0, 0.5)
    assert exciter.effort() == pytest.approx(2.0 * math.sqrt(2))
    assert exciter.effort_limit() == 3.5
    assert told == [("source", "sine", 12.0, 0.5), ("amplifier", "check"), ("amplifier", "get", "current_limit")]
    assert exciter.members == (amplifier, source)
    assert exciter.guard is amplifier
    assert Amplified(source, Told("amplifier", told, watched=False)).guard is None


def test_an_exciter_that_is_one_device_is_its_only_member_and_is_switched_off_by_resting() -> None:
    told = list[str]()

    class Drive(Exciter):
        sine = drive = check = effort = effort_limit = lambda self, *_: None  # type: ignore[assignment]

        def rest(self) -> None:
            told.append("rest")

    drive = Drive()
    assert (drive.members, drive.guard, drive.largest, drive.unit) == ((drive,), None, 10.0, "A")
    drive.quiet()
    assert told == []
    drive.halt()
    assert drive.switch_off() == []
    assert told == ["rest", "rest"]


# --- positioner ----------------------------------------------------------------------------------------

HOMED = 2


def positioner(**held: Any) -> tuple[Positioner, Any, VirtualClock]:
    link: Any = Registers(stage.CONTRACT, **{"limit_high": 0.02, "status": HOMED, **held})
    clock = VirtualClock()
    driver = Positioner.at(Place(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


@pytest.mark.parametrize(
    ("status", "found"), [(HOMED, []), (0, ["micro-positioner at rack unit 1: has lost its home"])]
)
def test_a_positioner_that_has_lost_its_home_differs(status: int, found: list[str]) -> None:
    driver, link, _ = positioner()
    link.put(status=status)
    assert driver.differences() == found


@pytest.mark.parametrize(("off", "there"), [(0.0, True), (1e-6, True), (3e-6, False), (-3e-6, False)])
def test_a_positioner_stands_where_it_was_sent_to_two_micrometres(off: float, there: bool) -> None:
    driver, link, _ = positioner()
    link.written = lambda: link.put(position=0.005 + off)
    if not there:
        with pytest.raises(DeviceError, match=r"stands at .* mm, was sent to 5 mm$"):
            driver.move(0.005)
        return
    driver.move(0.005)
    assert driver.differences() == []
    link.put(position=0.005 + 3e-6)
    assert driver.differences() == ["micro-positioner at rack unit 1: stands at 5.003 mm, was sent to 5 mm"]


def test_the_limits_of_a_bench_that_were_set_before_are_kept_when_it_is_opened_again() -> None:
    driver, link, _ = positioner()
    assert driver.travel() == 0.02
    driver.set_limits(0.001, 0.01)
    link.put(limit_low=0.0, limit_high=0.02)
    driver.connect()
    assert driver.travel() == 0.01
    assert len(driver.differences()) == 2


# --- heartbeat -----------------------------------------------------------------------------------------


def test_a_heartbeat_beats_at_its_interval_until_it_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    said, intervals = list[str](), list[float]()
    heartbeat = Heartbeat(lambda: said.append("alive"), 0.5)

    def wait(interval: float) -> bool:
        intervals.append(interval)
        return len(intervals) > 3

    monkeypatch.setattr(heartbeat._end, "wait", wait)
    with heartbeat:
        heartbeat._thread.join()
    assert (said, intervals) == (["alive"] * 3, [0.5] * 4)
    assert heartbeat._end.is_set()
    assert heartbeat._thread.daemon  # a program that ends does not wait for it
