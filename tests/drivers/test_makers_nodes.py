"""What a driver does for CANopen nodes that can be bought, and how one driver serves both buses."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from palpate.drivers.devices.device import MOST, DevicePlace
from palpate.drivers.devices.either_bus import EitherBus
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Identity, Manners, Mark, Pdo
from palpate.instrument.contracts.field import Field, Scaling, sdo
from palpate.instrument.errors import ConfigError, DeviceError, IdentityError, RangeError, UsageError
from palpate.simulators.clock import VirtualClock
from tests.contracts import canopen_contract
from tests.drivers.makers_thing import THING
from tests.drivers.objects import Objects
from tests.drivers.registers import Registers


class Switch(EitherBus):
    """A driver that knows fields only."""

    def on(self) -> float:
        self.give(mode=1)
        return self.get("mode")


NODE = canopen_contract(
    Field("mode", sdo(0x2000), "uint8", "mode", access="rw"),
    Field("name", sdo(0x1008), "text", "name"),
    Field("decimals", sdo(0x6132, 1), "uint8", "decimals"),
    Field("force", sdo(0x8130, 1), "int24", "force", "N", scaling=Scaling("decimals")),
    Field("burn", sdo(0x2010), "uint8", "kept", access="rw", endures=1000),
    known_by="marks",
    marks=(Mark("name", "DSRT"),),
)


def node(contract: Contract = NODE, **held: Any) -> tuple[Any, Any, VirtualClock]:
    link: Any = Objects(contract)
    link.put(name="DSRT 22", decimals=2, **held)
    link.held[0x1018, 1] = (0x5F).to_bytes(4, "little")
    clock = VirtualClock()
    return Switch.at(DevicePlace(link, 3, None, clock, DeviceKind(contract, ("canopen",), "here:Node"))), link, clock


def test_one_driver_serves_both_buses() -> None:
    free = replace(THING, manners=Manners())
    link: Any = Registers(free)
    switch = Switch.at(DevicePlace(link, 7, None, VirtualClock(), DeviceKind(free, ("modbus-rtu",), "here:Thing")))
    other, bus, _ = node()
    other.connect()
    assert (switch.on(), other.on()) == (1.0, 1.0)
    assert (link.words[30], bus.held[0x2000, 0]) == (1, b"\1")
    assert type(switch).__name__ == type(other).__name__ == "Switch"


def test_a_driver_without_a_contract_needs_a_kind() -> None:
    link: Any = Registers(THING)
    for driver in (Switch, ModbusDevice):
        with pytest.raises(UsageError, match=f"{driver.__name__} has no contract of its own"):
            driver.at(DevicePlace(link, 7, None, VirtualClock()))


def test_a_node_is_known_by_marks_and_watched_for_its_scale() -> None:
    driver, link, _ = node()
    link.held[0x8130, 1] = bytes.fromhex("80 C7 FE")
    driver.connect()
    assert driver.get("force") == -800.0
    link.put(decimals=3)
    with pytest.raises(DeviceError, match="decimals is 3, was 2 before"):
        driver.differences()
    link.put(name="SX")
    with pytest.raises(IdentityError, match="name reads 'SX', should begin with 'DSRT'"):
        driver.identify()


def test_a_node_is_known_by_the_parts_of_its_identity_that_the_contract_has() -> None:
    driver, link, _ = node(replace(NODE, known_by="identity", marks=()))
    driver.connect()
    link.held[0x1018, 1] = (0x60).to_bytes(4, "little")
    with pytest.raises(IdentityError, match="identifies itself as 0x00000060, the contract is for 0x0000005F"):
        driver.identify()


def test_a_node_s_memory_wears_as_well() -> None:
    driver, link, _ = node()
    driver.connect()
    link.done.clear()
    for number in range(MOST):
        driver.give(burn=number + 1)
        driver.give(burn=number + 1)
    assert [each[0] for each in link.done].count("download") == MOST
    with pytest.raises(DeviceError, match="burn was written"):
        driver.give(burn=99)


def test_no_object_is_written_if_one_of_the_values_is_beyond_its_limits() -> None:
    driver, link, _ = node()
    driver.connect()
    link.done.clear()
    with pytest.raises(RangeError):
        driver.give(mode=1, burn=256)
    assert link.done == []


# --- process data of a node ----------------------------------------------------------------------------

SENDS = Pdo("force", 0x280, ("force", "decimals"), index=0x1801, transmission=1, inhibit=0.01)
TAKES = Pdo("mode", 0x300, ("mode",), index=0x1401, transmission=255)
WITH_PDOS = replace(NODE, pdos=(SENDS,), receives=(TAKES,))


def piece(number: int, size: int) -> bytes:
    return number.to_bytes(size, "little")


def test_process_data_are_set_up_when_the_driver_connects_and_nothing_is_saved() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0xC000_0283, 4), piece(0x8000_0303, 4)
    driver.connect()
    done = [each[2:] for each in link.done if each[0] == "download"]
    assert done == [
        (0x1801, 1, piece(0xC000_0283, 4)),  # off, and bit 30 as it was
        (0x1A01, 0, b"\0"),
        (0x1A01, 1, piece(0x8130_0118, 4)),
        (0x1A01, 2, piece(0x6132_0108, 4)),
        (0x1A01, 0, b"\2"),
        (0x1801, 2, b"\1"),
        (0x1801, 3, piece(100, 2)),
        (0x1801, 1, piece(0x4000_0283, 4)),
        (0x1401, 1, piece(0x8000_0303, 4)),
        (0x1601, 0, b"\0"),
        (0x1601, 1, piece(0x2000_0008, 4)),
        (0x1601, 0, b"\1"),
        (0x1401, 2, b"\xff"),
        (0x1401, 1, piece(0x303, 4)),
    ]
    assert ("command", 3, "PRE-OPERATIONAL") in link.done
    assert driver.differences() == []
    driver.save()
    assert link.done[-1] == ("download", 3, 0x1010, 1, b"save")


def test_process_data_that_a_restart_has_reset_are_set_up_again() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0x283, 4), piece(0x303, 4)
    driver.connect()
    driver.start()
    driver.watch(127, 0.1)
    assert link.held[0x1016, 1] == bytes.fromhex("64 00 7F 00")
    link.held[0x1A01, 1], link.held[0x1016, 1] = piece(0x6000_0008, 4), bytes(4)
    assert driver.differences() == [
        "node 3 at bus: PDO force is no longer set up", "node 3 at bus: its heartbeat consumer is no longer set",
    ]  # fmt: skip
    driver.restore()
    assert (driver.differences(), link.done.count(("command", 3, "OPERATIONAL"))) == ([], 2)


def test_a_node_that_does_not_take_a_mapping_is_told_with_its_object() -> None:
    driver, link, _ = node(WITH_PDOS)
    link.held[0x1801, 1], link.held[0x1401, 1] = piece(0x283, 4), piece(0x303, 4)
    download = link.download

    def refuses(who: str, number: int, index: int, subindex: int, data: bytes) -> None:
        if (index, subindex) == (0x1A01, 1):
            raise DeviceError("node: aborted the transfer: 06040041")
        download(who, number, index, subindex, data)

    link.download = refuses
    with pytest.raises(DeviceError, match="writing 1A01h:1 for PDO force; the node does not take this, check its map"):
        driver.connect()
    assert link.held[0x1801, 1] == piece(0x8000_0283, 4)  # it stays off


@pytest.mark.parametrize(
    ("pdo", "message"),
    [
        (replace(SENDS, index=0x1401), "PDO force: index = 5121 is outside 0x1800 to 0x19FF"),
        (replace(SENDS, transmission=256), "PDO force: transmission = 256 is outside 0 to 255"),
        (replace(SENDS, inhibit=7.0), "PDO force: inhibit = 7 is outside 0 to 6.5535"),
    ],
)
def test_process_data_that_no_node_has_are_refused(pdo: Pdo, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        replace(NODE, pdos=(pdo,))


def test_a_contract_whose_process_data_are_not_set_up_has_the_digest_that_it_had() -> None:
    fields = (
        Field("mode", sdo(0x2000), "uint8", "mode", access="rw"),
        Field("force", sdo(0x8130, 1), "int16", "f", "N"),
    )
    plain = canopen_contract(*fields, pdos=(Pdo("force", 0x280, ("force",)),))
    assert plain.digest() == "2b57e1e9f52cfaf8341e03021ae933bbc5305ec4b44e49061fca6b57b1e28981"
    assert replace(plain, pdos=(replace(SENDS, fields=("force",)),)).digest() != plain.digest()


def test_a_node_known_by_its_identity_has_numbers_in_it() -> None:
    with pytest.raises(ConfigError, match=r"known by vendor, product and revision \['Baumer'\]; a node tells numbers"):
        replace(NODE, known_by="identity", marks=(), identity=Identity("Baumer", "", ""))
