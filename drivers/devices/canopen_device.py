"""The base of the CANopen drivers."""

from __future__ import annotations

from typing import ClassVar, Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device, Place
from palpate.drivers.links.can import CanLink, FrameCallback
from palpate.instrument.contracts.contract import PROBE, Pdo, Value, sdo
from palpate.instrument.contracts.sensor_node import EMERGENCY, SILENT
from palpate.instrument.errors import DeviceError, IdentityError

MOST_EMERGENCIES = 10_000  # emergency messages that are kept for a node
HEARTBEAT = 0x700
BOOTED = 0
MISSED = 3  # missing heartbeats after which an incident is noted


class CanopenDevice(Device):
    """Reads and writes the objects of the contract by checked SDO transfers, and exchanges its process data (PDOs).

    A write is sent once. The driver remembers written settings in order to restore them, but no orders. If the contract
    has these objects, the driver also hears emergencies (1014h), heartbeats (1017h) and restarts of the node.
    """

    orders: ClassVar[frozenset[str]] = frozenset()  # objects that make the node do something

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the driver of a node; a driver whose constructor takes more arguments overrides this."""
        return cls(place.link, place.unit, place.clock)

    def __init__(self, link: CanLink, node_id: int, clock: Clock) -> None:
        super().__init__(f"{self.contract.title} {node_id} at {link.name}")
        self.link: CanLink = link
        self.id = node_id
        self.clock = clock
        self._settings: dict[str, Value] = {}
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
        self.simulated = self._text(sdo(0x1009)) == "simulated"

    def identify(self) -> None:
        """Check identity (1018h) and byte order.

        Raises:
            IdentityError: another vendor, product or major revision, another byte order, or another serial number than
                before.
            LinkError, LinkTimeout, DeviceError: the node does not answer, or refuses.
        """
        expected = self.contract.identity
        found = [int(self.get(field)) for field in ("vendor", "product", "revision")]
        wanted = [int(text, 16) for text in (expected.vendor, expected.product, expected.revision)]
        if found[:2] != wanted[:2] or found[2] >> 16 != wanted[2] >> 16:
            raise IdentityError(
                f"{self.name}: identifies itself as {' '.join(f'0x{v:08X}' for v in found)}, the contract is for "
                f"{' '.join(f'0x{v:08X}' for v in wanted)}; check the node id in the bench file"
            )
        if (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: byte-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "this node is not little-endian as CANopen asks; update its firmware"
            )
        self.serial = self._same(f"{int(self.get('serial')):08X}")

    def get(self, name: str) -> float:
        """Physical value of one object. Raises LinkError, LinkTimeout; DeviceError: an abort, or outside its limits."""
        return self._asked(lambda: self._value(name, self._get(name)))

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

    def set(self, name: str, value: Value) -> None:
        """Write one object. Raises RangeError before anything is sent, DeviceError where the node aborts."""
        data = self.contract.encode(name, value)
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
        self._get("probe")
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
        return {name: self._value(name, part) for name, part in self.contract.parts(sent, data).items()}

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
        """The settings that the node no longer holds, allowed or not, and whether the node has restarted."""
        found = []
        for name, value in self._settings.items():
            held = self._held(name)
            if held != self.contract.encode(name, value):
                found.append(f"{self.name}: {name} is {self.contract.decode(name, held):g}, was set to {value}")
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
