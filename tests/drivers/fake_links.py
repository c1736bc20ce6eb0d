"""Links without a wire: one device answers from its objects or registers, as a contract lays them out."""

from __future__ import annotations

import heapq
import itertools
import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from pymodbus.pdu.bit_message import (
    ReadCoilsResponse,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsResponse,
    WriteSingleCoilResponse,
)
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sensor_node import CanopenSensorNode
from palpate.drivers.links.modbus import RtuClient
from palpate.extend import Contract, DeviceError, Identity, ModbusDevice
from palpate.instrument.bench.links import SILENCE
from palpate.instrument.contracts.field import BITS, Field, Value, probe
from palpate.instrument.contracts.maps.golden_frames import crc
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.simulators.clock import VirtualClock


class Objects:
    """Stands in for a `CanLink` with one node.

    Attributes:
        held: the bytes of each object, by index and subindex.
        done: uploads, downloads and commands, in order.
        failures: raised instead of an answer, one a transfer; None: that one is answered.
        subscribed: who wants frames of an identifier.
        whole: who takes blocks, by what they would take frames with.
    """

    name = "bus"

    def __init__(self, contract: Contract, **values: Value) -> None:
        self.contract = contract
        self.held: dict[tuple[int, int], bytes] = {}
        self.done: list[tuple[Any, ...]] = []
        self.failures: list[Exception | None] = []
        self.subscribed: dict[int, Callable[..., None]] = {}
        self.whole: dict[Callable[..., None], Callable[..., None]] = {}
        self.put(**{field.name: field.default for field in contract.fields if not field.beside})
        self.put(**values)

    def put(self, **values: Value) -> None:
        """Let objects have these values: names of choices, texts, or numbers, also beyond their limits."""
        for name, value in values.items():
            field = self.contract[name]
            if field.type == "text":
                data = str(value).encode()
            else:
                data = self.contract.pack(name, field.choices[value] if isinstance(value, str) else value)
            self.held[field.index, field.subindex] = data

    def value(self, name: str) -> float:
        field = self.contract[name]
        return self.contract.decode(name, self.held[field.index, field.subindex])

    def add_node(self, node_id: int) -> int:
        return node_id

    def subscribe(self, cob_id: int, callback: Callable[..., None]) -> None:
        self.subscribed[cob_id] = callback

    def take_blocks(self, instead_of: Callable[..., None], callback: Callable[..., None]) -> None:
        self.whole[instead_of] = callback

    def send(self, cob_id: int, data: bytes) -> None:
        """A frame of the node comes to whoever wants it."""
        if cob_id in self.subscribed:
            self.subscribed[cob_id](cob_id, bytearray(data), 0.0)

    def upload(self, _who: str, node: int, index: int, subindex: int, size: int | None = None) -> bytes:
        return self._transfer(lambda: self.held[index, subindex], "upload", node, index, subindex, size)

    def download(self, _who: str, node: int, index: int, subindex: int, data: bytes) -> None:
        def write() -> bytes:
            self.held[index, subindex] = data
            return b""

        self._transfer(write, "download", node, index, subindex, data)

    def command(self, node: int, state: str) -> None:
        self.done.append(("command", node, state))

    def _transfer(self, call: Callable[[], bytes], *done: Any) -> bytes:
        self.done.append(done)
        if self.failures and (failure := self.failures.pop(0)):
            raise failure
        try:
            return call()
        except KeyError:
            raise DeviceError("node: aborted the transfer: Object does not exist") from None


DEFAULTS: dict[str, Any] = {"emergency_cob_id": 0x83, "device_name": "Palpate SN-1"}


def node(**held: Any) -> tuple[CanopenSensorNode, Any, VirtualClock]:
    """A connected driver of node 3."""
    link: Any = Objects(SENSOR_NODE, **{**DEFAULTS, **held})
    clock = VirtualClock()
    driver = CanopenSensorNode.at(DevicePlace(link, 3, None, clock))
    driver.connect()
    link.done.clear()
    return driver, link, clock


# --- Modbus --------------------------------------------------------------------------------------------


Change = Callable[[Any], Any]


class Registers:
    """Stands in for a `ModbusLink` with one device.

    Attributes:
        asked: function and arguments of each request, in order.
        failures: raised instead of an answer, one a request; None: that one is answered.
        late: what is raised after a request has been carried out, one a request.
        objects: of the identity, by number.
        replied: does something to each reply.
        written: called after each write.
    """

    name = "rack"

    def __init__(self, contract: Contract, *, serial: bool = False, **values: Value) -> None:
        self.contract = contract
        self.serial = serial
        self.words: dict[int, int] = {}
        self.tables: dict[str, dict[int, int]] = {"holding": self.words, "input": {}, "coil": {}, "discrete": {}}
        self.timing: list[dict[str, float]] = []
        self.asked: list[tuple[Any, ...]] = []
        self.failures: list[Exception | None] = []
        self.late: list[Exception] = []
        identity = contract.identity
        self.objects = {0: identity.vendor, 1: identity.product, 2: identity.revision}
        self.replied: Change = lambda reply: reply
        self.written: Callable[[], object] = lambda: None
        self.distrusted = 0
        plain = [field for field in contract.fields if not field.minimum and not field.beside]
        self.put(**{field.name: field.default for field in plain})
        self.put(**values)

    def put(self, /, **values: Value) -> None:
        """Let fields have these values: names of choices, texts, or numbers, also beyond their limits."""
        for name, value in values.items():
            field = self.contract[name]
            if field.type == "text":
                data = self.contract.encode_text(name, str(value))
            else:
                beside = {other: self.held(other) for other in field.beside}
                data = self.contract.pack(name, field.choices[value] if isinstance(value, str) else value, beside)
            words, size = self.tables[field.table], 1 if field.table in BITS else 2
            for at in range(0, len(data), size):
                word = int.from_bytes(data[at : at + size], "big")
                kept = 0
                if field.part:
                    kept = words.get(field.address, 0) & ~((1 << field.part[1]) - 1 << field.part[0])
                words[field.address + at // size] = word | kept

    def held(self, name: str) -> float:
        """What a field holds."""
        field = self.contract[name]
        size = 1 if field.table in BITS else 2
        words = (self.tables[field.table][field.address + at] for at in range(field.width))
        beside = {other: self.held(other) for other in field.beside}
        return self.contract.decode(name, b"".join(word.to_bytes(size, "big") for word in words), beside)

    def distrust(self) -> None:
        self.distrusted += 1

    def transact(self, _who: str, function: Callable[..., Any], *asked: Any, **timing: float) -> Any:
        self.timing.append(timing)
        self.asked.append((function.__name__, *asked))
        if self.failures and (failure := self.failures.pop(0)):
            raise failure
        reply = self.replied(function(self, *asked))
        if self.late:
            raise self.late.pop(0)
        return reply

    def writes(self) -> list[tuple[Any, ...]]:
        """First register and registers of each write."""
        return [asked[1:3] for asked in self.asked if asked[0] == "write_registers"]

    # --- what requests call --------------------------------------------------------------------------

    def read_holding_registers(self, address: int, *, count: int, device_id: int) -> Any:
        return ReadHoldingRegistersResponse(registers=[self.words.get(address + at, 0) for at in range(count)])

    def write_registers(self, address: int, registers: list[int], *, device_id: int) -> Any:
        self.words.update(enumerate(registers, address))
        self.written()
        return WriteMultipleRegistersResponse(address=address, count=len(registers))

    def read_input_registers(self, address: int, *, count: int, device_id: int) -> Any:
        inputs = self.tables["input"]
        return ReadInputRegistersResponse(registers=[inputs.get(address + at, 0) for at in range(count)])

    def _bits(self, table: str, address: int, count: int) -> list[bool]:
        held = self.tables[table]
        return [bool(held.get(address + at, 0)) if at < count else False for at in range(-(-count // 8) * 8)]

    def read_coils(self, address: int, *, count: int, device_id: int) -> Any:
        return ReadCoilsResponse(bits=self._bits("coil", address, count))

    def read_discrete_inputs(self, address: int, *, count: int, device_id: int) -> Any:
        return ReadDiscreteInputsResponse(bits=self._bits("discrete", address, count))

    def write_register(self, address: int, register: int, *, device_id: int) -> Any:
        self.words[address] = register
        self.written()
        return WriteSingleRegisterResponse(address=address, registers=[register])

    def write_coil(self, address: int, coil: bool, *, device_id: int) -> Any:
        self.tables["coil"][address] = coil
        self.written()
        return WriteSingleCoilResponse(address=address, bits=[coil])

    def write_coils(self, address: int, coils: list[bool], *, device_id: int) -> Any:
        self.tables["coil"].update(enumerate(coils, address))
        self.written()
        return WriteMultipleCoilsResponse(address=address, count=len(coils))

    def read_device_information(self, *, read_code: int, object_id: int, device_id: int) -> Any:
        information = {number: text.encode(errors="surrogateescape") for number, text in self.objects.items()}
        return ReadDeviceInformationResponse(read_code=read_code, information=information)


class Oven(ModbusDevice):
    contract = Contract(
        name="oven",
        title="oven",
        bus="modbus",
        identity=Identity("Acme", "OV-60", "1.2"),
        fields=(
            probe(0x00),
            Field("setpoint", 0x10, "int32", "asked for", "degC", 0.1, "rw", -10.0, 1e4, 20.0),
            Field("heater", 0x12, "uint16", "heater", access="rw", choices={"off": 0, "on": 1}),
            Field("program", 0x13, "uint16", "starts what it is told", access="rw", minimum=0, maximum=9),
            Field("start", 0x14, "uint16", "starts it", access="wo", minimum=0, maximum=9),
            Field("warmth", 0x20, "uint16", "is there", "degC", 0.1, minimum=0, maximum=100),
            Field("label", 0x30, "text", "label", access="rw", default="", length=4),
        ),
    )
    orders = frozenset({"program"})


def oven(**held: Any) -> tuple[Oven, Any]:
    link: Any = Registers(Oven.contract, **held)
    return Oven(link, 7, VirtualClock()), link


def changing(change: dict[str, Any]) -> Callable[[Any], Any]:
    """Replies with other attributes."""

    def changed(reply: Any) -> Any:
        for name, value in change.items():
            setattr(reply, name, value)
        return reply

    return changed


# --- a serial line of pure arithmetic ----------------------------------------------------------------

CHARACTER = 10  # of a character: start, eight, stop
Answers = Callable[[bytes], Iterable[tuple[float, bytes]]]


def checked(frame: bytes) -> bytes:
    """A frame with its check sum."""
    return frame + crc(frame)


class VirtualLine(RtuClient):
    """`device` gives for a request when what comes on the line: each so many s after the wire could bring it first.

    A delay may be negative: then it is a byte that nobody asked for.
    """

    def __init__(self, device: Answers, baudrate: int = 115200, timeout: float = 1.0, **settings: Any) -> None:
        super().__init__("virtual line", baudrate=baudrate, timeout=timeout, **settings)
        self.device = device
        self.speed = baudrate
        self.now = 0.0
        self._timeout = timeout
        self._coming: list[tuple[float, int, bytes]] = []
        self._numbers = itertools.count()

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        """It stays as it is."""

    def wire(self, size: float) -> float:
        """What so many characters take [s]."""
        return size * CHARACTER / self.comm_params.baudrate

    def comes(self, at: float, data: bytes) -> None:
        """`data` comes as a whole, at this time [s]."""
        heapq.heappush(self._coming, (at, next(self._numbers), data))

    def _patience(self) -> float:
        return self._timeout

    def _now(self) -> float:
        return self.now

    def _ready(self, within: float) -> bool:
        until = self.now + within
        if self._coming and self._coming[0][0] <= until:
            self.now = max(self.now, self._coming[0][0])
            return True
        self.now = until
        return False

    def _read(self) -> bytes:
        data = b""
        while self._coming and self._coming[0][0] <= self.now:
            data += heapq.heappop(self._coming)[2]
        return data

    def _write(self, request: bytes) -> int:
        first = self.now + self.wire(len(request) + SILENCE)
        for delay, data in self.device(request):
            self.comes(first + delay + (self.wire(len(data)) if delay >= 0 else 0.0), data)
        return len(request)


# --- how much memory is taken ------------------------------------------------------------------------


@contextmanager
def growth() -> Iterator[Callable[[], int]]:
    """Gives a function that tells how many bytes are taken since the block began."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        left: list[int] = []
        yield lambda: left[0]
        left.append(tracemalloc.get_traced_memory()[0] - before)
    finally:
        tracemalloc.stop()
