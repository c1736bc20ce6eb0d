"""Servers of other Modbus stacks, which tell neither their port nor take a function of one's own by a public name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from modbus_tk.modbus import Slave
from pyModbusTCP.server import DataBank, DeviceIdentification, ModbusServer


@contextmanager
def serving(bank: DataBank, device_id: DeviceIdentification | None = None) -> Iterator[int]:
    """A server of pyModbusTCP; gives its port."""
    server = ModbusServer("127.0.0.1", 0, no_block=True, data_bank=bank, device_id=device_id)
    server.start()
    yield server._service.server_address[1]
    server.stop()


def answer(slave: Slave, function: int, reply: Callable[[bytes], bytes]) -> None:
    """Let a slave of modbus-tk answer a function that modbus-tk leaves to whoever uses it."""
    slave._fn_code_map[function] = reply
