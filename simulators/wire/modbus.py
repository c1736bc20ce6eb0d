"""Modbus servers of the simulated bench: TCP on loopback sockets, RTU on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Self

from palpate.instrument.bench.links import LOOPBACK, check_loopback
from palpate.instrument.errors import BenchError, PalpateError
from palpate.instrument.own_process import Ends
from palpate.simulators.wire.device import Registers, SimulatedDevice
from palpate.simulators.wire.loop import Loop
from palpate.simulators.wire.modbus_server import Identity, SerialServer, TcpServer
from palpate.simulators.wire.relay import LineNoise, Relay
from palpate.simulators.wire.terminal import Terminal

if TYPE_CHECKING:
    from palpate.simulators.physics.stages import LineEffect

NEVER_YET = -(10**18)  # ns


class Servers:
    """All Modbus servers of a bench, on one loop. Leaving the context stops all that it started.

    Attributes:
        loop: serves them, in a thread of its own unless `stepped`: then only in the steps of its clients.
    """

    def __init__(self, loop: Loop | None = None, *, stepped: bool = False) -> None:
        self.loop = loop or Loop()
        self._stepped = stepped
        self._servers: list[TcpServer | SerialServer] = []
        self._open: list[TcpServer | Terminal] = []
        self._of_device: dict[int, TcpServer] = {}
        self._ends = Ends()

    def __enter__(self) -> Self:
        self._ends.enter_context(self.loop)
        self._ends.callback(self._close)
        if not self._stepped:
            self.loop.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def _close(self) -> None:
        with self.loop.lock:
            for each in self._open:
                each.close()

    def catch_up(self) -> None:
        """Let the servers take up all requests that have arrived up to now."""
        self.loop.step()

    @property
    def transactions(self) -> int:
        """Number of requests that have come in so far."""
        return sum(server.transactions for server in self._servers)

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
        try:
            server = TcpServer(self.loop, unit, Registers(device), _identity(device), address)
        except OSError:
            host, taken = address
            raise BenchError(
                f"cannot listen on {host}:{taken}: the port is in use, or the host is no address of this machine; give "
                "another"
            ) from None
        self._servers.append(server)
        self._of_device[id(device)] = server
        self._open.append(server)
        return server.port

    def put_between(self, device: SimulatedDevice, link: Relay) -> None:
        """From now on let requests to a device on TCP pass through `link`, which may damage them."""
        self._of_device[id(device)].link = link

    def make_noisy(self, noise: LineNoise) -> None:
        """From now on let frames of the serial line pass through `noise`, which may damage them."""
        self._terminal.make_noisy(noise)

    def serve_rtu(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> str:
        """Serve devices on one serial line, by unit id. Returns the path of the terminal that a client opens."""
        server = SerialServer(
            self.loop,
            {unit: Registers(device) for unit, device in devices.items()},
            {unit: _identity(device) for unit, device in devices.items()},
            _SerialLine(devices, timing),
        )
        self._servers.append(server)
        self._terminal = Terminal(self.loop, server, at_once=self._stepped)
        self._open.append(self._terminal)
        return self._terminal.path


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

    A wait here blocks all servers. That is right: the client waits for its reply, and nobody else moves the clock on.
    """

    def __init__(self, devices: dict[int, SimulatedDevice], timing: LineEffect | None) -> None:
        self._units = set(devices)
        self._gaps_ns = {unit: round(1e9 * device.contract.manners.gap) for unit, device in devices.items()}
        self._clock = next(iter(devices.values())).clock
        self._timing = timing
        self._replied_ns = NEVER_YET

    def lets_in(self, unit: int) -> bool:
        gap_ns = self._gaps_ns.get(unit, 0)
        return not gap_ns or self._now_ns() - self._replied_ns >= gap_ns

    def request(self, size: int) -> None:
        self._pass(size)

    def reply(self, unit: int, size: int) -> bool:
        if unit not in self._units:
            return False
        self._pass(size)
        self._replied_ns = self._now_ns()
        return True

    def _now_ns(self) -> int:
        """The time by which clients keep silences; a served clock stands still for longer than these last."""
        return time.monotonic_ns() if self._clock.served else self._clock.now_ns()

    def _pass(self, size: int) -> None:
        if self._timing is not None and self._clock.failure is None:
            with contextlib.suppress(PalpateError):  # the client that waits next is told
                self._clock.wait(self._timing.frame(size))
