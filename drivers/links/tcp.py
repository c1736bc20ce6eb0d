"""The client's end of a Modbus TCP connection."""

from __future__ import annotations

import select
import socket
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ConnectionException


class TcpClient(ModbusTcpClient):
    """pymodbus' client, which also looks for the end of the connection before it sends anything.

    Gateways and small devices close a connection on which nobody has asked anything for a while. A request that is sent
    into it is lost, and whether it was carried out can no longer be told. So the end is looked for first, and the
    request is sent once, over a new connection. The same is done where bytes have come that nobody asked for: they
    cannot be the reply to a request that is yet to be sent.

    `failure` is why the last attempt to connect failed; None: it did not.
    """

    failure: OSError | None = None

    def __init__(self, host: str, **settings: Any) -> None:
        super().__init__(host, retries=0, **settings)

    def connect(self) -> bool:
        """Connect, if it is not connected; returns whether it is. Raises ValueError: no host can have this name."""
        if self.socket is not None:
            return True
        where = self.comm_params
        self.failure = None
        try:
            self.socket = socket.create_connection((where.host, where.port), timeout=where.timeout_connect)
        except OSError as error:
            self.failure = error
        return self.socket is not None

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Send a request, once. Raises ConnectionException: there is no connection, or it broke."""
        if self.socket is not None and self._over(self.socket):
            self.close()  # type: ignore[no-untyped-call]
            if not self.connect():
                raise ConnectionException(str(self))
        sent: int = super().send(request, addr)
        return sent

    def _over(self, connection: socket.socket) -> bool:
        """Whether the other end has closed the connection, or has sent what nobody asked for."""
        looked = select.poll()
        looked.register(connection, select.POLLIN)
        return bool(looked.poll(0))
