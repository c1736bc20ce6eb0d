"""The base of the CANopen drivers."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device, check_inventory, check_marks, serial_number
from palpate.drivers.links.can import HEARTBEAT, CanLink, FrameCallback
from palpate.instrument.bench.description import PATIENCE
from palpate.instrument.contracts.contract import PROBE, Contract, Value, sdo
from palpate.instrument.contracts.declaration import COB_ID, INHIBIT_STEP, PDOS, SENT, TRANSMISSION_TYPE, Pdo
from palpate.instrument.contracts.field import told_text
from palpate.instrument.contracts.own import EMERGENCY, SILENT
from palpate.instrument.errors import DeviceError, IdentityError, LinkError
from palpate.instrument.own_process import Ends

# --- A thread that feeds a watchdog at regular intervals while the program works -----------------------


class Heartbeat:
    """A context manager inside which `say` is called every `interval` of wall time [s].

    It acts for another thread, which drives the bench. The driving thread calls `expect` with the time until its next
    call. If that call is late by more than `PATIENCE`, the program counts as hanging, and `say` is no longer called. A
    program that is killed or stopped does not call it either.
    """

    def __init__(self, say: Callable[[], object], interval: float) -> None:
        self._say = say
        self._interval = interval
        self._until = math.inf
        self._failure: Exception | None = None
        self._end = threading.Event()
        self._ends = Ends()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ends.callback(self._thread.join)
        self._ends.callback(self._end.set)
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def expect(self, within: float) -> None:
        """Called by the driving thread: its next call comes within this time [s]; infinity: it drives nothing."""
        self._until = time.monotonic() + within + PATIENCE

    def failure(self) -> Exception | None:
        """The error of `say` since the last call, but no LinkError, which the next request on the link raises."""
        failure, self._failure = self._failure, None
        return failure

    def turn(self, now: float) -> None:
        """Called at each interval; `now` is the time of `time.monotonic` [s]."""
        if now > self._until:
            return
        try:
            self._say()
        except LinkError:
            pass
        except Exception as error:  # in a thread it would go unnoticed
            self._failure = error

    def _run(self) -> None:
        while not self._end.wait(self._interval):  # no sleep, so that leaving ends it at once
            self.turn(time.monotonic())


# --- How a node is told which fields its process data hold (CiA 301, 7.5.2.35 to 7.5.2.38) -------------

INHIBIT_TIME = 3  # subindex of a communication object
OFF, NO_RTR = 0x8000_0000, 0x4000_0000  # bits of a COB-ID; many nodes refuse to change the second one

Write = tuple[int, int, bytes]
"""Index, subindex and content of an object."""


def entries(contract: Contract, pdo: Pdo) -> list[Write]:
    """The objects that hold the mapping of a PDO: the number of its fields last, as a node takes it."""
    mapping = pdo.index + PDOS
    fields = [contract[name] for name in pdo.fields]
    found = [
        (mapping, number, _u32(field.index << 16 | field.subindex << 8 | 8 * field.size))
        for number, field in enumerate(fields, 1)
    ]
    return [*found, (mapping, 0, bytes([len(fields)]))]


def steps(contract: Contract, pdo: Pdo, node_id: int, held: int) -> list[Write]:
    """What is written to set a PDO up, in order: it is off until all is written.

    Args:
        contract: the contract of the node.
        pdo: one of its PDOs.
        node_id: the node id.
        held: the COB-ID that the node holds, whose bit 30 must stay.
    """
    cob_id = pdo.cob_id(node_id) | held & NO_RTR
    found = [
        (pdo.index, COB_ID, _u32(cob_id | OFF)),
        (pdo.index + PDOS, 0, b"\0"),
        *entries(contract, pdo),
        (pdo.index, TRANSMISSION_TYPE, bytes([pdo.transmission])),
    ]
    if pdo.index >= SENT and pdo.inhibit:
        found.append((pdo.index, INHIBIT_TIME, round(pdo.inhibit / INHIBIT_STEP).to_bytes(2, "little")))
    return [*found, (pdo.index, COB_ID, _u32(cob_id))]


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


# --- How drivers read and write the objects of a CANopen node, and know it -----------------------------

STORE = 0x1010  # object that keeps all others when the right word is written to it
SAVE = b"save"
IDENTITY, REVISION = 0x1018, 3  # object, and its part of which the upper half counts


class CanopenNode(Device):
    """Reads and writes the objects of the contract by checked SDO transfers.

    A write is sent once. The driver remembers written settings in order to restore them, but no orders.
    """

    def __init__(self, link: CanLink, node_id: int, clock: Clock, contract: Contract | None = None) -> None:
        super().__init__(f"{node_id} at {link.name}", clock, contract)
        self.link: CanLink = link
        self.id = node_id

    def _join(self) -> None:
        """Join the bus and identify the node. Raises as `identify`."""
        self.join()
        self.identify()
        with suppress(DeviceError):  # not every node has a hardware version
            self.simulated = self._text(sdo(0x1009)) == "simulated"

    def join(self) -> None:
        """Join the bus; nothing is sent."""
        self._node = self.link.add_node(self.id)

    def identify(self) -> None:
        """Check that this is the contract's device, and that it tells the same scales and units as before.

        Raises:
            IdentityError: another vendor, product or major revision (1018h), a mark that does not fit, another byte
                order, or another serial number than before; or the bench file does not name a device that cannot be
                known.
            LinkError, LinkTimeout, DeviceError: the node does not answer, refuses, or tells another scale or unit.
        """
        self.recognise()
        if self.contract.has("probe") and (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: byte-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "this node is not little-endian as CANopen asks; update its firmware"
            )
        self._scales.check()
        self.serial = self._same(self._serial_number())

    def recognise(self) -> None:
        """Check that this is the contract's device, whatever its scales and units. Raises as `identify`."""
        match self.contract.known_by:
            case "identity":
                self._check_identity()
            case "marks":
                check_marks(self)
            case "nothing":
                check_inventory(self)

    def _check_identity(self) -> None:
        """Check those parts of 1018h that the contract has. Raises IdentityError, LinkError, DeviceError."""
        expected = self.contract.identity
        wanted = {
            number: int(text, 16)
            for number, text in enumerate((expected.vendor, expected.product, expected.revision), 1)
            if text
        }
        found = {number: self._asked(partial(self._identity, number)) for number in wanted}
        if any(found[n] >> 16 != wanted[n] >> 16 if n == REVISION else found[n] != wanted[n] for n in wanted):
            raise IdentityError(
                f"{self.name}: identifies itself as {' '.join(f'0x{v:08X}' for v in found.values())}, the contract is "
                f"for {' '.join(f'0x{v:08X}' for v in wanted.values())}; check the node id in the bench file"
            )

    def _identity(self, part: int) -> int:
        """A part of the identity object. Raises DeviceError: it has no 4 bytes."""
        return int.from_bytes(self._object(IDENTITY, part, 4), "little")

    def _object(self, index: int, subindex: int, size: int) -> bytes:
        """An object that may be no field. Raises LinkError, LinkTimeout; DeviceError: an abort, or another size."""
        data = self.link.upload(self.name, self._node, index, subindex, size)
        if len(data) != size:
            raise DeviceError(
                f"{self.name}: {index:04X}h:{subindex} has {len(data)} bytes instead of {size}, so it is not used; "
                "check the node's firmware"
            )
        return data

    def _serial_number(self) -> str:
        if not self.contract.serial and self.contract.has("serial"):
            return f"{int(self.get('serial')):08X}"
        return serial_number(self)

    def get(self, name: str) -> float:
        """Physical value of one object; NaN: it has no reading.

        Raises LinkError, LinkTimeout; DeviceError: an abort, or a value outside its limits.
        """
        return self._asked(lambda: self._value(name, self._get(name), self._scales.beside(name)))

    def held(self, name: str) -> float:
        """Value of an object, which may be outside the limits."""
        return self._decoded(name, self._held(name), self._scales.beside(name))

    def get_text(self, name: str) -> str:
        """Content of a text object. Raises LinkError, LinkTimeout, DeviceError."""
        return self._asked(lambda: self._text(self.contract[name].address))

    def _held(self, name: str) -> bytes:
        """The bytes of an object, without a check of their value."""
        return self._asked(lambda: self._get(name))

    def _get(self, name: str) -> bytes:
        field = self.contract[name]
        try:
            data = self.link.upload(self.name, self._node, field.index, field.subindex, field.size)
        except DeviceError as error:
            raise DeviceError(f"{error}, reading {name}") from None
        if len(data) != field.size:
            raise DeviceError(
                f"{self.name}: {name} has {len(data)} bytes instead of {field.size}, so it is not used; check the "
                "node's firmware"
            )
        return data

    def give(self, /, **values: Value) -> None:
        """Write objects one by one, in this order, as `set`; all values are checked before the first is sent."""
        for name, value in values.items():
            self._scales.encode(name, value)
        for name, value in values.items():
            self.set(name, value)

    def set(self, name: str, value: Value) -> None:
        """Write one object, once.

        Raises:
            RangeError: a value outside its limits; nothing is sent.
            DeviceError: the node aborts; or its memory was written too often.
        """
        data = self._scales.encode(name, value)
        if worn := self._wear.of((name,)):
            if self.contract[name].access == "rw" and self._held(name) == data:
                self._remember(name, value)
                return
            self._wear.count(worn)
        self._ordered(lambda: self._set(name, value, data))
        self._remember(name, value)

    def _set(self, name: str, value: Value, data: bytes) -> None:
        field = self.contract[name]
        try:
            self.link.download(self.name, self._node, field.index, field.subindex, data)
        except DeviceError as error:
            raise DeviceError(f"{error}, writing {self.contract.described(name, value)}") from None

    def _remember(self, name: str, value: Value) -> None:
        if self.contract[name].access == "rw" and name not in self.orders:
            self._settings[name] = value

    def _store(self, what: str, index: int, subindex: int, content: bytes) -> None:
        """Write an object that may be no field. Raises LinkError, LinkTimeout; DeviceError, which names it."""
        try:
            self.link.download(self.name, self._node, index, subindex, content)
        except DeviceError as error:
            raise DeviceError(
                f"{error}, writing {index:04X}h:{subindex} for {what}; the node does not take this, check its map"
            ) from None

    def save(self) -> None:
        """Let the node keep all its settings when it is switched off (1010h). Nothing here does this unasked."""
        self._ordered(partial(self._store, "its memory", STORE, 1, SAVE))

    def _text(self, address: int) -> str:
        return told_text(self.link.upload(self.name, self._node, address >> 8, address & 0xFF))


# --- the base of the drivers ---------------------------------------------------------------------------

MOST_EMERGENCIES = 10_000  # emergency messages that are kept for a node
DEVICE_TYPE, CONSUMER = 0x1000, 0x1016  # objects
BOOTED = 0
MISSED = 3  # missing heartbeats after which an incident is noted


class CanopenDevice(CanopenNode):
    """Exchanges the process data (PDOs) of the contract as well, and sets them up where the contract says so.

    If the contract has these objects, the driver also hears emergencies (1014h), heartbeats (1017h) and restarts of the
    node.
    """

    def __init__(self, link: CanLink, node_id: int, clock: Clock, contract: Contract | None = None) -> None:
        """Make a driver, not connected yet; `contract`: None for a driver that has its own."""
        super().__init__(link, node_id, clock, contract)
        self.emergencies: list[bytes] = []
        self._noticed = 0  # number of emergencies that were reported as notices
        self._restarted = False
        self._beaten = False  # whether a heartbeat has come since the last look
        self._heard_ns = 0
        self._heartbeat = 0.0
        self._received: dict[str, bytes] = {}
        self._started = False
        self._watched = b""  # what its heartbeat consumer was set to

    def connect(self) -> None:
        """Join the bus, identify the node, set its PDOs up, and listen to what it tells by itself.

        Raises as `identify`; DeviceError: the node does not take a PDO.
        """
        self._join()
        self._set_pdos_up()
        self._read_heartbeat()
        self._listen()

    def _read_heartbeat(self) -> None:
        """Read the heartbeat period, if the node has one."""
        if self.contract.has("heartbeat"):
            self._heartbeat = self.get("heartbeat")

    @property
    def _to_set_up(self) -> list[Pdo]:
        return [pdo for pdo in (*self.contract.pdos, *self.contract.receives) if pdo.index]

    def _set_pdos_up(self) -> None:
        """Set up the PDOs for which the contract says so. The node is pre-operational then, and nothing is saved."""
        if self._to_set_up:
            self.link.command(self._node, "PRE-OPERATIONAL")
        for pdo in self._to_set_up:
            held = self._asked(partial(self._object, pdo.index, COB_ID, 4))
            for step in steps(self.contract, pdo, self.id, int.from_bytes(held, "little")):
                self._ordered(partial(self._store, f"PDO {pdo.name}", *step))

    def _lost_pdos(self) -> list[str]:
        """Names of the PDOs that are no longer set up. Raises LinkError, DeviceError."""
        lost = []
        for pdo in self._to_set_up:
            held = int.from_bytes(self._asked(partial(self._object, pdo.index, COB_ID, 4)), "little")
            mapped = all(
                self._asked(partial(self._object, index, subindex, len(content))) == content
                for index, subindex, content in entries(self.contract, pdo)
            )
            if held & ~NO_RTR != pdo.cob_id(self.id) or not mapped:
                lost.append(pdo.name)
        return lost

    def watch(self, master: int, within: float) -> None:
        """Let the node act when it has not heard the heartbeat of node id `master` for so long [s] (1016h).

        What it does then is its own setting, as of 6007h. The program must send that heartbeat from now on; see
        `CanLink.beat`. Raises DeviceError: the node has no heartbeat consumer.
        """
        self._watched = (master << 16 | round(1e3 * within)).to_bytes(4, "little")
        self._ordered(partial(self._store, "its heartbeat consumer", CONSUMER, 1, self._watched))

    def _barrier(self) -> None:
        """Ask for an object. What the node sent before its answer has come by then."""
        for name in ("error_register", "probe"):
            if self.contract.has(name):
                self._get(name)
                return
        self._object(DEVICE_TYPE, 0, 4)

    def _listen(self) -> None:
        """Subscribe to the node's process data, emergencies and heartbeats."""
        for pdo in self.contract.pdos:
            self.link.subscribe(pdo.cob_id(self.id), self._hearing(pdo))
        if self.contract.has(EMERGENCY) and not (emergency := int(self.get(EMERGENCY))) & SILENT:
            self.link.subscribe(emergency, self._on_emergency)
        if self.contract.has("heartbeat"):
            self.link.subscribe(HEARTBEAT + self.id, self._on_heartbeat)
            self._heard_ns = self.clock.now_ns()

    def _hearing(self, pdo: Pdo) -> FrameCallback:
        """The callback for the frames of a PDO, which runs in the receiving thread; it keeps the last frame."""

        def heard(_cob_id: int, data: bytearray, _timestamp: float) -> None:
            self._received[pdo.name] = bytes(data)

        return heard

    def _on_heartbeat(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if data and data[0] & 0x7F == BOOTED:
            self._restarted = True
        else:
            self._beaten = True

    def _on_emergency(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if len(self.emergencies) < MOST_EMERGENCIES:
            self.emergencies.append(bytes(data))

    def start(self) -> None:
        """Switch the node to NMT state operational, in which it exchanges process data. There is no answer."""
        self.link.command(self._node, "OPERATIONAL")
        self._started = True

    def stop(self) -> None:
        """Switch the node to NMT state pre-operational, which ends the exchange of process data."""
        self.link.command(self._node, "PRE-OPERATIONAL")
        self._started = False

    def received(self, pdo: str) -> dict[str, float]:
        """Physical values of the last frame of a PDO that the node sends.

        The driver first makes a request. The answer follows the node's earlier process data on the bus, so all frames
        sent until then have arrived.

        Raises:
            UnknownName: the node sends no PDO of that name.
            DeviceError: no frame has come, or the last one has a wrong length or a value outside its limits.
            LinkError: the node does not answer.
        """
        sent = self.contract.sent(pdo)
        return self._asked(lambda: self._last(sent))

    def _last(self, sent: Pdo) -> dict[str, float]:
        pdo = sent.name
        self._barrier()
        data = self._received.get(pdo)
        if data is None:
            raise DeviceError(
                f"{self.name}: has sent no process data {pdo!r} yet; start the node, and check that the "
                "bus has a SYNC producer"
            )
        size = sum(self.contract[name].size for name in sent.fields)
        if len(data) != size:
            raise DeviceError(
                f"{self.name}: process data {pdo!r} came with {len(data)} bytes instead of {size} and are not used; "
                "check the PDO mapping of the node"
            )
        parts = self.contract.parts(sent, data).items()
        return {name: self._value(name, part, self._scales.beside(name)) for name, part in parts}

    def send(self, pdo: str, /, **values: Value) -> None:
        """Send a PDO to the node, once; there is no answer. The driver remembers its values like other settings.

        Raises:
            UnknownName: the node takes no PDO of that name; nothing is sent.
            RangeError: a value is missing or outside its limits; nothing is sent. LinkError: the bus failed.
        """
        taken = self.contract.taken(pdo)
        data = self.contract.packed(taken, values, self._scales.encode)
        self._ordered(lambda: self.link.send(taken.cob_id(self.id), data))
        for name, value in values.items():
            self._remember(name, value)

    def notices(self) -> list[str]:
        """Emergencies since the last call, and a heartbeat that has stopped.

        A node's answer follows its heartbeats on the bus: what was due has come when it answers.
        """
        if not (self.contract.has(EMERGENCY) or self.contract.has("heartbeat")):
            return []
        self._held("error_register" if self.contract.has("error_register") else "probe")
        new = self.emergencies[self._noticed :]
        self._noticed += len(new)  # another one may have come meanwhile
        found = [f"emergency 0x{int.from_bytes(data[:2], 'little'):04X}" for data in new]
        now = self.clock.now_ns()
        missed = 1e-9 * (now - self._heard_ns)
        if self._beaten:
            self._heard_ns, self._beaten = now, False
        elif self._heartbeat and missed > MISSED * self._heartbeat:
            found.append(f"no heartbeat for {missed:.3g} s")
        return [f"{self.name}: {each}" for each in found]

    def differences(self) -> list[str]:
        """The settings that the node no longer holds, allowed or not, and whether the node has restarted.

        Raises LinkError, DeviceError; DeviceError also where it tells another scale or unit than before.
        """
        self._scales.check()
        found = []
        for name, value in self._settings.items():
            held = self._held(name)
            if not self._scales.holds(name, held, value):
                shown = self._decoded(name, held, self._scales.beside(name))
                found.append(f"{self.name}: {name} is {shown:g}, was set to {value}")
        found += [f"{self.name}: PDO {name} is no longer set up" for name in self._lost_pdos()]
        if self._watched and self._asked(partial(self._object, CONSUMER, 1, 4)) != self._watched:
            found.append(f"{self.name}: its heartbeat consumer is no longer set")
        return [*([f"{self.name}: has started anew"] if self._restarted else []), *found]

    def restore(self) -> None:
        """Write the settings again, and start the node again if it was started. Raises as `set` does."""
        self._restarted = False
        self._received.clear()
        if self._lost_pdos():
            self._set_pdos_up()
        if self._watched:
            self._ordered(partial(self._store, "its heartbeat consumer", CONSUMER, 1, self._watched))
        if self._started:
            self.start()
        for name, value in self._settings.items():
            self.set(name, value)
