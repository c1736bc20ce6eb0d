"""A Modbus device that has all that makers' devices have, with a driver and without a wire."""

from __future__ import annotations

from typing import Any

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Command, Condition, Manners, Mark
from palpate.instrument.contracts.field import Field, Scaling
from palpate.simulators.clock import VirtualClock
from tests.contracts import modbus_contract
from tests.drivers.registers import Registers

# a load indicator in the manner of LAUMAS, a supply in that of EA, and a drive, in one
FIELDS = (
    Field("type", 1, "uint16", "type of the device"),
    Field("serial", 3, "uint16", "serial number"),
    Field("order", 5, "uint16", "order", access="wo", function=6),
    Field("status", 6, "uint16", "status", bits={"negative": 7, "stable": 11}),
    Field("gross", 7, "uint32", "weight", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("more", 9, "uint64", "net and peak"),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("unit", 14, "uint16", "unit", part=(8, 8), choices={"kg": 0, "N": 5}, access="rw"),
    Field("polarity", 14, "uint16", "polarity", part=(0, 8), choices={"bipolar": 0, "unipolar": 1}, access="rw"),
    Field("span", 16, "uint16", "span", "N", scaling=Scaling("decimals"), access="rw", endures=10_000),
    Field("average", 18, "int32", "triggered average", missing=(99999,), maximum=5000),
    Field("level", 20, "uint16", "filter", access="rw", function=6),
    Field("mode", 30, "uint16", "mode", access="rw"),
    Field("place", 31, "int32", "place", access="rw"),
    Field("gone", 40, "uint16", "state of the order"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw", choices={"off": 0, "on": 1}),
    Field("output", 405, "bool", "output", table="coil", access="rw", choices={"off": 0, "on": 1}),
    Field("closed", 5, "bool", "contact", table="discrete"),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, offset=-40.0, table="input"),
)
COMMANDS = (
    Command("remote", "remote", "on"),
    Command("arm", "order", 7, after=("remote",)),
    Command("tare", "order", 1, ("remote", "arm"), Condition("gone", (2,), 0x0F), Condition("gone", (8,)), 0, 0.5),
)
THING = modbus_contract(
    *FIELDS, known_by="marks", marks=(Mark("type", 24),), serial="serial", commands=COMMANDS,
    manners=Manners(gap=0.005, together=(("mode", "place"),)),
)  # fmt: skip
GOOD: dict[str, Any] = {"type": 24, "serial": 77, "decimals": 2, "unit": "N", "average": 12}


def made(contract: Contract = THING, inventory: str = "", **held: Any) -> tuple[ModbusDevice, Any, VirtualClock]:
    link: Any = Registers(contract)
    link.put(**{name: value for name, value in {**GOOD, **held}.items() if contract.has(name)})
    clock = VirtualClock()
    kind = DeviceKind(contract, ("modbus-rtu",), "here:Thing")
    return ModbusDevice.at(DevicePlace(link, 7, None, clock, kind, inventory)), link, clock
