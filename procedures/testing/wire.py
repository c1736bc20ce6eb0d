"""Records what really travels between driver and simulator, for tests."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import can
import pytest
from pymodbus.client import ModbusTcpClient

from palpate.drivers.bench import Bench
from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.links.can import CanLink, FrameCallback
from palpate.drivers.links.modbus import ModbusLink, read_identity, write_registers
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Pdo
from palpate.instrument.contracts.field import sdo
from palpate.instrument.errors import BenchError


@dataclass
class Wire:
    """Requests and replies of a Modbus link, as PDUs: without MBAP header, or without unit id and CRC."""

    requests: list[bytes] = field(default_factory=list)
    replies: list[bytes] = field(default_factory=list)


def listen(link: ModbusLink, monkeypatch: pytest.MonkeyPatch) -> Wire:
    """Record every request that leaves the link from now on, and its reply."""
    client = link.client
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
    settings = link.client.comm_params
    patient = settings.timeout_connect
    settings.timeout_connect = SHORT
    try:
        yield
    finally:
        settings.timeout_connect = patient


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


# -------------------------------------------------------------------------------------------------------
# Keeps the latest messages on the links of a bench, and shows them with the contracts' names, values and units

SPAN = 2.0  # s of bench time
MOST = 10_000  # number of messages that are kept
BROADCAST = 0x7F  # bits of a COB-ID that hold the node id


@dataclass(frozen=True, slots=True)
class TrafficEntry:
    """One transaction or frame.

    Attributes:
        time_ns: bench time [ns].
        who: name of the device.
        verb: what was done: "read", "write", "identify", "frame" (from the device), "send" (a frame to it), or an NMT
            command.
        address: register address, object address, or COB-ID.
        data: bytes as on the wire: big-endian registers, or an object's or frame's bytes.
        trouble: message of the error; empty: it succeeded.
    """

    time_ns: int
    who: str
    verb: str
    address: int
    data: bytes
    trouble: str = ""


class Traffic:
    """Listens to all links of a bench; make it before the bench is opened."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._messages: deque[TrafficEntry] = deque(maxlen=MOST)
        self._contracts: dict[str, Contract] = {device.name: device.contract for device in bench.devices}
        links = {id(device.link): device.link for device in bench.devices}
        for link in links.values():
            if isinstance(link, CanLink):
                self._listen_can(link)
            else:
                self._listen_modbus(link)

    def _keep(self, who: str, verb: str, address: int, data: bytes, trouble: str = "") -> None:
        self._messages.append(TrafficEntry(self._bench.clock.now_ns(), who, verb, address, data, trouble))

    def _answered(self, who: str, verb: str, address: int, sent: bytes, ask: Callable[[], Any]) -> Any:
        """The result of `ask`; the message is kept with the sent bytes or, if there are none, with the reply."""
        try:
            reply = ask()
        except BenchError as error:
            self._keep(who, verb, address, sent, str(error))
            raise
        got = reply if isinstance(reply, bytes) else _registers(getattr(reply, "registers", []))
        self._keep(who, verb, address, sent or got)
        return reply

    def _listen_modbus(self, link: ModbusLink) -> None:
        transact = link.transact

        def heard(who: str, request: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
            def ask() -> Any:
                return transact(who, request, *args, **kwargs)

            if request is read_identity:
                return self._answered(who, "identify", 0, b"", ask)
            written = request is write_registers
            sent = _registers(args[1]) if written else b""
            return self._answered(who, "write" if written else "read", args[0], sent, ask)

        link.transact = heard  # type: ignore[method-assign]

    def _listen_can(self, link: CanLink) -> None:
        upload, download, command, subscribe, send = link.upload, link.download, link.command, link.subscribe, link.send
        nodes = [each for each in self._bench.devices if isinstance(each, CanopenDevice) and each.link is link]
        names = {device.id: device.name for device in nodes}
        of_pdo = {
            pdo.cob_id(device.id): device.name
            for device in nodes
            for pdo in (*device.contract.pdos, *device.contract.receives)
        }

        def called(cob_id: int) -> str:
            return of_pdo.get(cob_id) or names.get(cob_id & BROADCAST, f"node {cob_id & BROADCAST}")

        def uploaded(who: str, node: Any, index: int, subindex: int, size: int | None = None) -> bytes:
            data: bytes = self._answered(
                who, "read", sdo(index, subindex), b"", lambda: upload(who, node, index, subindex, size)
            )
            return data

        def downloaded(who: str, node: Any, index: int, subindex: int, data: bytes) -> None:
            self._answered(who, "write", sdo(index, subindex), data, lambda: download(who, node, index, subindex, data))

        def commanded(node: Any, state: str) -> None:
            self._keep(called(node.id), f"NMT {state}", 0, b"")
            command(node, state)

        def subscribed(cob_id: int, callback: FrameCallback) -> None:
            def hear(cob_id: int, data: bytearray, timestamp: float) -> None:
                self._keep(called(cob_id), "frame", cob_id, bytes(data))
                callback(cob_id, data, timestamp)

            subscribe(cob_id, hear)

        def sent(cob_id: int, data: bytes) -> None:
            self._keep(called(cob_id), "send", cob_id, data)
            send(cob_id, data)

        link.upload, link.download = uploaded, downloaded  # type: ignore[method-assign]
        link.command, link.subscribe = commanded, subscribed  # type: ignore[method-assign]
        link.send = sent  # type: ignore[method-assign]

    def report(self) -> str:
        """The messages of the last `SPAN` seconds of bench time, one in a line.

        Successive frames with process data are only counted.
        """
        now = self._bench.clock.now_ns()
        kept = [message for message in list(self._messages) if message.time_ns >= now - SPAN * 1e9]
        lines = [f"bus traffic of the last {SPAN:g} s, up to bench time {now / 1e9:.6f} s:"]
        for streaming, group in itertools.groupby(kept, key=self._is_stream):
            messages = list(group)
            if streaming:
                last = messages[-1]
                text = f"{len(messages)} frames of process data, the last: {self._decoded(last)}"
                lines.append(_line(last.time_ns, last.who, text))
            else:
                lines += [_line(m.time_ns, m.who, self._described(m)) for m in messages]
        return "\n".join(lines if kept else [*lines, "  none"])

    def _described(self, message: TrafficEntry) -> str:
        trouble = message.trouble.removeprefix(f"{message.who}: ")
        return " ".join(filter(None, (message.verb, self._decoded(message), trouble and f"failed: {trouble}")))

    def _decoded(self, message: TrafficEntry) -> str:
        data, contract = message.data, self._contracts.get(message.who)
        if message.verb in ("frame", "send"):
            pdo = self._pdo(message)
            parts = contract.parts(pdo, data) if contract is not None and pdo is not None else {}
            if contract is None or not parts or sum(map(len, parts.values())) != len(data):
                return f"0x{message.address:03X} {data.hex(' ')}"
            return ", ".join(contract.shown(name, part) for name, part in parts.items())
        if contract is None or not data:
            return ""
        if contract.bus == "canopen":
            fields = [(f, data) for f in contract.fields if f.address == message.address]
        else:
            fields = [
                (f, data[at : at + f.size]) for f in contract.fields if (at := 2 * (f.address - message.address)) >= 0
            ]
        return ", ".join(contract.shown(f.name, own) for f, own in fields if own)

    def _pdo(self, message: TrafficEntry) -> Pdo | None:
        """The process data in a frame, by the contract of its device; None: it holds something else."""
        contract = self._contracts.get(message.who)
        if contract is None:
            return None
        messages = contract.receives if message.verb == "send" else contract.pdos
        return next((pdo for pdo in messages if pdo.node_of(message.address)), None)

    def _is_stream(self, message: TrafficEntry) -> bool:
        return message.verb == "frame" and self._pdo(message) is not None


def _registers(registers: list[int]) -> bytes:
    return b"".join(register.to_bytes(2, "big") for register in registers)


def _line(time_ns: int, who: str, text: str) -> str:
    return f"  {time_ns / 1e9:14.6f} s  {who.partition(' at ')[0]}: {text}"
