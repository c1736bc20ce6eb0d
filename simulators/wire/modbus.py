"""Modbus servers of the simulated bench: TCP on loopback sockets, RTU on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import struct
import threading
from collections.abc import Coroutine, Iterable, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, Self, TypeVar

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ModbusPDU
from pymodbus.simulator import DataType, SimData, SimDevice

from palpate.instrument.contracts.contract import Field
from palpate.instrument.errors import BenchError
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.device import Refused, SimulatedDevice
from palpate.simulators.wire.modbus_server import Identity, SerialServer, TcpServer
from palpate.simulators.wire.relay import Noise, Relay

if TYPE_CHECKING:
    from palpate.simulators.physics.stages import LineEffect

LOOPBACK = "127.0.0.1"
OUTER = 4  # bytes of a frame around its data: unit id, function code, CRC
BLOCKS = 64  # number of register blocks whose fields are cached
HOLDING_REGISTERS = (3, 6, 16)  # codes of the functions that read and write holding registers
T = TypeVar("T")


class ServerThread:
    """A thread with one event loop for all Modbus servers of a bench. Leaving the context stops all that it started."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="simulated Modbus", daemon=True)
        self._servers: list[Any] = []
        self._of_device: dict[int, TcpServer] = {}

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._run(self._shut_down())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result()

    async def _shut_down(self) -> None:
        for server in self._servers:
            await server.shutdown()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def catch_up(self) -> None:
        """Wait until the servers have taken up all requests that have arrived up to now."""
        done = threading.Event()
        # a callback scheduled twice runs after the loop has polled its sockets once
        self._loop.call_soon_threadsafe(self._loop.call_soon, done.set)
        done.wait()

    @property
    def transactions(self) -> int:
        """Number of requests that have come in so far."""
        return sum(server.transactions for server in self._servers if isinstance(server, TcpServer | SerialServer))

    def serve_tcp(
        self,
        unit: int,
        device: SimulatedDevice,
        address: tuple[str, int] = (LOOPBACK, 0),
    ) -> int:
        """Serve one device; port 0 takes any free port. Returns the port.

        Raises BenchError: the port is in use, or the host is no address of this machine.
        """

        async def start() -> int:
            server = TcpServer(_sim_device(unit, device), _identity(device), address)
            if not await server.listen():
                raise OSError
            self._servers.append(server)
            self._of_device[id(device)] = server
            transport: Any = server.transport
            port: int = transport.sockets[0].getsockname()[1]
            return port

        try:
            return self._run(start())
        except OSError:
            host, taken = address
            raise BenchError(
                f"cannot listen on {host}:{taken}: the port is in use, or the host is no address of this machine; give "
                "another"
            ) from None

    def put_between(self, device: SimulatedDevice, link: Relay) -> None:
        """From now on let requests to a device on TCP pass through `link`, which may damage them."""
        self._of_device[id(device)].link = link

    def make_noisy(self, noise: Noise) -> None:
        """From now on let frames of the serial line pass through `noise`, which may damage them."""

        async def make() -> None:
            terminal: Any = next(server.transport for server in self._servers if isinstance(server, SerialServer))
            terminal.make_noisy(noise)

        self._run(make())

    def serve_rtu(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> str:
        """Serve devices on one serial line, by unit id. Returns the path of the terminal that a client opens."""
        line = _Line(devices, timing)

        async def start() -> str:
            server = SerialServer(
                [_sim_device(unit, device) for unit, device in devices.items()],
                {unit: _identity(device) for unit, device in devices.items()},
                trace_pdu=line.trace_pdu,
                trace_packet=line.trace_packet,
            )
            await server.listen()
            self._servers.append(server)
            terminal: Any = server.transport
            path: str = terminal.path
            return path

        return self._run(start())


def _sim_device(unit: int, device: SimulatedDevice) -> SimDevice:
    registers = [SimData(f.address, count=f.size // 2, datatype=DataType.REGISTERS) for f in device.contract.fields]
    clock: VirtualClock = device.clock
    fields_at = lru_cache(BLOCKS)(partial(_within, device.contract.fields))

    async def action(
        function: int, start: int, address: int, count: int, current: list[int], values: list[int] | list[bool] | None
    ) -> ExcCodes | None:
        # never awaits: meanwhile pymodbus could answer another request
        if function not in HOLDING_REGISTERS:
            return ExcCodes.ILLEGAL_FUNCTION
        with clock.lock:
            device.requested()
            try:
                if values is None:
                    _refresh(device, fields_at(address, count), start, current)
                else:
                    numbers, texts = _checked(device, address, [int(v) for v in values])
                    if numbers:
                        device.write(numbers)
                    for name, text in texts.items():
                        device.write_text(name, text)
            except Refused as refused:
                return ExcCodes(refused.code)
        return None

    return SimDevice(id=unit, simdata=registers, action=action)


def _within(fields: Sequence[Field], address: int, count: int) -> list[Field]:
    return [f for f in fields if f.address < address + count and f.address + f.size // 2 > address]


def _refresh(device: SimulatedDevice, fields: Iterable[Field], start: int, current: list[int]) -> None:
    """Put the device's present values into the registers that are about to be read."""
    for field in fields:
        if field.type == "text":
            data = device.contract.encode_text(field.name, device.read_text(field.name))
        else:
            data = device.contract.pack(field.name, device.read(field.name))
        registers = struct.unpack(f">{len(data) // 2}H", data)
        at = field.address - start
        current[at : at + len(registers)] = registers


def _checked(device: SimulatedDevice, address: int, registers: list[int]) -> tuple[dict[str, float], dict[str, str]]:
    """Physical values and texts of a write, after the checks of a real device. Raises Refused."""
    values: dict[str, float] = {}
    texts: dict[str, str] = {}
    for field in _within(device.contract.fields, address, len(registers)):
        at = field.address - address
        if field.access == "ro":
            raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        if at < 0 or at + field.size // 2 > len(registers):  # only a part of a value, as one half of 32 bits
            raise Refused(ExcCodes.ILLEGAL_VALUE)
        data = b"".join(r.to_bytes(2, "big") for r in registers[at : at + field.size // 2])
        if field.type == "text":
            try:
                texts[field.name] = device.contract.decode_text(field.name, data)
            except ValueError:
                raise Refused(ExcCodes.ILLEGAL_VALUE) from None
            continue
        value = device.contract.decode(field.name, data)
        if not device.contract.allows(field.name, value):
            device.out_of_range()
            raise Refused(ExcCodes.ILLEGAL_VALUE)
        values[field.name] = value
    return values, texts


def _identity(device: SimulatedDevice) -> Identity:
    """A function that returns the identity objects of a device (function 43/14), read anew for each request."""

    def objects() -> dict[int, bytes]:
        identity = device.contract.identity
        texts = {
            0: identity.vendor,
            1: identity.product,
            2: identity.revision,
            4: device.contract.title,
            6: "simulated",
            0x80: device.serial,
        }
        return {number: text.encode() for number, text in texts.items()}

    return objects


class _Line:
    """The serial line itself: absent units are silent, and each frame takes time.

    A wait here blocks the servers' whole thread. That is right: the client waits for its reply, and nobody else moves
    the clock on.
    """

    def __init__(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> None:
        self._units = set(devices)
        self._clock = next(iter(devices.values())).clock
        self._timing = timing

    def trace_pdu(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            self._pass(len(pdu.encode()) + OUTER)
        return pdu

    def trace_packet(self, sending: bool, data: bytes) -> bytes:
        if sending:
            if data and data[0] not in self._units:
                return b""  # pymodbus would answer for an absent unit
            self._pass(len(data))
        return data

    def _pass(self, size: int) -> None:
        if self._timing is not None:
            self._clock.wait(self._timing.frame(size))
