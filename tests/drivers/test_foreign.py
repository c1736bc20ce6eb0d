"""The drivers against servers, and the simulated devices against clients, of other Modbus stacks."""

from __future__ import annotations

import os
import struct
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest
import serial
from modbus_tk import modbus_rtu
from modbus_tk.defines import HOLDING_REGISTERS
from modbus_tk.modbus import Server, Slave
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.constants import EXP_DATA_ADDRESS, EXP_DATA_VALUE
from pyModbusTCP.server import DataBank, DeviceIdentification, ModbusServer

from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.links import FASTEST, SerialLine, TcpLink
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.own import POSITIONER, SIGNAL_GENERATOR
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock

pytestmark = pytest.mark.filterwarnings("ignore:isSet:DeprecationWarning")  # modbus-tk's own

GENERATOR, POSITIONER = SIGNAL_GENERATOR, POSITIONER
SERIAL = b"F-77"
IDENTIFY = 43
BAUDRATE = 9600  # at which a pseudo-terminal does not tear a frame apart
Registers = Callable[[str], list[int]]  # that a field of the device holds


def registers(contract: Contract, name: str) -> list[int]:
    """What a field holds after power-on."""
    data = contract.pack(name, float(contract[name].default))
    return [int.from_bytes(data[i : i + 2]) for i in range(0, len(data), 2)]


# --- generators of other makers ------------------------------------------------------------------------


@contextmanager
def py_modbus_tcp() -> Iterator[tuple[int, Registers]]:
    """A generator on a server of pyModbusTCP: its port, and what it holds."""
    bank = DataBank()
    for field in GENERATOR.fields:
        bank.set_holding_registers(field.address, registers(GENERATOR, field.name))
    identity = GENERATOR.identity
    device_id = DeviceIdentification(
        vendor_name=identity.vendor.encode(),
        product_code=identity.product.encode(),
        major_minor_revision=identity.revision.encode(),
        objects_id={0x80: SERIAL},
    )
    server = ModbusServer("127.0.0.1", 0, no_block=True, data_bank=bank, device_id=device_id)
    server.start()
    try:
        yield (
            server._service.server_address[1],
            lambda name: bank.get_holding_registers(GENERATOR[name].address, GENERATOR[name].size // 2),
        )
    finally:
        server.stop()


def modbus_tk_device(server: Server, unit: int, contract: Contract) -> Registers:
    """Add a device to a server of modbus-tk, which leaves function 43 to whoever uses it; what it holds."""
    slave: Slave = server.add_slave(unit)
    slave.add_block("all", HOLDING_REGISTERS, 0, max(f.address + f.size // 2 for f in contract.fields))
    for field in contract.fields:
        slave.set_values("all", field.address, registers(contract, field.name))
    identity = contract.identity
    texts = {0: identity.vendor.encode(), 1: identity.product.encode(), 2: identity.revision.encode(), 0x80: SERIAL}

    def identify(request: bytes) -> bytes:
        asked = [number for number in texts if request[2] == 3 or number < 3]
        head = bytes([0x0E, request[2], 0x83, 0, 0, len(asked)])
        return head + b"".join(bytes([number, len(texts[number])]) + texts[number] for number in asked)

    slave._fn_code_map[IDENTIFY] = identify
    return lambda name: list(slave.get_values("all", contract[name].address, contract[name].size // 2))


@contextmanager
def driver(port: int) -> Iterator[SignalGenerator]:
    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=port, timeout="10 s"))  # type: ignore[arg-type]
    link.open()
    try:
        yield SignalGenerator(link, 1, VirtualClock())
    finally:
        link.close()


def test_the_generators_driver_uses_a_device_of_another_stack(nothing_left_behind: None) -> None:
    with py_modbus_tcp() as (port, held), driver(port) as generator:
        generator.connect()
        assert (generator.serial, generator.simulated) == (SERIAL.decode(), False)
        generator.sine(12.5, 3.0, -0.5)
        assert generator.read() == (12.5, 3.0, -0.5)
        raw = round(12.5 / GENERATOR["frequency"].scale)
        assert held("frequency") == [raw >> 16, raw & 0xFFFF]


# --- a positioner of another maker, on a line ----------------------------------------------------------


@contextmanager
def line() -> Iterator[tuple[str, str]]:
    """The paths of the two ends of a serial line: two pseudo-terminals, of which each hands on what it hears."""
    (one, theirs), (other, ours) = os.openpty(), os.openpty()
    carriers = [threading.Thread(target=carry, args=way) for way in ((one, other), (other, one))]
    for end in (theirs, ours):
        tty.setraw(end)
    for carrier in carriers:
        carrier.start()
    yield os.ttyname(theirs), os.ttyname(ours)
    for end in (theirs, ours):
        os.close(end)
    for carrier in carriers:
        carrier.join()
    for end in (one, other):
        os.close(end)


def carry(source: int, sink: int) -> None:
    with suppress(OSError):  # nobody holds the other end any more
        while data := os.read(source, 256):
            os.write(sink, data)


def test_the_positioners_driver_uses_a_device_of_another_stack_on_a_line(nothing_left_behind: None) -> None:
    with line() as (theirs, ours), serial.Serial(theirs, BAUDRATE) as port:
        server = modbus_rtu.RtuServer(port)
        held = modbus_tk_device(server, 2, POSITIONER)
        server.start()
        link = ModbusLink.rtu(SerialLine(port=ours, baudrate=FASTEST, timeout="10 s"))  # type: ignore[arg-type]
        link.open()
        try:
            driver = MicroPositioner(link, 2, VirtualClock())
            driver.connect()
            assert (driver.serial, driver.position()) == (SERIAL.decode(), 0.0)
            driver.set(target=2e-3, speed=1e-3, command="move")
            assert held("target") == [0, round(2e-3 / POSITIONER["target"].scale)]
        finally:
            link.close()
            server.stop()


# --- a client of another stack -------------------------------------------------------------------------


@pytest.fixture
def client(sim: SimulatedBench) -> Iterator[ModbusClient]:
    address = sim.description.links["signal_generator"]
    other = ModbusClient(address.host, address.port, 1, timeout=10.0)
    assert other.open()
    yield other
    other.close()


def test_a_client_of_another_stack_reads_and_sets_every_field(client: ModbusClient, sim: SimulatedBench) -> None:
    for field in GENERATOR.fields:
        assert client.read_holding_registers(field.address, field.size // 2) == registers(GENERATOR, field.name)
    data = GENERATOR.encode("amplitude", 1.5)
    assert client.write_multiple_registers(GENERATOR["amplitude"].address, list(struct.unpack(">2H", data)))
    assert client.write_single_register(GENERATOR["output"].address, 1)
    assert (sim.generator.settings["amplitude"], sim.generator.settings["output"]) == (1.5, 1.0)
    found = client.read_device_identification(read_code=1)
    identity = GENERATOR.identity
    assert found is not None
    assert found.objects_by_id == dict(
        enumerate(text.encode() for text in (identity.vendor, identity.product, identity.revision))
    )


def test_a_client_of_another_stack_understands_the_refusals(client: ModbusClient) -> None:
    assert client.read_holding_registers(0x7000, 1) is None
    assert client.last_except == EXP_DATA_ADDRESS
    assert client.write_multiple_registers(GENERATOR["amplitude"].address, [0x7FFF, 0]) is False
    assert client.last_except == EXP_DATA_VALUE
