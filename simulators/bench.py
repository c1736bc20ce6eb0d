"""The whole simulated bench: every device of a scene on the wire, and the bench file that finds them."""

from __future__ import annotations

import itertools
import os
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self, cast

from instrument.bench import Amplifier, BenchDescription, CanBus, Indicator, RtuAddress, SerialLine, TcpAddress
from simulators.can import CanSegment
from simulators.clock import VirtualClock
from simulators.modbus import BAUDRATE, LOOPBACK, ServerThread
from simulators.operator import SimulatedOperator
from simulators.positioner import Positioner
from simulators.rig import Rig
from simulators.scene import Scene
from simulators.shaker_amplifier import ShakerAmplifier
from simulators.signal_generator import SignalGenerator
from simulators.strain_indicator import StrainIndicator

if TYPE_CHECKING:
    from simulators.effects.can_timing import CanTiming
    from simulators.effects.serial_timing import SerialTiming
    from simulators.faults.inject import Injection

_numbers = itertools.count(1)
INDICATOR_UNIT, POSITIONER_UNIT = 1, 2
LINE_UNITS = {INDICATOR_UNIT: "strain_indicator", POSITIONER_UNIT: "positioner"}
BITRATE = 1_000_000
TIMEOUT: Any = "10 s"  # of the wall: a device of a busy machine is slow, not absent


class SimulatedBench:
    """A context manager: servers, line and bus run inside it, and nothing is left behind."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.clock = VirtualClock()
        self.rig = Rig(scene, self.clock)
        self._channel = f"palpate-{os.getpid()}-{next(_numbers)}"
        self._node_ids = list(range(1, scene.nodes + 1))
        # first on the clock: what is sampled up to an event does not know of it yet
        self._injection = _injection(scene, self.clock)
        self.can = CanSegment(self.clock, self.rig, self._node_ids, "virtual", self._channel, self._injection)
        self.clock.add(self.rig)
        self.nodes = self.can.nodes
        self.generator = SignalGenerator(self.clock, "SIM-SG-0001", self._generator_changed)
        self.amplifier = ShakerAmplifier(
            self.clock, "SIM-PA-0001", self.generator.voltage, self._amplifier_changed, scene.rig.coil_resistance
        )
        self.indicator = StrainIndicator(self.clock, "SIM-SI-0001", self.rig)
        self.positioner = Positioner(self.clock, "SIM-MP-0001", self.rig)
        self.operator = SimulatedOperator(self.rig, self.clock)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            servers = stack.enter_context(ServerThread())
            serial = cast("SerialTiming | None", self.scene.effects.get("serial_timing"))
            bus = cast("CanTiming | None", self.scene.effects.get("can_timing"))
            injection = self._injection
            relays = injection.relays() if injection else {}
            noise = injection.line(LINE_UNITS) if injection else None
            timeouts = injection.timeouts() if injection else {}
            line = servers.serve_rtu({INDICATOR_UNIT: self.indicator, POSITIONER_UNIT: self.positioner}, serial, noise)
            generator = servers.serve_tcp(1, self.generator, relays.get("signal_generator"))
            amplifier = servers.serve_tcp(1, self.amplifier, relays.get("shaker_amplifier"))
            self.description = BenchDescription(
                name=f"simulated bench, scene {self.scene.name}",
                design=self.scene.design.name,
                signal_generator=TcpAddress(
                    host=LOOPBACK, port=generator, timeout=timeouts.get("signal_generator", TIMEOUT)
                ),
                shaker_amplifier=Amplifier(
                    host=LOOPBACK, port=amplifier, timeout=timeouts.get("shaker_amplifier", TIMEOUT)
                ),
                line=SerialLine(
                    port=line,
                    baudrate=round(serial.baudrate) if serial else BAUDRATE,
                    timeout=timeouts.get("line", TIMEOUT),
                ),
                strain_indicator=Indicator(unit=INDICATOR_UNIT),
                positioner=RtuAddress(unit=POSITIONER_UNIT),
                can=CanBus(
                    interface="virtual",
                    channel=self._channel,
                    bitrate=round(bus.bitrate) if bus else BITRATE,
                    nodes=tuple(self._node_ids),
                    timeout=timeouts.get("can", TIMEOUT),
                ),
            )
            stack.enter_context(self.can)
            if injection is not None:
                injection.into(self)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _generator_changed(self) -> None:
        self.amplifier.input_changed()

    def _amplifier_changed(self) -> None:
        self.rig.set_voltage(self.amplifier.voltage())


def _injection(scene: Scene, clock: VirtualClock) -> Injection | None:
    if not scene.faults:
        return None
    from simulators.faults.inject import Injection

    return Injection(scene, clock)
