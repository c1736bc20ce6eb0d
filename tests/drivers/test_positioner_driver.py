"""The driver of the positioner by itself: where it takes itself to stand."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.instrument.contracts.own import POSITIONER
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock
from tests.drivers.registers import Registers

HOMED = 2


def positioner(**held: Any) -> tuple[MicroPositioner, Any, VirtualClock]:
    link: Any = Registers(POSITIONER, **{"limit_high": 0.02, "status": HOMED, **held})
    clock = VirtualClock()
    driver = MicroPositioner.at(DevicePlace(link, 1, None, clock))
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
