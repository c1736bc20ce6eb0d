"""Modbus links; the only import of pymodbus in the drivers."""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Self

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

from palpate.drivers.clock import Clock, WallClock
from palpate.drivers.links.rtu import LARGEST_REPLY, RtuClient
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.bench.usual import TcpAddress
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout
from palpate.instrument.own_process import OwnLock, close_in_child

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # its warnings would go to stderr; we raise

EXCEPTIONS = {
    1: "illegal function", 2: "illegal address", 3: "illegal value", 4: "device failure", 5: "acknowledge",
    6: "device busy", 7: "negative acknowledge", 8: "memory parity error", 10: "gateway path unavailable",
    11: "gateway target did not respond",
}  # fmt: skip
CHECK = "correct the address, or check power and cable"
LARGEST_FRAME = 256  # bytes on a serial line


class _StrictDecoder(DecodePDU):
    """A decoder that refuses odd byte counts, cut-off texts and surplus data, which pymodbus' own accepts."""

    def decode(self, frame: bytes) -> ModbusPDU | None:
        """The reply, if encoding it again gives the same bytes; each object of an identity must come once."""
        reply = super().decode(frame)
        if isinstance(reply, ReadDeviceInformationResponse):
            if not all(isinstance(text, bytes) for text in reply.information.values()):
                return None
            reply.number_of_objects = 0  # encoding counts them again
        try:
            return reply if reply is not None and frame == bytes([reply.function_code]) + reply.encode() else None
        except (struct.error, ValueError, ModbusException):  # raised for functions that are never requested
            return None


def _bounded(sending: bool, data: bytes) -> bytes:
    """Pass received bytes of a reply on. Raises ModbusIOException: there are more than any reply has."""
    if len(data) > LARGEST_REPLY:
        raise ModbusIOException(f"more than {LARGEST_REPLY} bytes")
    return data


class ModbusLink:
    """One TCP connection or one serial line, shared by the devices on it under one lock.

    pymodbus is asked for no retries: a write that timed out may have been carried out, so whether to
    repeat it is the caller's decision. After a time-out, or a signal in the middle, a reply may still be on
    its way; on a serial line it would answer the next request. The link is therefore opened afresh, and a
    serial line is listened to until it has been silent for a whole time-out before it is used again.
    """

    def __init__(self, name: str, client: ModbusTcpClient | ModbusSerialClient, clock: Clock | None = None) -> None:
        """Make a link, closed. `clock`: keeps the silence that a device wants before a request; None: wall clock."""
        self.name = name
        self._client = client
        self._clock = clock or WallClock()
        self._lock = OwnLock()
        close_in_child(client, lambda found: [found.socket.fileno()] if found.socket else [])
        self._reply_due = False
        self._heard: Callable[[bool, bytes], object] = lambda _sent, _data: None
        self._came = b""
        client.transaction.framer.decoder = _StrictDecoder(is_server=False)
        client.transaction.trace_packet = _bounded

    @property
    def serial(self) -> bool:
        """Whether it is a serial line."""
        return isinstance(self._client, ModbusSerialClient)

    def tap(self, heard: Callable[[bool, bytes], object]) -> None:
        """From now on call `heard` with each request before it is sent (True), and with all bytes of its reply."""

        def trace(sending: bool, data: bytes) -> bytes:
            if sending:
                heard(True, data)
            else:
                self._came = data
            return _bounded(sending, data)

        self._heard = heard
        self._client.transaction.trace_packet = trace

    @classmethod
    def tcp(cls, address: TcpAddress | TcpLink, clock: Clock | None = None) -> Self:
        client = ModbusTcpClient(address.host, port=address.port, timeout=address.timeout, retries=0)
        return cls(f"{address.host}:{address.port}", client, clock)

    @classmethod
    def rtu(cls, line: SerialLine, clock: Clock | None = None) -> Self:
        client = RtuClient(
            line.port, baudrate=line.baudrate, parity=line.parity, stopbits=line.stopbits, timeout=line.timeout
        )
        return cls(line.port, client, clock)

    def open(self) -> None:
        """Connect. Raises LinkError: nothing answers at the address."""
        with self._lock:
            self._connect()

    def close(self) -> None:
        with self._lock:
            self._drop()

    def _drop(self) -> None:
        self._client.close()  # type: ignore[no-untyped-call]

    def _connect(self) -> None:
        if self._reply_due:
            self._drop()
        try:
            connected = self._client.connect()
        except ValueError as error:  # the host name is malformed
            raise LinkError(f"{self.name} is no address: {error}; correct it in the bench file") from None
        if not connected:
            raise LinkError(self._refusal())
        if self._reply_due and isinstance(self._client, ModbusSerialClient):
            self._await_silence(self._client)
        self._reply_due = False

    def _refusal(self) -> str:
        """Why the link cannot be opened, which pymodbus does not say."""
        try:
            os.close(os.open(os.devnull, os.O_RDONLY))
        except OSError as error:
            return f"{self.name} cannot be opened: {error.strerror} in this program; raise the limit with ulimit -n"
        if not isinstance(self._client, ModbusSerialClient):
            return f"nothing answers at {self.name}; {CHECK}"
        if not Path(self.name).exists():
            return f"there is no serial port {self.name}; {CHECK}"
        return (
            f"serial port {self.name} is in use by another program, may not be opened, or does not take these "
            f"settings; {CHECK}"
        )

    def _why_none(self) -> str:
        """A possible reason why no valid answer came, with its remedy."""
        client = self._client
        if not isinstance(client, RtuClient):
            return "check power, cable and unit id"
        if client.too_soon:
            return (
                f"{client.too_soon} bytes came sooner than {client.speed} bit/s can bring them; look for a device that "
                "talks unasked, and give the line its true baudrate"
            )
        return "check power, cable, baud rate and unit id"

    def _await_silence(self, line: ModbusSerialClient) -> None:
        heard = 0
        try:
            while heard <= LARGEST_FRAME:
                late = line.recv(None)
                if not late:
                    return
                heard += len(late)
        except ConnectionException as error:
            raise LinkError(f"{self.name} is lost; check cable and power") from error
        raise LinkError(f"{self.name}: the line does not fall silent; look for a device that babbles")

    @property
    def _timeout(self) -> float:
        timeout: float = self._client.comm_params.timeout_connect
        return timeout

    @contextmanager
    def _patient(self, timeout: float) -> Iterator[None]:
        """A context in which a reply may take so long [s]."""
        params, before = (self._client.comm_params, self._client.transaction.comm_params), self._timeout
        try:
            for each in params:
                each.timeout_connect = timeout
            yield
        finally:
            for each in params:
                each.timeout_connect = before

    def distrust(self) -> None:
        """Called when a reply did not belong to its request. The true one may still come, as after a time-out."""
        self._reply_due = True

    def transact(
        self, who: str, request: Callable[..., ModbusPDU], *args: object, gap: float = 0.0, responds: float = 0.0
    ) -> ModbusPDU:
        """Send one request and return its reply, which is never an exception response.

        Args:
            who: name of the device, for messages.
            request: makes the request, such as `read_registers`.
            args: its arguments.
            gap: silence that the device wants before the request [s], which is waited by the bench's clock.
            responds: time that the device may take until it replies, if it is longer than the link's time-out [s].

        Raises:
            LinkTimeout, LinkError: no reply, or no connection.
            DeviceError: the device answered with an exception response.
        """
        with self._lock:
            if self._reply_due:
                try:
                    self._connect()
                except LinkError as error:
                    raise LinkError(f"{who}: {error}") from None
            if gap:
                self._clock.wait(gap)
            self._reply_due = True
            patience = max(responds, self._timeout)
            try:
                with self._patient(patience) if responds else nullcontext():
                    reply = request(self._client, *args)
            except ConnectionException as error:
                raise LinkError(f"{who}: the connection to {self.name} is lost; check cable and power") from error
            except ModbusIOException as error:
                raise LinkTimeout(
                    f"{who}: no valid answer on {self.name} within {patience:g} s; {self._why_none()}"
                ) from error
            except (ModbusException, OSError) as error:
                raise LinkError(f"{who}: {self.name} failed: {error}; check cable and power") from error
            finally:
                if came := self._came:
                    self._came = b""
                    self._heard(False, came)
            self._reply_due = False
        if reply.isError():
            code = reply.exception_code
            raise DeviceError(f"{who}: answered exception {code}, {EXCEPTIONS.get(code, 'unknown')}", code=code)
        return reply
