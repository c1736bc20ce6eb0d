"""Modbus servers of the simulated bench: TCP on loopback sockets, RTU on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import threading
import time
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any, Self, TypeVar

from pymodbus.pdu import ModbusPDU

from palpate.instrument.bench.links import LOOPBACK, check_loopback
from palpate.instrument.errors import BenchError, PalpateError
from palpate.instrument.own_process import Ends, close_in_child, watched
from palpate.simulators.wire.device import Registers, SimulatedDevice
from palpate.simulators.wire.modbus_server import Identity, SerialServer, TcpServer
from palpate.simulators.wire.relay import LineNoise, Relay

if TYPE_CHECKING:
    from palpate.simulators.physics.stages import LineEffect

OUTER = 4  # bytes of a frame around its data: unit id, function code, CRC
NEVER_YET = -(10**18)  # ns
T = TypeVar("T")


class ServerThread:
    """A thread with one event loop for all Modbus servers of a bench. Leaving the context stops all that it started."""

    def __init__(self) -> None:
        selector = selectors.DefaultSelector()
        close_in_child(selector, watched)
        self._loop = asyncio.SelectorEventLoop(selector)
        self._thread = threading.Thread(target=self._loop.run_forever, name="simulated Modbus", daemon=True)
        self._servers: list[Any] = []
        self._of_device: dict[int, TcpServer] = {}
        self._ends = Ends()

    def __enter__(self) -> Self:
        self._thread.start()
        self._ends.callback(self._stop)
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def _stop(self) -> None:
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

        Raises BenchError: the port is in use, the host is no address of this machine, or loopback is down.
        """

        check_loopback(address[0])

        async def start() -> int:
            server = TcpServer(unit, Registers(device), _identity(device), address)
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

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on let frames of the serial line pass through `noise`, which may damage them."""

        async def make() -> None:
            terminal: Any = next(server.transport for server in self._servers if isinstance(server, SerialServer))
            terminal.make_noisy(noise)

        self._run(make())

    def serve_rtu(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> str:
        """Serve devices on one serial line, by unit id. Returns the path of the terminal that a client opens."""
        line = _SerialLine(devices, timing)

        async def start() -> str:
            server = SerialServer(
                {unit: Registers(device) for unit, device in devices.items()},
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


class _SerialLine:
    """The serial line itself: absent units are silent, each frame takes time, and who is asked too soon hears nothing.

    A wait here blocks the servers' whole thread. That is right: the client waits for its reply, and nobody else moves
    the clock on.
    """

    def __init__(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> None:
        self._units = set(devices)
        self._gaps_ns = {unit: round(1e9 * device.contract.manners.gap) for unit, device in devices.items()}
        self._clock = next(iter(devices.values())).clock
        self._timing = timing
        self._replied_ns = NEVER_YET

    def trace_pdu(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            self._pass(len(pdu.encode()) + OUTER)
        return pdu

    def trace_packet(self, sending: bool, data: bytes) -> bytes:
        if not sending:
            gap_ns = self._gaps_ns.get(data[0], 0) if data else 0
            return data if not gap_ns or self._now_ns() - self._replied_ns >= gap_ns else b""
        if data and data[0] not in self._units:
            return b""  # pymodbus would answer for an absent unit
        self._pass(len(data))
        self._replied_ns = self._now_ns()
        return data

    def _now_ns(self) -> int:
        """The time by which clients keep silences; a served clock stands still for longer than these last."""
        return time.monotonic_ns() if self._clock.served else self._clock.now_ns()

    def _pass(self, size: int) -> None:
        if self._timing is not None and self._clock.failure is None:
            with contextlib.suppress(PalpateError):  # the client that waits next is told
                self._clock.wait(self._timing.frame(size))
