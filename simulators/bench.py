"""The simulated bench: it serves every device of a scene, and describes itself by a bench file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from palpate.instrument.additions import load
from palpate.instrument.bench.description import NO_WATCHDOG, BenchDescription, Beside, check_beside, check_load_channel
from palpate.instrument.bench.kinds import KINDS, DeviceKind, NoSettings, Role
from palpate.instrument.bench.links import CAN, FASTEST, LINE, LOOPBACK
from palpate.instrument.config import check
from palpate.instrument.contracts.declaration import NODES
from palpate.instrument.errors import BenchError
from palpate.instrument.own_process import Ends
from palpate.instrument.sensor.design import USUAL_NOISE
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.can_segment import CanSegment
from palpate.simulators.guests import CHANGER, Guest, replaced
from palpate.simulators.rig import Rig, SimulatedOperator
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import device as wire
from palpate.simulators.wire.can_bus import own_channel
from palpate.simulators.wire.loop import Loop
from palpate.simulators.wire.modbus import Servers

if TYPE_CHECKING:
    from palpate.simulators.devices.exciter import SimulatedShakerAmplifier, SimulatedSignalGenerator
    from palpate.simulators.devices.load_indicator import SimulatedStrainIndicator
    from palpate.simulators.devices.positioner import SimulatedPositioner
    from palpate.simulators.devices.sample_changer import SimulatedSampleChanger
    from palpate.simulators.devices.sensor_node import SimulatedSensorNode
    from palpate.simulators.faults.inject import Injection

USUAL = ("signal_generator", "shaker_amplifier", "strain_indicator", "positioner")  # the clock advances in this order
NODE = "sensor_node"
NAMED = "simulated bench"  # the name of every simulated bench begins so
BITRATE = 1_000_000
SERIAL = 0x2026_0100  # serial number of a node, less its id
TIMEOUT: Any = "10 s"  # of wall time; it is long, because on a busy machine a simulated device answers late


@dataclass(frozen=True, slots=True)
class BenchAddresses:
    """Addresses of a simulated bench.

    Attributes:
        host: address on which the Modbus TCP devices listen.
        port: port of the first device; each next device has the next port. 0: any free ports.
        interface: interface of python-can.
        channel: channel of python-can; None: one that no other bench uses.
    """

    host: str = LOOPBACK
    port: int = 0
    interface: str = "virtual"
    channel: str | None = None


HERE = BenchAddresses()  # free ports, and a CAN bus in this process


class SimulatedBench:
    """A simulated bench as a context manager: its servers, serial line and CAN bus run inside it.

    Entering it raises BenchError if a port is in use or the CAN interface cannot be opened.
    """

    def __init__(
        self, scene: Scene, place: BenchAddresses = HERE, samples: Sequence[Sample] = (), *, stepped: bool = False
    ) -> None:
        """Make the bench; it is served once the context is entered.

        Args:
            scene: the scene.
            place: its addresses.
            samples: samples in the sample changer. Without any there is no changer, and the operator mounts samples.
            stepped: whether devices answer in the waits of the bench that gets `clock`, and nobody else; False: in
                threads of their own.

        Raises ConfigError: the simulator of an additional device cannot be loaded.
        """
        self.scene = scene
        self._place = place
        self.clock = VirtualClock()
        self._stepped = stepped
        self.rig = Rig(scene, self.clock)
        self.channel = own_channel(place.interface) if place.channel is None else place.channel
        self._replaced = replaced(scene.devices)
        # first on the clock, so that samples up to an event are taken before the event changes the rig
        self.can = CanSegment(self.clock, self.rig, place.interface, self.channel)
        self.clock.add(self.rig)
        self.devices: dict[str, Any] = {}
        self._kinds: dict[str, DeviceKind] = {}
        self._addresses: dict[str, int] = {}  # unit id on the serial line, or node id, of each device by name
        self._samples = samples
        given = [guest.name for guest in scene.devices if guest.table.get("role") == NODE]
        self._sampling = given or [guest.name for guest in scene.devices if NODE in guest.kind.roles]
        for number in range(1, 1 + (0 if NODE in self._replaced else scene.nodes)):
            self._add(f"{NODE}_{number}", KINDS[NODE], NoSettings())
        self.nodes: list[SimulatedSensorNode] = list(self.devices.values())
        for name in (*USUAL, *([CHANGER] if samples else [])):
            if name not in self._replaced:
                self._add(name, KINDS[name], NoSettings())
        for guest in scene.devices:
            self._add(guest.name, guest.kind, guest.settings)
        self.operator = SimulatedOperator(self.rig, self.clock)
        self._stack = Ends()

    def _free_node_id(self, kind: DeviceKind) -> int:
        """The node id at which alone the COB-IDs of a device are known, if there is one; else the next that is free."""
        taken = {node.id for node in self.can.nodes}
        fixed: list[int] = [pdo.node for pdo in (*kind.contract.pdos, *kind.contract.receives) if pdo.node]
        free: int = next(each for each in (*fixed, *NODES) if each not in taken)
        return free

    def _add(self, name: str, kind: DeviceKind, settings: Any) -> None:
        count = Counter(each.name for each in self._kinds.values())[kind.name] + 1
        link, serial = kind.links[0], f"SIM-{kind.contract.identity.product.partition('-')[0]}-{count:04d}"
        if link == "canopen":
            unit = self._addresses[name] = self._free_node_id(kind)
            number = 1 + self._sampling.index(name) if name in self._sampling else 0
            place = wire.SimulatedPlace(
                self.clock, self.rig, unit, SERIAL + unit, settings, kind, self._find, number=number
            )
        else:
            unit = 1
            if link == "modbus-rtu":
                unit = self._addresses[name] = 1 + sum(each.links[0] == link for each in self._kinds.values())
            place = wire.SimulatedPlace(self.clock, self.rig, unit, serial, settings, kind, self._find, self._samples)
        assert kind.simulator is not None
        self.devices[name] = load(kind.simulator, f"simulator of {name}").at(place)
        self._kinds[name] = kind
        if link == "canopen":
            self.can.add(self.devices[name])

    def _find(self, role: Role) -> Any:
        if filling := self._filling(role):
            return self.devices[filling[0]]
        raise BenchError(f"the simulated bench has no {role}; list a device of such a kind in the scene")

    def _filling(self, role: str) -> list[str]:
        """Names of the devices that fill a role: those to which the scene gives it or, without any, all that can."""
        given = [guest.name for guest in self.scene.devices if guest.table.get("role") == role]
        return given or [name for name, kind in self._kinds.items() if role in kind.roles]

    def __enter__(self) -> Self:
        with Ends() as stack:
            stack.callback(self.can.close)
            loop = Loop(self.clock.give_up_soon)
            self.servers = stack.enter_context(Servers(loop, stepped=self._stepped))
            if self._stepped:
                self.clock.stepper = loop
            timeouts = _timeouts(self.scene)
            serial, bus = self.rig.effects.line, self.rig.effects.can
            self.bitrate = round(bus.bitrate) if bus else BITRATE
            units = {self._addresses[name]: self.devices[name] for name in self._on("modbus-rtu")}
            self.line = self.servers.serve_rtu(units, serial) if units else ""
            ports = {
                name: self.servers.serve_tcp(
                    1, self.devices[name], (self._place.host, self._place.port and self._place.port + number)
                )
                for number, name in enumerate(self._on("modbus-tcp"))
            }
            baudrate = round(serial.baudrate) if serial else FASTEST
            self.description = self._described(ports, baudrate, timeouts)
            for fault in self.scene.faults:
                self.injection.give(fault)
            stack.enter_context(self.can)
            self._stack = stack.pop_all()
        return self

    def _described(self, ports: Mapping[str, int], baudrate: int, timeouts: Mapping[str, Any]) -> BenchDescription:
        """The description of this bench, as a bench file would give it; each device on TCP has a link of its own."""
        scene = self.scene
        links: dict[str, dict[str, Any]] = {
            name: {"kind": "modbus-tcp", "host": self._place.host, "port": port} for name, port in ports.items()
        }
        if self.line:
            links[LINE] = {"kind": "modbus-rtu", "port": self.line, "baudrate": baudrate}
        if self._on("canopen"):
            place = {"interface": self._place.interface, "channel": self.channel, "bitrate": self.bitrate}
            links[CAN] = {"kind": "canopen", **place}
        sections = {
            "name": f"{NAMED}, scene {scene.name}",
            "scene": scene.identity,
            "design": scene.design.name,
            "pickup": scene.pickup,
            **({} if scene.noise in (0.0, USUAL_NOISE) else {"noise": f"{scene.noise!r} V/√Hz"}),
            "load_channel": scene.file.load_channel,
            "link": {name: {**link, "timeout": timeouts.get(name, TIMEOUT)} for name, link in links.items()},
            "device": self._sections(),
            "beside": scene.file.beside or {},
        }
        if any("exciter" in guest.kind.roles and not guest.kind.contract.has("watchdog") for guest in scene.devices):
            sections["watchdog"] = NO_WATCHDOG
        if any(guest.kind.map for guest in scene.devices):
            sections["simulated"] = True
        return check(sections, BenchDescription, f"scene {scene.name}")

    def check_beside(self) -> None:
        """Raises ConfigError: no device of it has what the scene asks to read beside each point, or to sample."""
        asked = self.scene.file.beside or {}
        contracts = {name: kind.contract for name, kind in self._kinds.items()}
        check_beside({name: check(table, Beside, f"beside.{name}") for name, table in asked.items()}, contracts)
        if (channel := self.scene.file.load_channel) is not None:
            filling = ([self._kinds[name] for name in self._filling(role)] for role in (NODE, "load_indicator"))
            check_load_channel(channel, self.scene.design, *filling)

    def _sections(self) -> dict[str, dict[str, Any]]:
        """Sections of the bench file for the devices."""
        place: dict[str, dict[str, Any]] = {
            **{name: {"link": name, "unit": 1} for name in self._on("modbus-tcp")},
            **{name: {"link": LINE, "unit": unit} for unit, name in self.line_units.items()},
            **{name: {"link": CAN, "node": node} for node, name in self.bus_nodes.items()},
        }
        guests = {guest.name: {**_labelled(guest), **guest.table} for guest in self.scene.devices}
        return {name: {**kind.key, **place[name], **guests.get(name, {})} for name, kind in self._kinds.items()}

    def _on(self, link: str) -> list[str]:
        """Names of the devices on links of one kind."""
        return [name for name, kind in self._kinds.items() if kind.links[0] == link]

    @property
    def line_units(self) -> dict[int, str]:
        """Names of the devices on the serial line, by unit."""
        return {self._addresses[name]: name for name in self._on("modbus-rtu")}

    @property
    def bus_nodes(self) -> dict[int, str]:
        """Names of the devices on the CAN bus, by node id."""
        return {self.devices[name].id: name for name in self._on("canopen")}

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @cached_property
    def injection(self) -> Injection:
        """Gives the bench faults and takes them away. Made on first use, so a bench without faults imports no fault."""
        from palpate.simulators.faults.inject import Injection

        return Injection(self)

    def set_speed(self, speed: float) -> None:
        """Speed of its clock to that of its clients, by which devices count how long nothing was heard of one."""
        for device in self.devices.values():
            device.speed = speed

    @property
    def generator(self) -> SimulatedSignalGenerator:
        found: SimulatedSignalGenerator = self.devices["signal_generator"]
        return found

    @property
    def amplifier(self) -> SimulatedShakerAmplifier:
        found: SimulatedShakerAmplifier = self.devices["shaker_amplifier"]
        return found

    @property
    def indicator(self) -> SimulatedStrainIndicator:
        found: SimulatedStrainIndicator = self.devices["strain_indicator"]
        return found

    @property
    def positioner(self) -> SimulatedPositioner:
        found: SimulatedPositioner = self.devices["positioner"]
        return found

    @property
    def changer(self) -> SimulatedSampleChanger | None:
        return self.devices.get(CHANGER)


def _labelled(guest: Guest) -> dict[str, Any]:
    """What the section of a maker's device says beside its place: its label, and that it suits its link."""
    label = {"inventory": f"SIM-{guest.name}", "confirmed": True}
    return (label if guest.kind.contract.known_by == "nothing" else {}) | (
        {"set_to_link": True} if guest.kind.map is not None else {}
    )


def _timeouts(scene: Scene) -> dict[str, Any]:
    """Time-outs of the links that have faults, by name of the link."""
    if not scene.faults:
        return {}
    from palpate.simulators.faults.inject import timeouts

    return timeouts(scene.faults)
