"""Drivers of makers' devices against their twins, over a TCP connection and a serial line."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.declaration import Command, Condition, Manners, Mark
from palpate.instrument.contracts.field import Field, Scaling
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.modbus import Servers
from tests.contracts import modbus_contract

THING = modbus_contract(
    Field("kind", 0, "uint16", "kind"),
    Field("number", 3, "uint16", "serial number"),
    Field("status", 6, "uint16", "status", bits={"negative": 7, "ready": 3}),
    Field("load", 7, "uint32", "load", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("more", 9, "uint64", "net and peak"),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("order", 20, "uint16", "order", access="rw", choices={"none": 0, "start": 1}, function=6),
    Field("place", 30, "int32", "place", access="rw", words="little"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw"),
    Field("output", 403, "bool", "output", table="coil", access="rw"),
    Field("closed", 5, "bool", "contact", table="discrete"),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, table="input"),
    known_by="marks",
    marks=(Mark("kind", 7),),
    serial="number",
    commands=(Command("start", "order", "start", done=Condition("status", (0x8,), 0x8), clear="none"),),
    manners=Manners(gap=0.004, units=(0, 247), most_read=8),
)


class Thing(Twin):
    def carry_out(self, command: Command) -> None:
        pass


@pytest.fixture(params=["tcp", "rtu"])
def wired(codec: str, request: pytest.FixtureRequest) -> Iterator[tuple[ModbusDevice, Any, VirtualClock]]:
    """A driver on a link of either kind, the twin that it drives at unit 0, and the clock of both."""
    rig: Any = None
    kind: Any = SimpleNamespace(contract=THING)
    clock = VirtualClock()
    thing = Thing.at(SimulatedPlace(clock, rig, 0, "SIM-TH-0003", None, kind, lambda _role: None))
    with Servers() as servers:
        if request.param == "tcp":
            link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=servers.serve_tcp(0, thing), timeout="1 s"), clock)  # type: ignore[arg-type]
        else:
            line = SerialLine(port=servers.serve_rtu({0: thing}, None), timeout="0.5 s")  # type: ignore[arg-type]
            link = ModbusLink.rtu(line, clock)
        link.open()
        try:
            yield ModbusDevice(link, 0, clock, THING), thing, clock
        finally:
            link.close()


def test_a_driver_and_a_twin_understand_each_other_in_all_that_a_contract_says(wired: Any) -> None:
    driver, thing, clock = wired
    thing.settings |= {"status": 0x80, "decimals": 2.0, "heat": 21.5, "closed": 1.0, "load": -12.34}
    driver.identify()
    assert driver.serial == "3"
    assert driver.get_many("load", "heat", "closed") == [-12.34, 21.5, 1.0]
    driver.set(place=-70_000)
    driver.set(remote=1)
    driver.set(output=1, remote=0)
    assert driver.get_many("place", "remote", "output") == [-70_000, 0, 1]
    driver.command("start")
    assert thing.settings["order"] == 0.0
    assert driver.differences() == []
    assert clock.now_ns() >= 4_000_000
    thing.settings["decimals"] = 3.0
    with pytest.raises(DeviceError, match="decimals is 3, was 2 before"):
        driver.get("load")


@pytest.mark.parametrize("wired", ["rtu"], indirect=True)
def test_a_served_bench_measures_silences_by_the_wall_clock(
    wired: tuple[ModbusDevice, Any, VirtualClock], monkeypatch: pytest.MonkeyPatch
) -> None:
    device, _, clock = wired
    now = itertools.count(0, 4_000_000)  # ns; each look at the clock is a silence later
    wall = SimpleNamespace(monotonic_ns=lambda: next(now), monotonic=time.monotonic)
    monkeypatch.setattr("palpate.simulators.wire.modbus.time", wall)
    clock.served = True
    device.link._clock = SimpleNamespace(wait=lambda _duration: None)  # type: ignore[assignment]  # it stands still here
    device.get("heat")
    device.get("heat")
