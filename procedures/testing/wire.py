"""Records what really travels between driver and simulator, for tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can
import pytest
from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.links.modbus import ModbusLink


@dataclass
class Wire:
    """Requests and replies of a Modbus link, as PDUs: without MBAP header, or without unit id and CRC."""

    requests: list[bytes] = field(default_factory=list)
    replies: list[bytes] = field(default_factory=list)


def listen(link: ModbusLink, monkeypatch: pytest.MonkeyPatch) -> Wire:
    """Record every request that leaves the link from now on, and its reply."""
    client = link._client
    pdu = slice(7, None) if isinstance(client, ModbusTcpClient) else slice(1, -2)
    wire = Wire()

    def trace(sending: bool, data: bytes) -> bytes:
        if sending:
            wire.requests.append(data[pdu])
            wire.replies.append(b"")
        else:  # pymodbus calls again with a longer reply until it is complete
            wire.replies[-1] = data[pdu]
        return data

    monkeypatch.setattr(client.transaction, "trace_packet", trace)
    return wire


SHORT = 0.2  # s


@contextmanager
def impatient(link: ModbusLink) -> Iterator[None]:
    """Inside, the link waits only `SHORT` for a reply; use it where no reply is expected, as a busy machine is slow."""
    client = link._client
    patient = client.comm_params.timeout_connect
    _wait_for(client, SHORT)
    try:
        yield
    finally:
        _wait_for(client, patient)


def _wait_for(client: ModbusTcpClient | ModbusSerialClient, timeout: float) -> None:
    client.comm_params.timeout_connect = timeout
    if isinstance(client, ModbusSerialClient) and client.socket is not None:
        client.socket.timeout = timeout


@contextmanager
def impatient_node(node: CanopenDevice, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Inside, the driver waits only `SHORT` for an answer; afterwards its wait for late answers stays that short."""
    short = node.link._description.model_copy(update={"timeout": SHORT})
    monkeypatch.setattr(node.link, "_description", short)
    with monkeypatch.context() as patch:
        patch.setattr(node._node.sdo, "RESPONSE_TIMEOUT", SHORT)
        yield


def frames(listener: can.BusABC) -> list[can.Message]:
    """All frames that a listener on the bus has received so far."""
    return list(iter(lambda: listener.recv(0), None))


def payloads(messages: list[can.Message], cob_id: int) -> list[bytes]:
    """The data of all frames with an identifier."""
    return [bytes(message.data) for message in messages if message.arbitration_id == cob_id]


def transfers(listener: can.BusABC, node_id: int) -> tuple[list[bytes], list[bytes]]:
    """The SDO requests to a node and its answers, in two lists, because they may overtake each other on the bus."""
    messages = frames(listener)
    return payloads(messages, 0x600 + node_id), payloads(messages, 0x580 + node_id)
