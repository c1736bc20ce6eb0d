"""The drivers against devices, and the simulated devices against clients, that share no code with them."""

from __future__ import annotations

import os
import struct
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import can
import numpy as np
import pytest
import serial
from modbus_tk import modbus_rtu
from modbus_tk.defines import HOLDING_REGISTERS
from modbus_tk.modbus import Server, Slave
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.constants import EXP_DATA_ADDRESS, EXP_DATA_VALUE
from pyModbusTCP.server import DataBank, DeviceIdentification

from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.devices.sensor_node import CanopenSensorNode
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.extend import Contract, DeviceError, sdo
from palpate.instrument.bench import links
from palpate.instrument.bench.links import FASTEST, SerialLine, TcpLink
from palpate.instrument.contracts.own import POSITIONER, SENSOR_NODE, SIGNAL_GENERATOR
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.other_stacks import answer, serving

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
    with serving(bank, device_id) as port:
        yield port, lambda name: bank.get_holding_registers(GENERATOR[name].address, GENERATOR[name].size // 2)


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

    answer(slave, IDENTIFY, identify)
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


def test_a_client_of_another_stack_reads_and_sets_every_field_and_understands_refusals(
    client: ModbusClient, sim: SimulatedBench
) -> None:
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

    assert client.read_holding_registers(0x7000, 1) is None
    assert client.last_except == EXP_DATA_ADDRESS
    assert client.write_multiple_registers(GENERATOR["amplitude"].address, [0x7FFF, 0]) is False
    assert client.last_except == EXP_DATA_VALUE


# --- a node --------------------------------------------------------------------------------------------


NODE = 5
TOGGLE, LAST = 0x10, 0x01
SEGMENT, WRITE = 0x60, 0x20
NO_OBJECT = 0x0602_0000


class ForeignNode:
    """A sensor node as its maker might write it: no canopen, its objects in a dict, samples at each SYNC."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._left = b""
        self._toggle = 0
        self._count = 0
        self._operational = False
        self.objects = {f.address: _stored(f.name) for f in SENSOR_NODE.fields}
        self.objects[sdo(0x1009)] = b"rev B"
        self.objects[sdo(0x1014)] = (0x1C0 + NODE).to_bytes(4, "little")  # of its own choice
        self.objects[sdo(0x1018, 4)] = (0xF0F0).to_bytes(4, "little")
        self.objects[sdo(0x1800, 1)] = (0x180 + NODE).to_bytes(4, "little")

    def on_message(self, message: can.Message) -> None:
        match message.arbitration_id:
            case 0x000 if message.data[1] in (0, NODE):
                self._operational, self._count = message.data[0] == 1, 0
            case identifier if identifier == 0x600 + NODE:
                self._send(0x580 + NODE, self._answer(bytes(message.data)))

    def sample(self) -> None:
        """Samples as at a SYNC, which this node produces itself."""
        if self._operational and self.objects[sdo(0x1005)][3] & 0x40:
            self._count += 1
            self._send(0x1C0 + NODE, b"\x10\x81\x11" + bytes(5))
            self.objects[sdo(0x2001)] = self._count.to_bytes(4, "little")
            self._send(0x180 + NODE, struct.pack("<4h", self._count, -self._count, 0, 32767))
            self._send(0x280 + NODE, struct.pack("<IB", self._count, 0b1000))

    def _answer(self, request: bytes) -> bytes:
        command, address = request[0], request[1:4]
        place = sdo(int.from_bytes(address[:2], "little"), address[2])
        if command & 0xE0 == SEGMENT:
            return self._segment()
        if place not in self.objects:
            return b"\x80" + address + NO_OBJECT.to_bytes(4, "little")
        if command & 0xE0 == WRITE:
            self.objects[place] = request[4 : 8 - (command >> 2 & 3)]
            return b"\x60" + address + bytes(4)
        data = self.objects[place]
        if len(data) <= 4:
            return bytes([0x43 | (4 - len(data)) << 2]) + address + data.ljust(4, b"\0")
        self._left, self._toggle = data, 0
        return b"\x41" + address + len(data).to_bytes(4, "little")

    def _segment(self) -> bytes:
        part, self._left = self._left[:7], self._left[7:]
        head = self._toggle | (7 - len(part)) << 1 | (0 if self._left else LAST)
        self._toggle ^= TOGGLE
        return bytes([head]) + part.ljust(7, b"\0")

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def _stored(name: str) -> bytes:
    field = SENSOR_NODE[name]
    if field.type == "text":
        return str(field.default).encode()
    return SENSOR_NODE.pack(name, float(field.default))


class Sampling(VirtualClock):
    """A clock on which the foreign node samples a thousand times a second."""

    def __init__(self, node: ForeignNode) -> None:
        super().__init__()
        self._node = node

    def wait(self, duration: float) -> None:
        for _ in range(round(duration * 1000)):
            self._node.sample()
        super().wait(duration)


@contextmanager
def foreign_node() -> Iterator[tuple[ForeignNode, CanopenSensorNode]]:
    with can.Bus(interface="virtual", channel="foreign") as bus:
        node = ForeignNode(bus)
        notifier = can.Notifier(bus, [node.on_message], timeout=0.01)
        link = CanLink(links.CanBus(interface="virtual", channel="foreign", timeout="10 s"))  # type: ignore[arg-type]
        link.open()
        try:
            yield node, CanopenSensorNode(link, NODE, Sampling(node))
        finally:
            link.close()
            notifier.stop()


def test_the_nodes_driver_uses_a_node_without_canopen(nothing_left_behind: None) -> None:
    with foreign_node() as (node, driver):
        driver.connect()
        assert (driver.serial, driver.simulated) == ("0000F0F0", False)
        driver.set_range(2, "500 mV")
        assert node.objects[sdo(0x2100, 2)] == b"\x01"
        recorded = driver.acquire(0.02)
        with pytest.raises(DeviceError, match="Object does not exist"):
            driver.link.upload("it", driver.link.add_node(NODE), 0x5000, 0)
    assert driver.emergencies == [b"\x10\x81\x11" + bytes(5)] * 20
    count = np.arange(1, 21)
    assert recorded.voltage[0] == pytest.approx(count * 5.0 / 32768)
    assert recorded.voltage[1] == pytest.approx(-count * 0.5 / 32768)
    assert recorded.saturated.sum(axis=1).tolist() == [0, 0, 0, 20]
