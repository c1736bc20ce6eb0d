"""Faults of the CAN bus, which change the frames that the nodes send."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.bench.links import CAN
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults.device import DeviceFault, Faulty, device
from palpate.simulators.faults.fault import Beats, Fault, Samples, Struck, Target, Trigger
from palpate.simulators.wire.relay import Send

# --- Faults of a sensor node and the films on it -------------------------------------------------------

HARDWARE = 0x5000  # emergency code for device hardware, CiA 301
BEYOND = 1e3  # V, above every range


class NodeReboot(DeviceFault):
    """The node restarts, announces itself and waits to be started; its settings are lost."""

    targets: ClassVar[tuple[Target, ...]] = ("canopen",)

    def begin(self, sim: Faulty) -> None:
        sim.can.reboot(device(sim, self.on))


class Emergency(DeviceFault):
    """The node sends an emergency message with a `code`."""

    targets: ClassVar[tuple[Target, ...]] = ("canopen",)
    code: int = Field(default=HARDWARE, ge=0, le=0xFFFF, strict=True)

    def begin(self, sim: Faulty) -> None:
        device(sim, self.on).emergency(self.code)


class FilmFault(DeviceFault):
    """A voltage is added to the output of the charge amplifier of a `channel`."""

    targets: ClassVar[tuple[Target, ...]] = ("sensor_node", Samples)
    channel: int = Field(default=1, ge=1, strict=True)

    def problem(self, place: Struck) -> str:
        most = place.kind.channels if place.kind is not None else 0
        return f"channel: {self.channel} is too large; {place.name} has {most}" if self.channel > most else ""

    def begin(self, sim: Faulty) -> None:
        found, start = device(sim, self.on), sim.clock.now_ns()
        sample = found.sample

        def faulty(time_ns: Any, volts: Any, period_ns: int) -> Any:
            row = np.arange(len(volts))[:, np.newaxis] == self.channel - 1
            return sample(time_ns, volts + row * self.added(1e-9 * (time_ns - start)), period_ns)

        found.sample = faulty

    def end(self, sim: Faulty) -> None:
        vars(device(sim, self.on)).pop("sample", None)

    def added(self, seconds: Any) -> Any:
        """Added voltage [V] at `seconds` (n,) after the fault began."""
        raise NotImplementedError


class SaturatedFilm(FilmFault):
    """The film's voltage exceeds every input range."""

    def added(self, seconds: Any) -> Any:
        return BEYOND


class FilmDrift(FilmFault):
    """The output drifts by `rate` V in a second."""

    rate: float = Field(default=1e-3, ge=-1e6, le=1e6, strict=True)

    def added(self, seconds: Any) -> Any:
        return self.rate * seconds


# --- faults of the bus ---------------------------------------------------------------------------------

SAMPLES, STAMP = (pdo.base for pdo in SENSOR_NODE.pdos)
HEARTBEAT = 0x700
FUNCTION, NODE_ID = 0x780, 0x7F  # parts of an identifier by CiA 301
DELAY = 5  # frames that overtake a delayed one
BABBLE = 50  # frames that a babbling node sends in place of one

Frame = Any  # can.Message, which the frames of the bus are already


class CanFault(Fault):
    """Replaces a frame on the bus. A node's fault counts and strikes only that node's frames."""

    targets: ClassVar[tuple[Target, ...]] = (CAN, "canopen")
    function: ClassVar[int | None] = None  # strikes only frames of this function
    overtaken: ClassVar[int] = 0  # number of frames that overtake a struck one

    def frames(self, frame: Frame) -> list[Frame]:
        return []

    def concerns(self, frame: Frame, nodes: Mapping[int, str]) -> bool:
        """Whether it counts this frame; `nodes` are the names of the bus' devices by node id."""
        function, node = frame.arbitration_id & FUNCTION, frame.arbitration_id & NODE_ID
        mine = self.on == CAN or (self.on == nodes.get(node) and bool(function))
        return mine and self.function in (None, function)


class LostFrame(CanFault):
    """A frame is lost."""


class DuplicatedFrame(CanFault):
    """A frame comes twice."""

    def frames(self, frame: Frame) -> list[Frame]:
        return [frame, frame]


class DelayedFrame(CanFault):
    """A frame comes after several later ones."""

    overtaken: ClassVar[int] = DELAY


class ReorderedFrames(CanFault):
    """A frame comes after the next one."""

    overtaken: ClassVar[int] = 1


class ErrorFrame(CanFault):
    """A frame is destroyed on the bus and sent again, as CAN controllers do."""

    def frames(self, frame: Frame) -> list[Frame]:
        return [type(frame)(is_error_frame=True, is_extended_id=False), frame]


class BusOff(CanFault):
    """The controllers have left the bus: nothing is heard until they recover."""

    targets: ClassVar[tuple[Target, ...]] = (CAN,)


class BusOverload(CanFault):
    """The bus is overloaded: frames of lower priority, with the numbers and flags of samples, are lost."""

    targets: ClassVar[tuple[Target, ...]] = (CAN,)
    function: ClassVar[int | None] = STAMP


class NoHeartbeat(CanFault):
    """A node sends no heartbeat."""

    targets: ClassVar[tuple[Target, ...]] = (Beats,)
    function: ClassVar[int | None] = HEARTBEAT


class _Counter(CanFault):
    """Only our own nodes number their samples; of a maker's node the driver counts SYNCs."""

    targets: ClassVar[tuple[Target, ...]] = ("sensor_node",)
    function: ClassVar[int | None] = STAMP
    step: ClassVar[int]

    def frames(self, frame: Frame) -> list[Frame]:
        counter = int.from_bytes(frame.data[:4], "little") + self.step
        data = counter.to_bytes(4, "little") + bytes(frame.data[4:])
        return [type(frame)(arbitration_id=frame.arbitration_id, is_extended_id=False, data=data)]


class CounterRepeats(_Counter):
    """A sample has the number of the sample before it."""

    step: ClassVar[int] = -1


class CounterSkips(_Counter):
    """A sample has the number of the sample after it."""

    step: ClassVar[int] = 1


class BabblingNode(CanFault):
    """A node sends its samples again and again."""

    targets: ClassVar[tuple[Target, ...]] = ("sensor_node", Samples)
    function: ClassVar[int | None] = SAMPLES
    times: int = Field(default=BABBLE, ge=1, le=10_000, strict=True)

    def problem(self, place: Struck) -> str:
        sent = [pdo.base for pdo in place.kind.contract.pdos] if place.kind is not None else []
        return "" if SAMPLES in sent else f"{place.name} sends no samples under 0x{SAMPLES:X} and its node id"

    def frames(self, frame: Frame) -> list[Frame]:
        return self.times * [frame]


class FaultyBus:
    """Sends frames in place of the bus, with the faults applied."""

    def __init__(
        self,
        clock: VirtualClock,
        faults: Sequence[tuple[CanFault, Trigger]],
        send: Send,
        nodes: Mapping[int, str],
    ) -> None:
        self._clock = clock
        self._faults = faults
        self._send = send
        self._nodes = nodes
        self._held: list[tuple[int, Frame]] = []

    def send(self, frame: Frame) -> None:
        now = self._clock.now_ns()
        concerned = [(fault, trigger) for fault, trigger in self._faults if fault.concerns(frame, self._nodes)]
        struck = [fault for fault, trigger in concerned if trigger.strikes(now)]
        frames = [frame]
        if struck and struck[0].overtaken:
            self._held.append((struck[0].overtaken, frame))
            return
        if struck:
            frames = struck[0].frames(frame)
        for each in frames:
            self._send(each)
        held, self._held = self._held, []
        for left, late in held:
            if left == 1:
                self._send(late)
            else:
                self._held.append((left - 1, late))
