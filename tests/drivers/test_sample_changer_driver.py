"""The driver of the sample changer by itself: what it orders, and how long it waits."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sample_changer import POLL, ModbusSampleChanger
from palpate.instrument.contracts.own import SAMPLE_CHANGER
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock
from tests.drivers.registers import Registers

MOVING = 1


def changer(**held: Any) -> tuple[ModbusSampleChanger, Any, VirtualClock]:
    link: Any = Registers(SAMPLE_CHANGER, **{"place_1": "a", "place_8": "b", **held})
    clock = VirtualClock()
    driver = ModbusSampleChanger.at(DevicePlace(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


def lays(link: Any, clock: VirtualClock, name: str, after: float) -> None:
    """From the order on the changer moves for some seconds; then this sample lies there."""
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
