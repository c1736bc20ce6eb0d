"""The driver of the strain indicator by itself: which readings it uses, and when it takes the display for old."""

from __future__ import annotations

import math
from typing import Any

import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.load_indicator import IndicatorReading, StrainIndicator
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock
from tests.drivers.registers import Registers

STABLE, OVERLOAD, OPEN = (1 << STRAIN_INDICATOR["status"].bits[bit] for bit in ("stable", "overload", "bridge_open"))


def indicator(**held: Any) -> tuple[StrainIndicator, Any, VirtualClock]:
    link: Any = Registers(STRAIN_INDICATOR, status=STABLE, **held)
    clock = VirtualClock()
    return StrainIndicator.at(DevicePlace(link, 1, None, clock)), link, clock


def shows(link: Any, counts: int, decimals: int = 1) -> None:
    link.put(reading=counts, decimals=decimals, reading_float=counts * 10.0**-decimals)


# --- one reading ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("counts", "decimals", "reading", "step"), [(123, 1, 12.3, 0.1), (-45, 0, -45.0, 1.0)])
def test_the_display_is_read_with_the_place_of_its_point(
    counts: int, decimals: int, reading: float, step: float
) -> None:
    driver, link, _ = indicator()
    assert math.isnan(driver.resolution_mV)
    shows(link, counts, decimals)
    assert driver.read() == IndicatorReading(pytest.approx(reading), step, "", "")  # type: ignore[arg-type]
    assert driver.resolution_mV == step


@pytest.mark.parametrize(
    ("status", "valid", "sick"),
    [
        (STABLE, True, ""),
        (0, False, ""),  # only moving
        (STABLE | OVERLOAD, False, "overload; check the bridge and its wires"),
        (OPEN, False, "bridge open; check the bridge and its wires"),
        (STABLE | OPEN | OVERLOAD, False, "bridge open, overload; check the bridge and its wires"),
    ],
)
def test_a_reading_is_valid_where_it_stands_still_and_the_bridge_is_whole(status: int, valid: bool, sick: str) -> None:
    driver, link, _ = indicator()
    link.put(status=status)
    assert driver.read().valid is valid
    assert driver.sick() == sick


@pytest.mark.parametrize(
    ("counts", "floating", "used"),
    [
        (100, 10.1, True),  # within a step: the display rounds
        (100, 9.9, True),
        (100, 10.11, False),
        (100, 9.89, False),
        (-100, -10.11, False),
        (-100, 10.0, False),
        (100, math.nan, False),
        (2_000_000, 200_000.25, True),  # the float has 24 bits
        (2_000_000, 200_000.5, False),
    ],
)
def test_the_integer_and_the_float_agree_within_a_step_and_the_precision_of_a_float(
    counts: int, floating: float, used: bool
) -> None:
    driver, link, _ = indicator()
    link.put(reading=counts, decimals=1, reading_float=floating)
    if used:
        assert driver.read().reading_mV == pytest.approx(counts / 10)
        return
    with pytest.raises(
        DeviceError, match=rf"reading is {counts / 10:g} mV as an integer and .* as a float, so it is not used"
    ):
        driver.read()


def test_an_open_bridge_reads_nothing_whatever_the_two_readings_say() -> None:
    driver, link, _ = indicator(reading=100, reading_float=math.nan)
    link.put(status=OPEN)
    reading = driver.read()
    assert math.isnan(reading.reading_mV)
    assert (reading.sick, reading.valid) == ("bridge open", False)


# --- displays that are not renewed -----------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "stale"), [(0.3, False), (0.301, True), (100.0, True)])
def test_a_display_is_stale_when_it_was_not_renewed_though_there_was_time_for_three(
    seconds: float, stale: bool
) -> None:
    driver, link, clock = indicator(updates=7)
    assert not driver.read().sick
    clock.wait(seconds)
    reading = driver.read()
    assert reading.sick == ("display not updated" if stale else "")
    link.put(updates=8)
    assert not driver.read().sick


def test_a_reading_with_the_count_of_the_one_before_is_asked_for_once_more() -> None:
    """It may be the reply of then, which was late; on a serial line the second one has another length."""
    driver, link, _ = indicator(updates=7)
    driver.read()
    assert len(link.asked) == 1
    driver.read()
    assert len(link.asked) == 3
    link.put(updates=8)
    driver.read()
    assert len(link.asked) == 4


@pytest.mark.parametrize(
    ("before", "now", "seconds", "used"),
    [
        (100, 101, 1.0, True),
        (100, 100 + 32768, 1.0, True),  # half the numbers that the counter has
        (100, 100 + 32769, 1.0, False),
        (100, 99, 1.0, False),
        (65535, 0, 1.0, True),  # it starts over
        (0, 65535, 1.0, False),
        (100, 99, 999.9, False),
        (100, 99, 1000.0, True),  # so long that it may have come round
    ],
)
def test_a_display_that_was_renewed_less_often_than_before_is_an_old_reply(
    before: int, now: int, seconds: float, used: bool
) -> None:
    driver, link, clock = indicator(updates=before)
    driver.read()
    clock.wait(seconds)
    link.put(updates=now)
    if used:
        assert not driver.read().sick
        assert link.distrusted == 0
        return
    with pytest.raises(
        DeviceError, match=f"updated {now} times, but {before} times at the reading before; the reply is late"
    ):
        driver.read()
    assert link.distrusted == 1  # the true reply may still come


# --- settings and commands -----------------------------------------------------------------------------


COMMANDS = STRAIN_INDICATOR["command"].choices
RESULTS = STRAIN_INDICATOR["command_result"].choices


def carried_out(link: Any, clock: VirtualClock, after: float, last: str, result: str) -> None:
    """The command is done `after` s."""
    begun = clock.now_ns()

    def look(reply: Any) -> Any:
        if getattr(reply, "registers", None) and 1e-9 * (clock.now_ns() - begun) >= after:
            link.put(command="idle", last_command=COMMANDS[last], command_result=RESULTS[result])
        return reply

    link.replied = look


@pytest.mark.parametrize(
    ("last", "result", "ended"), [("zero", "refused_unstable", "refused_unstable"), ("tare", "done", "done")]
)
def test_a_command_that_was_refused_or_was_another_one_is_told(last: str, result: str, ended: str) -> None:
    driver, link, clock = indicator()
    carried_out(link, clock, 0.0, last, result)
    with pytest.raises(DeviceError, match=f"^strain indicator at .*: zero ended in {ended}; wait for a stable reading"):
        driver.command("zero")


def test_a_command_is_not_waited_for_longer_than_a_second() -> None:
    driver, _, clock = indicator()
    begun = clock.now_ns()
    with pytest.raises(DeviceError, match=r"tare was not carried out within 1 s; repeat it, or restart the indicator$"):
        driver.command("tare")
    assert clock.now_ns() - begun == pytest.approx(1e9)
