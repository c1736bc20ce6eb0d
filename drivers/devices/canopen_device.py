"""The base of the CANopen drivers."""

from __future__ import annotations

from functools import partial

from palpate.drivers.clock import Clock
from palpate.drivers.devices.canopen_node import CanopenNode
from palpate.drivers.devices.pdo_set_up import NO_RTR, entries, steps
from palpate.drivers.links.can import HEARTBEAT, CanLink, FrameCallback
from palpate.instrument.contracts.contract import Contract, Pdo, Value
from palpate.instrument.contracts.pdo import COB_ID
from palpate.instrument.contracts.sensor_node import EMERGENCY, SILENT
from palpate.instrument.errors import DeviceError

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
                self._told(partial(self._store, f"PDO {pdo.name}", *step))

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
        self._told(partial(self._store, "its heartbeat consumer", CONSUMER, 1, self._watched))

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
        self._told(lambda: self.link.send(taken.cob_id(self.id), data))
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
            self._told(partial(self._store, "its heartbeat consumer", CONSUMER, 1, self._watched))
        if self._started:
            self.start()
        for name, value in self._settings.items():
            self.set(name, value)
