"""The driver of a sensor node by itself: who answers, what is written, and what it notices."""

from __future__ import annotations

import pytest

from palpate.instrument.errors import DeviceError, IdentityError, LinkTimeout, RangeError
from tests.drivers.objects import node

SYNC, PRODUCES = 0x80, 0x4000_0080


# --- who answers ---------------------------------------------------------------------------------------


def test_a_node_is_known_by_its_place_and_by_what_it_says_of_itself() -> None:
    driver, link, _ = node(serial=0xBEEF, hardware_version="simulated", sync_period=0.002)
    assert (driver.name, driver.id, driver.serial) == ("sensor node 3 at bus", 3, "0000BEEF")
    assert (driver.simulated, driver.rate) == (True, 500.0)
    assert not node(hardware_version="1.0")[0].simulated
    assert sorted(link.subscribed) == [0x83, 0x183, 0x283, 0x703]


@pytest.mark.parametrize(("serial", "revision"), [(0x1234, 0x0001_0000), (0x1234, 0x0001_FFFF)])
def test_a_node_of_the_same_major_revision_is_the_contract_s(serial: int, revision: int) -> None:
    assert node(serial=serial, revision=revision)[0].serial == "00001234"


@pytest.mark.parametrize(
    ("held", "found"),
    [
        ({"vendor": 1}, "0x00000001 0x534E0001 0x00010000"),
        ({"product": 1}, "0x50414C50 0x00000001 0x00010000"),
        ({"revision": 0x0002_0000}, "0x50414C50 0x534E0001 0x00020000"),
    ],
)
def test_another_node_is_refused_with_what_it_says_of_itself(held: dict[str, int], found: str) -> None:
    with pytest.raises(
        IdentityError,
        match=f"^sensor node 3 at bus: identifies itself as {found}, the contract is for 0x50414C50 0x534E0001 ",
    ):
        node(**held)


def test_bytes_in_the_other_order_and_another_serial_number_are_refused() -> None:
    with pytest.raises(IdentityError, match="byte-order probe reads 0x78563412, should read 0x12345678; this node is"):
        node(probe=0x78563412)
    driver, link, _ = node(serial=1)
    link.put(serial=2)
    with pytest.raises(IdentityError, match="has serial number 00000002, had 00000001 before; put the first one back"):
        driver.identify()


@pytest.mark.parametrize(("cob_id", "heard"), [(0x83, True), (0x8000_0083, False)])
def test_emergencies_are_heard_unless_the_node_sends_none(cob_id: int, heard: bool) -> None:
    _, link, _ = node(emergency_cob_id=cob_id)
    assert (0x83 in link.subscribed) == heard


# --- transfers -----------------------------------------------------------------------------------------


def test_an_object_is_read_by_its_place_with_its_size() -> None:
    driver, link, _ = node(sync_period=0.0025)
    assert driver.get("sync_period") == 0.0025
    assert driver.get("range_2") == 0.0
    assert link.done == [("upload", 3, 0x1006, 0, 4), ("upload", 3, 0x2100, 2, 1)]


@pytest.mark.parametrize("data", [b"\0\0\0", b"\0\0\0\0\0"])
def test_an_object_of_another_size_is_not_used(data: bytes) -> None:
    driver, link, _ = node()
    link.held[0x2001, 0] = data
    with pytest.raises(DeviceError, match=f"sample_counter has {len(data)} bytes instead of 4, so it is not used"):
        driver.get("sample_counter")


def test_a_node_that_aborts_is_told_with_the_object_and_what_was_to_be_written() -> None:
    driver, link, _ = node()
    link.failures = [DeviceError("aborted"), DeviceError("aborted")]
    with pytest.raises(DeviceError, match=r"^aborted, reading heartbeat$") as caught:
        driver.get("heartbeat")
    assert caught.value.device == driver.name
    with pytest.raises(DeviceError, match=r"^aborted, writing heartbeat = 2 s \(0 to 60\)$"):
        driver.set("heartbeat", 2)
    assert driver.differences() == []  # it is no setting


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


def test_a_value_beyond_its_limits_is_neither_sent_nor_used() -> None:
    driver, link, _ = node()
    with pytest.raises(RangeError, match="heartbeat = 61 s is outside 0 to 60 s"):
        driver.set("heartbeat", 61)
    assert link.done == []
    link.put(heartbeat=61)
    with pytest.raises(DeviceError, match="reads heartbeat = 61 s is outside 0 to 60 s; not used"):
        driver.get("heartbeat")


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
