"""The whole simulated bench: every device of a scene on the wire, and the bench file that finds them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

from palpate.instrument.bench.description import (
    Amplifier,
    BenchDescription,
    CanBus,
    Indicator,
    RtuAddress,
    SerialLine,
    TcpAddress,
)
from palpate.instrument.bench.serial_line import FASTEST
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.positioner import Positioner
from palpate.simulators.devices.sample_changer import SampleChanger
from palpate.simulators.devices.shaker_amplifier import ShakerAmplifier
from palpate.simulators.devices.signal_generator import SignalGenerator
from palpate.simulators.devices.strain_indicator import StrainIndicator
from palpate.simulators.rig.operator import SimulatedOperator
from palpate.simulators.rig.rig import Rig
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.can import CanSegment
from palpate.simulators.wire.can_bus import own_channel
from palpate.simulators.wire.modbus import LOOPBACK, ServerThread

if TYPE_CHECKING:
    from palpate.simulators.faults.inject import Injection

INDICATOR_UNIT, POSITIONER_UNIT = 1, 2
LINE_UNITS = {INDICATOR_UNIT: "strain_indicator", POSITIONER_UNIT: "positioner"}
BITRATE = 1_000_000
TIMEOUT: Any = "10 s"  # of the wall: a device of a busy machine is slow, not absent


@dataclass(frozen=True, slots=True)
class Place:
    """Where a simulated bench is to be found.

    Attributes:
        host: its Modbus TCP devices listen on.
        port: of the first of them, the next has the next; 0: any that are free.
        interface, channel: of python-can; channel None: one of its own.
    """

    host: str = LOOPBACK
    port: int = 0
    interface: str = "virtual"
    channel: str | None = None


HERE = Place()  # in this process


class SimulatedBench:
    """A context manager: servers, line and bus run inside it, and nothing is left behind.

    Raises BenchError: a port is in use, or the CAN interface cannot be opened.
    """

    line_units = LINE_UNITS

    def __init__(self, scene: Scene, place: Place = HERE, samples: Sequence[Sample] = ()) -> None:
        """`samples`: of its sample changer; without any it has none, and its operator mounts them."""
        self.scene = scene
        self._place = place
        self.clock = VirtualClock()
        self.rig = Rig(scene, self.clock)
        self._channel = own_channel(place.interface) if place.channel is None else place.channel
        self._node_ids = list(range(1, scene.nodes + 1))
        # first on the clock: what is sampled up to an event does not know of it yet
        self.can = CanSegment(self.clock, self.rig, self._node_ids, place.interface, self._channel)
        self.clock.add(self.rig)
        self.nodes = self.can.nodes
        self.generator = SignalGenerator(self.clock, "SIM-SG-0001", self._generator_changed)
        self.amplifier = ShakerAmplifier(
            self.clock, "SIM-PA-0001", self.generator.voltage, self._amplifier_changed, scene.rig.coil_resistance
        )
        self.indicator = StrainIndicator(self.clock, "SIM-SI-0001", self.rig)
        self.positioner = Positioner(self.clock, "SIM-MP-0001", self.rig)
        self.changer = SampleChanger(self.clock, "SIM-SC-0001", self.rig, samples) if samples else None
        self.operator = SimulatedOperator(self.rig, self.clock)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self.can.close)
            self.servers = servers = stack.enter_context(ServerThread())
            serial, bus = self.rig.effects.line, self.rig.effects.can
            timeouts = _timeouts(self.scene)
            line = servers.serve_rtu({INDICATOR_UNIT: self.indicator, POSITIONER_UNIT: self.positioner}, serial)
            host, port = self._place.host, self._place.port
            generator = servers.serve_tcp(1, self.generator, (host, port))
            amplifier = servers.serve_tcp(1, self.amplifier, (host, port and port + 1))
            changer = None
            if self.changer is not None:
                port_of_it = servers.serve_tcp(1, self.changer, (host, port and port + 2))
                changer = TcpAddress(host=host, port=port_of_it, timeout=timeouts.get("sample_changer", TIMEOUT))
            self.description = BenchDescription(
                name=f"simulated bench, scene {self.scene.name}",
                design=self.scene.design.name,
                pickup=self.scene.pickup,
                signal_generator=TcpAddress(
                    host=host, port=generator, timeout=timeouts.get("signal_generator", TIMEOUT)
                ),
                shaker_amplifier=Amplifier(
                    host=host, port=amplifier, timeout=timeouts.get("shaker_amplifier", TIMEOUT)
                ),
                line=SerialLine(
                    port=line,
                    baudrate=round(serial.baudrate) if serial else FASTEST,
                    timeout=timeouts.get("line", TIMEOUT),
                ),
                strain_indicator=Indicator(unit=INDICATOR_UNIT),
                positioner=RtuAddress(unit=POSITIONER_UNIT),
                can=CanBus(
                    interface=self._place.interface,
                    channel=self._channel,
                    bitrate=round(bus.bitrate) if bus else BITRATE,
                    nodes=tuple(self._node_ids),
                    timeout=timeouts.get("can", TIMEOUT),
                ),
                sample_changer=changer,
            )
            for fault in self.scene.faults:
                self.injection.give(fault)
            stack.enter_context(self.can)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @cached_property
    def injection(self) -> Injection:
        """By which faults are given and taken away; a bench without any never has it."""
        from palpate.simulators.faults.inject import Injection

        return Injection(self)

    def _generator_changed(self) -> None:
        self.amplifier.input_changed()

    def _amplifier_changed(self) -> None:
        self.rig.set_voltage(self.amplifier.voltage())


def _timeouts(scene: Scene) -> dict[str, Any]:
    """Of links that have faults, by their names."""
    if not scene.faults:
        return {}
    from palpate.simulators.faults.inject import timeouts

    return timeouts(scene.faults)
