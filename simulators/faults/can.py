"""Faults of the CAN bus: what becomes of the frames that the nodes send."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from pydantic import Field

from palpate.instrument.contracts.sensor_node import CONTRACT
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults.fault import CAN, NODE, Fault, Trigger

SAMPLES, STAMP = (pdo.base for pdo in CONTRACT.pdos)
HEARTBEAT = 0x700
FUNCTION, NODE_ID = 0x780, 0x7F  # of an identifier, by CiA 301
DELAY = 5  # frames that overtake a delayed one
BABBLE = 50  # frames a babbling node sends for one

Frame = Any  # can.Message, which the frames of the bus are already
Send = Callable[[Frame], None]


class CanFault(Fault):
    """What is on the bus instead of a frame. A node's fault counts, and strikes, its own frames alone."""

    targets: ClassVar[tuple[str, ...]] = (CAN, NODE)
    function: ClassVar[int | None] = None  # strikes these frames alone
    overtaken: ClassVar[int] = 0  # by so many frames

    def frames(self, frame: Frame) -> list[Frame]:
        return []

    def concerns(self, frame: Frame) -> bool:
        function, node = frame.arbitration_id & FUNCTION, frame.arbitration_id & NODE_ID
        mine = self.on == CAN or (self.on == f"{NODE}{node}" and bool(function))
        return mine and self.function in (None, function)


class LostFrame(CanFault):
    pass


class DuplicatedFrame(CanFault):
    def frames(self, frame: Frame) -> list[Frame]:
        return [frame, frame]


class DelayedFrame(CanFault):
    overtaken: ClassVar[int] = DELAY


class ReorderedFrames(CanFault):
    overtaken: ClassVar[int] = 1


class ErrorFrame(CanFault):
    """A frame is destroyed on the bus and sent again, as CAN controllers do."""

    def frames(self, frame: Frame) -> list[Frame]:
        return [type(frame)(is_error_frame=True, is_extended_id=False), frame]


class BusOff(CanFault):
    """The controllers have left the bus: nothing is heard until they recover."""

    targets: ClassVar[tuple[str, ...]] = (CAN,)


class BusOverload(CanFault):
    """More than the bus carries: of what has the lower priority, the number and flags of a sample, nothing gets by."""

    targets: ClassVar[tuple[str, ...]] = (CAN,)
    function: ClassVar[int | None] = STAMP


class NoHeartbeat(CanFault):
    targets: ClassVar[tuple[str, ...]] = (NODE,)
    function: ClassVar[int | None] = HEARTBEAT


class _Counter(CanFault):
    targets: ClassVar[tuple[str, ...]] = (NODE,)
    function: ClassVar[int | None] = STAMP
    step: ClassVar[int]

    def frames(self, frame: Frame) -> list[Frame]:
        counter = int.from_bytes(frame.data[:4], "little") + self.step
        data = counter.to_bytes(4, "little") + bytes(frame.data[4:])
        return [type(frame)(arbitration_id=frame.arbitration_id, is_extended_id=False, data=data)]


class CounterRepeats(_Counter):
    """The number of a sample is that of the one before."""

    step: ClassVar[int] = -1


class CounterSkips(_Counter):
    step: ClassVar[int] = 1


class BabblingNode(CanFault):
    """A node says its samples over and over."""

    targets: ClassVar[tuple[str, ...]] = (NODE,)
    function: ClassVar[int | None] = SAMPLES
    times: int = Field(default=BABBLE, ge=1, le=10_000, strict=True)

    def frames(self, frame: Frame) -> list[Frame]:
        return self.times * [frame]


class FaultyBus:
    """Sends in place of the bus."""

    def __init__(self, clock: VirtualClock, faults: Sequence[tuple[CanFault, Trigger]], send: Send) -> None:
        self._clock = clock
        self._faults = faults
        self._send = send
        self._held: list[tuple[int, Frame]] = []

    def send(self, frame: Frame) -> None:
        now = self._clock.now_ns()
        concerned = [(fault, trigger) for fault, trigger in self._faults if fault.concerns(frame)]
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
