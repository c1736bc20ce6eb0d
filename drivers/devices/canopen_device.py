"""The base of the CANopen drivers."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device, Place
from palpate.drivers.devices.identified import check_inventory, check_marks, serial_number
from palpate.drivers.devices.told import Told
from palpate.drivers.devices.wear import Wear
from palpate.drivers.links.can import CanLink, FrameCallback
from palpate.instrument.contracts.contract import PROBE, Contract, Pdo, Value, sdo
from palpate.instrument.contracts.sensor_node import EMERGENCY, SILENT
from palpate.instrument.errors import DeviceError, IdentityError

MOST_EMERGENCIES = 10_000  # emergency messages that are kept for a node
DEVICE_TYPE = 0x1000
IDENTITY, REVISION = 0x1018, 3  # object, and its part of which the upper half counts
HEARTBEAT = 0x700
BOOTED = 0
MISSED = 3  # missing heartbeats after which an incident is noted


class CanopenDevice(Device):
    """Reads and writes the objects of the contract by checked SDO transfers, and exchanges its process data (PDOs).

    A write is sent once. The driver remembers written settings in order to restore them, but no orders. If the contract
    has these objects, the driver also hears emergencies (1014h), heartbeats (1017h) and restarts of the node.
    """

    orders: frozenset[str] = frozenset()  # objects that make the node do something

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the driver of a node; a driver whose constructor takes more arguments overrides this."""
        return cls._fitted(cls(place.link, place.unit, place.clock, *cls._own(place)), place)

    def __init__(self, link: CanLink, node_id: int, clock: Clock, contract: Contract | None = None) -> None:
        """Make a driver, not connected yet; `contract`: None for a driver that has its own."""
        if contract is not None:
            self.contract = contract
        super().__init__(f"{self.contract.title} {node_id} at {link.name}")
        self.link: CanLink = link
        self.id = node_id
        self.clock = clock
        self.orders = self.orders | {command.field for command in self.contract.commands}
        self._settings: dict[str, Value] = {}
        self._scales = Told(self)
        self._wear = Wear(self.name, self.contract, clock)
        self.emergencies: list[bytes] = []
        self._noticed = 0  # number of emergencies that were reported as notices
        self._restarted = False
        self._beaten = False  # whether a heartbeat has come since the last look
        self._heard_ns = 0
        self._heartbeat = 0.0
        self._received: dict[str, bytes] = {}
        self._started = False

    def connect(self) -> None:
        """Join the bus, identify the node, and listen to what it tells by itself. Raises as `identify`."""
        self._join()
        self._read_heartbeat()
        self._listen()

    def _join(self) -> None:
        """Join the bus and identify the node. Raises as `identify`."""
        self._node = self.link.add_node(self.id)
        self.identify()
        with suppress(DeviceError):  # not every node has a hardware version
            self.simulated = self._text(sdo(0x1009)) == "simulated"

    def identify(self) -> None:
        """Check that this is the contract's device, and that it tells the same scales and units as before.

        Raises:
            IdentityError: another vendor, product or major revision (1018h), a mark that does not fit, another byte
                order, or another serial number than before; or the bench file does not name a device that cannot be
                known.
            LinkError, LinkTimeout, DeviceError: the node does not answer, refuses, or tells another scale or unit.
        """
        match self.contract.known_by:
            case "identity":
                self._check_identity()
            case "marks":
                check_marks(self)
            case "nothing":
                check_inventory(self)
        if self.contract.has("probe") and (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: byte-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "this node is not little-endian as CANopen asks; update its firmware"
            )
        self._scales.check()
        self.serial = self._same(self._serial_number())

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
        data = self.link.upload(self.name, self._node, IDENTITY, part, 4)
        if len(data) != 4:
            raise DeviceError(
                f"{self.name}: 1018h:{part} has {len(data)} bytes instead of 4, so it is not used; check the node's "
                "firmware"
            )
        return int.from_bytes(data, "little")

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
        return self.contract.decode(name, self._held(name), self._scales.beside(name))

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

    def give(self, **values: Value) -> None:
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
        self._told(lambda: self._set(name, value, data))
        self._remember(name, value)

    def _set(self, name: str, value: Value, data: bytes) -> None:
        field = self.contract[name]
        try:
            self.link.download(self.name, self._node, field.index, field.subindex, data)
        except DeviceError as error:
            raise DeviceError(f"{error}, writing {self.contract.described(name, value)}") from None

    def _read_heartbeat(self) -> None:
        """Read the heartbeat period, if the node has one."""
        if self.contract.has("heartbeat"):
            self._heartbeat = self.get("heartbeat")

    def _barrier(self) -> None:
        """Ask for an object. What the node sent before its answer has come by then."""
        for name in ("error_register", "probe"):
            if self.contract.has(name):
                self._get(name)
                return
        self.link.upload(self.name, self._node, DEVICE_TYPE, 0, 4)

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

    def send(self, pdo: str, **values: Value) -> None:
        """Send a PDO to the node, once; there is no answer. The driver remembers its values like other settings.

        Raises:
            UnknownName: the node takes no PDO of that name; nothing is sent.
            RangeError: a value is missing or outside its limits; nothing is sent. LinkError: the bus failed.
        """
        taken = self.contract.taken(pdo)
        data = self.contract.packed(taken, values)
        self._told(lambda: self.link.send(taken.cob_id(self.id), data))
        for name, value in values.items():
            self._remember(name, value)

    def _remember(self, name: str, value: Value) -> None:
        if self.contract[name].access == "rw" and name not in self.orders:
            self._settings[name] = value

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
                shown = self.contract.decode(name, held, self._scales.beside(name))
                found.append(f"{self.name}: {name} is {shown:g}, was set to {value}")
        return [*([f"{self.name}: has started anew"] if self._restarted else []), *found]

    def restore(self) -> None:
        """Write the settings again, and start the node again if it was started. Raises as `set` does."""
        self._restarted = False
        self._received.clear()
        if self._started:
            self.start()
        for name, value in self._settings.items():
            self.set(name, value)

    def _text(self, address: int) -> str:
        return self.link.upload(self.name, self._node, address >> 8, address & 0xFF).decode("ascii", "replace")
