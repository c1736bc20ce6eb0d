"""A load indicator whose words are in the other order than its map says: no reading of it passes for a right one."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from pyModbusTCP.server import DataBank, ModbusServer

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.load_indicator import IndicatorReading, MappedLoadIndicator
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.kinds import kind_in_file
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.bench.role_maps import LoadIndicatorSettings
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock
from tests.shares import first_of

NET, STATUS = 10, 20
MAP = """
[device]
name = "scale"
title = "Scale"
bus = "modbus"
links = ["modbus-tcp"]
vendor = "Nobody"
known_by = "nothing"
[field.net]
address = 10
type = "{type}"
meaning = "net load"
unit = "N"
{more}
[field.status]
address = 20
type = "uint16"
meaning = "status"
bits = {{ stable = 0 }}
[role.load_indicator]
reading = "net"
status = "status"
stable = "stable"
rate = 100.0
"""
FORMATS = {"float32": "f", "int32": "i", "float64": "d"}
LOADS = (1.234, -3.21, 100.37, -0.017)


class Scale:
    """A scale that shows loads in newtons, on a server of pyModbusTCP, and the driver of a map for it."""

    def __init__(self, stack: ExitStack, folder: Path, type_: str, more: str = "", swapped: bool = False) -> None:
        self._bank, self._type, self._swapped = DataBank(), type_, swapped
        server = ModbusServer("127.0.0.1", 0, no_block=True, data_bank=self._bank)
        server.start()
        stack.callback(server.stop)
        file = folder / "scale.toml"
        file.write_text(MAP.format(type=type_, more=more), encoding="utf-8")
        port = server._service.server_address[1]
        link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=port, timeout="5 s"))  # type: ignore[arg-type]
        link.open()
        stack.callback(link.close)
        settings = LoadIndicatorSettings(span=10.0, resolution=0.001, bandwidth="40 Hz")  # type: ignore[arg-type]
        self.driver: Any = MappedLoadIndicator.at(
            DevicePlace(link, 1, settings, VirtualClock(), kind_in_file(file), "LAB-1")
        )
        self.noticed: list[str] = []
        self.driver.noticed = self.noticed.append
        self.driver.set_up(settings, 2.0)
        self.driver.track(0.01)
        self._bank.set_holding_registers(STATUS, [1])

    def show(self, load: float) -> None:
        value = load if self._type.startswith("float") else round(1e3 * load)
        self.hold(struct.pack(f">{FORMATS[self._type]}", value))

    def hold(self, data: bytes) -> None:
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        self._bank.set_holding_registers(NET, words[::-1] if self._swapped else words)

    def read(self, load: float) -> IndicatorReading:
        self.show(load)
        found: IndicatorReading = self.driver.read()
        return found


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize(("type_", "more"), [("float32", ""), ("int32", "scale = 0.001"), ("float64", "")])
@pytest.mark.parametrize("load", first_of(LOADS))
def test_a_reading_with_swapped_words_is_refused_or_in_doubt(
    type_: str, more: str, load: float, stack: ExitStack, tmp_path: Path
) -> None:
    scale = Scale(stack, tmp_path, type_, more, swapped=True)
    try:
        found = scale.read(load)
    except DeviceError as error:
        assert f"its words come in the other order ({load:g} N)" in str(error)
    else:
        assert f"in the other order {load:g} N: which is right is not told yet" in found.doubt


def test_a_doubt_is_one_incident_until_it_is_told_what_to_read_and_ends_with_a_reading_that_tells(
    stack: ExitStack, tmp_path: Path
) -> None:
    scale = Scale(stack, tmp_path, "float32")
    assert (scale.read(0.0).doubt, scale.noticed) == ("", [])  # the same in both orders
    doubtful = struct.unpack(">f", bytes.fromhex("BD71 42C8"))[0]  # 100.37 with its words swapped
    for _ in range(2):
        assert scale.read(doubtful).doubt
    assert len(scale.noticed) == 1
    assert "compare with the display, or change the load until a reading tells" in scale.noticed[0]
    scale.driver.track(0.01)
    assert scale.read(doubtful).doubt
    assert len(scale.noticed) == 2
    found = scale.read(2.5)
    assert (found.valid, found.reading_mV, found.doubt) == (True, 25.0, "")
    assert scale.read(doubtful).doubt == ""
    assert len(scale.noticed) == 2


@pytest.mark.slow
def test_readings_that_differ_decide_soon(stack: ExitStack, tmp_path: Path) -> None:
    for number, (type_, more) in enumerate((("float32", ""), ("int32", "scale = 0.001"))):
        folder = tmp_path / str(number)
        folder.mkdir()
        right = Scale(stack, folder, type_, more)
        doubts = [right.read(load).doubt for load in LOADS]
        assert not any(doubts[1:])
        swapped = Scale(stack, folder, type_, more, swapped=True)
        with pytest.raises(DeviceError, match="its words come in the other order"):
            for load in LOADS:
                swapped.read(load)


def test_what_is_no_load_in_either_order_is_refused_with_what_to_look_at(stack: ExitStack, tmp_path: Path) -> None:
    scale = Scale(stack, tmp_path, "float32")
    for data in ("7F7F FFFF", "7CF0 0000", "FF7F FFFF", "5000 0000"):
        scale.hold(bytes.fromhex(data))
        with pytest.raises(DeviceError, match=r"N, which is no load; check type, address and scale .* as `missing`"):
            scale.driver.read()


@pytest.mark.parametrize("missing", ["0x7F7FFFFF", "3.4028234663852886e38"])
def test_a_value_that_says_that_there_is_no_reading_is_none(missing: str, stack: ExitStack, tmp_path: Path) -> None:
    scale = Scale(stack, tmp_path, "float32", f"missing = [{missing}]")
    scale.hold(bytes.fromhex("7F7F FFFF"))
    assert not scale.driver.read().valid
