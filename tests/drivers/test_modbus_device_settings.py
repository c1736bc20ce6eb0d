"""What a driver on Modbus does about failures: asks again, reads back, remembers settings and writes them again."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout
from tests.drivers.registers import Oven, oven

# --- what is not confirmed -----------------------------------------------------------------------------


def attended(**held: Any) -> tuple[Oven, Any, list[str]]:
    driver, link = oven(**held)
    noticed = list[str]()
    driver.read_attempts, driver.noticed = 2, noticed.append
    return driver, link, noticed


@pytest.mark.parametrize("setting", [{"heater": "on"}, {"setpoint": 30.0}, {"label": "ab"}])
def test_a_setting_that_is_not_confirmed_is_read_back_on_an_attended_bench(setting: dict[str, Any]) -> None:
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    driver.set(**setting)
    assert [asked[0] for asked in link.asked] == ["write_registers", "read_registers"]
    assert noticed == ["no answer; read back, it was carried out"]


@pytest.mark.parametrize("order", [{"program": 3}, {"start": 3}, {"heater": "on", "program": 3}])
def test_an_order_that_is_not_confirmed_is_never_read_back(order: dict[str, Any]) -> None:
    """Its register reads as it was written, whether the order was carried out or not."""
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    with pytest.raises(LinkTimeout):
        driver.set(**order)
    assert (len(link.asked), noticed) == (1, [])


def test_a_setting_that_may_have_been_carried_out_is_remembered_and_a_refused_one_is_not() -> None:
    driver, link, _ = attended()
    for failure, differences in ((DeviceError("no"), 0), (LinkTimeout("no answer"), 1)):
        link.failures = [failure]
        with pytest.raises(type(failure)):
            driver.set(heater="on")
        assert len(driver.differences()) == differences


def test_a_setting_that_reads_back_in_part_was_not_carried_out() -> None:
    driver, link, noticed = attended()
    link.late = [LinkTimeout("no answer")]
    link.written = lambda: link.put(heater="off")
    with pytest.raises(LinkTimeout):
        driver.set(setpoint=30, heater="on")
    assert noticed == []


# --- questions, orders and broken devices ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("attempts", "failing", "answered"), [(1, 0, True), (1, 1, False), (2, 1, True), (2, 2, False)]
)
def test_a_question_is_asked_as_often_as_is_allowed(attempts: int, failing: int, answered: bool) -> None:
    driver, link = oven(warmth=21.5)
    noticed = list[str]()
    driver.read_attempts, driver.noticed = attempts, noticed.append
    link.failures = [LinkTimeout(f"silent {count}") for count in range(failing)]
    if answered:
        assert driver.get("warmth") == 21.5
    else:
        with pytest.raises(LinkTimeout, match=f"silent {failing - 1}") as caught:
            driver.get("warmth")
        assert caught.value.device == driver.name
    assert len(link.asked) == failing + answered
    assert noticed == [f"silent {count}; asked again" for count in range(min(failing, attempts - 1))]


def test_a_device_that_is_broken_is_neither_asked_nor_told() -> None:
    driver, link, noticed = attended()
    driver.broken = "oven: smokes"
    for use in (lambda: driver.get("warmth"), lambda: driver.set(heater="on"), lambda: driver.set(start=1)):
        with pytest.raises(DeviceError, match=r"^oven: smokes; it is not used any more in this run$") as caught:
            use()
        assert caught.value.device == driver.name
    assert (link.asked, noticed) == ([], [])


def test_a_device_that_breaks_while_it_is_asked_is_not_asked_again() -> None:
    driver, link, _ = attended()

    class Breaking(LinkTimeout):
        def __init__(self) -> None:
            super().__init__("silent")
            driver.broken = "oven: smokes"

    def breaks(*_: Any, **__: Any) -> Any:
        link.asked.append(("asked",))
        raise Breaking

    link.transact = breaks
    for use in (lambda: driver.get("warmth"), lambda: driver.set(heater="on")):
        driver.broken = ""
        with pytest.raises(LinkTimeout, match="silent"):
            use()
    assert len(link.asked) == 2


def test_after_what_was_asked_or_told_the_watchdog_is_thought_of_and_not_after_a_failure() -> None:
    driver, link = oven()
    thought = list[int]()
    driver.afterwards = lambda: thought.append(len(link.asked))
    driver.get("warmth")
    driver.set(heater="on")
    link.failures = [LinkError("lost")]
    with pytest.raises(LinkError):
        driver.get("warmth")
    assert thought == [1, 2]


# --- settings that were lost ---------------------------------------------------------------------------


def test_each_setting_that_differs_is_told_with_both_values_and_no_other() -> None:
    driver, link = oven()
    driver.set(setpoint=30.0, heater="on")
    driver.set(program=3)
    link.put(setpoint=-20.0, program=5)  # beyond its limits, as after a loss of power
    assert driver.differences() == ["oven at rack unit 7: setpoint is -20, was set to 30.0"]
    link.put(heater="off")
    assert driver.differences()[1:] == ["oven at rack unit 7: heater is 0, was set to on"]
    link.put(setpoint=30.0, heater="on")
    assert driver.differences() == []


def test_what_differs_is_written_again_one_by_one_and_looked_at() -> None:
    driver, link = oven()
    driver.set(setpoint=30.0, heater="on")
    link.asked.clear()
    link.put(heater="off")
    driver.restore()
    assert link.writes() == [(0x12, [1])]
    assert [asked[0] for asked in link.asked] == ["read_registers", "write_registers", "read_registers"]


def test_a_device_that_does_not_take_its_settings_again_is_told_with_all_of_them() -> None:
    driver, link = oven()
    driver.set(setpoint=30.0, heater="on")
    link.put(setpoint=0.0, heater="off")
    link.written = lambda: link.put(setpoint=0.0, heater="off")
    with pytest.raises(
        DeviceError,
        match=r"setpoint is 0, was set to 30\.0; oven at rack unit 7: heater is 0, was set to on: it does not take its",
    ):
        driver.restore()
