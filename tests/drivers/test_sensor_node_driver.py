"""The driver of a sensor node by itself: who answers, what is written, and what it notices."""

from __future__ import annotations

import pytest

from palpate.instrument.errors import DeviceError, LinkTimeout
from tests.drivers.objects import node

SYNC, PRODUCES = 0x80, 0x4000_0080


# --- transfers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("data", [b"\0\0\0", b"\0\0\0\0\0"])
def test_an_object_of_another_size_is_not_used(data: bytes) -> None:
    driver, link, _ = node()
    link.held[0x2001, 0] = data
    with pytest.raises(DeviceError, match=f"sample_counter has {len(data)} bytes instead of 4, so it is not used"):
        driver.get("sample_counter")


def test_a_read_is_tried_again_on_an_attended_bench_and_a_write_is_not() -> None:
    driver, link, _ = node()
    noticed = list[str]()
    driver.read_attempts, driver.noticed = 2, noticed.append
    link.failures = [LinkTimeout("silent")]
    driver.get("heartbeat")
    link.failures = [LinkTimeout("silent")]
    with pytest.raises(LinkTimeout):
        driver.set("heartbeat", 2)
    assert ([done[0] for done in link.done], noticed) == (["upload", "upload", "download"], ["silent; asked again"])


def test_settings_are_compared_and_written_again_as_they_were_written() -> None:
    driver, link, _ = node()
    driver.set("heartbeat", 2)
    driver.set_range(4, "500 mV")
    driver.reset_integrators()
    driver.set("sync_cob_id", PRODUCES)
    link.put(heartbeat=65.0, range_4=0, sync_cob_id=SYNC)  # as after a loss of power
    assert driver.differences() == [
        "sensor node 3 at bus: heartbeat is 65, was set to 2",
        "sensor node 3 at bus: range_4 is 0, was set to 500 mV",
    ]
    driver.restore()
    assert (driver.differences(), link.value("sync_cob_id")) == ([], SYNC)


# --- heartbeats and emergencies ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seconds", "period", "missed"),
    [(6.0, 2.0, False), (6.1, 2.0, True), (1000.0, 0.0, False)],
)
def test_a_node_is_missed_after_three_heartbeats_if_it_has_any(seconds: float, period: float, missed: bool) -> None:
    driver, _, clock = node(heartbeat=period)
    clock.wait(seconds)
    assert driver.notices() == ([f"sensor node 3 at bus: no heartbeat for {seconds:g} s"] if missed else [])


def test_a_node_that_is_heard_again_has_three_heartbeats_more() -> None:
    driver, link, clock = node(heartbeat=2.0)
    clock.wait(50.0)
    link.send(0x703, b"\x05")
    assert driver.notices() == []
    clock.wait(6.0)
    assert driver.notices() == []
    clock.wait(1.0)
    assert driver.notices() == ["sensor node 3 at bus: no heartbeat for 7 s"]


@pytest.mark.parametrize(
    ("data", "anew"), [(b"\x00", True), (b"\x80", True), (b"\x05", False), (b"\x7f", False), (b"", False)]
)
def test_a_boot_up_message_says_that_a_node_has_started_anew(data: bytes, anew: bool) -> None:
    """CiA 301: state 0; the highest bit is of another protocol."""
    driver, link, clock = node(heartbeat=2.0)
    link.send(0x703, data)
    assert driver.differences() == (["sensor node 3 at bus: has started anew"] if anew else [])
    clock.wait(10.0)
    assert (driver.notices() != []) == anew  # a boot-up is no heartbeat
    driver.restore()
    assert driver.differences() == []


def test_emergencies_are_told_once_by_their_codes() -> None:
    driver, link, _ = node(heartbeat=0)
    link.send(0x83, bytes.fromhex("01ff040000000000"))
    assert driver.notices() == ["sensor node 3 at bus: emergency 0xFF01"]
    link.send(0x83, bytes.fromhex("0000000000000000"))
    link.send(0x83, bytes.fromhex("10810000"))
    assert driver.notices() == ["sensor node 3 at bus: emergency 0x0000", "sensor node 3 at bus: emergency 0x8110"]
    assert driver.notices() == []
    assert link.done[0] == ("upload", 3, 0x1001, 0, 1)  # an answer follows what was due
