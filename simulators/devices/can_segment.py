"""The simulated CAN bus: CANopen nodes on a python-can bus, with their timing on the virtual clock."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.bench.links import MULTICAST, Block, leave
from palpate.instrument.contracts.contract import sdo
from palpate.instrument.contracts.own import SYNC_COB_ID, SYNC_PRODUCER
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.rig import Rig
from palpate.simulators.wire.can_bus import VirtualNetwork, attach, hand_over, local_node, open_bus
from palpate.simulators.wire.canopen_device import SimulatedNode

if TYPE_CHECKING:
    from palpate.simulators.wire.relay import Send

NMT_FRAME = 2  # bytes
OPERATIONAL, STOPPED, PRE_OPERATIONAL = 5, 4, 127
SYNC_COB, SYNC_PERIOD = sdo(0x1005), sdo(0x1006)  # objects of CiA 301
HEARTBEAT_TIME = 0x1017  # object of CiA 301 that a node may lack
NMT_START, NMT_STOPS, NMT_RESETS = 1, (2, 128), (129, 130)


class CanSegment:
    """All simulated nodes on one CAN bus. A context manager, which the virtual clock advances."""

    def __init__(
        self,
        clock: VirtualClock,
        rig: Rig,
        interface: str,
        channel: str,
    ) -> None:
        self._clock = clock
        self._rig = rig
        self._bus = open_bus(interface, channel)
        # number of our own SYNCs that multicast has still to deliver back to us; None: the interface does not do that
        self._echoes: int | None = 0 if interface == MULTICAST else None
        self._network = VirtualNetwork(self._bus, clock)
        self.nodes: list[SimulatedNode] = []
        self._local: dict[int, Any] = {}
        self._sync_from_ns = NEVER
        self._sync_period_ns = 0
        self._timing = rig.effects.can
        self._busy_until_ns = 0
        # gets each block of the films' voltages (films, n) [V] that nodes sample, with its times and period [ns]
        self.tap: Callable[[npt.NDArray[np.int64], Floats, int], object] | None = None
        clock.add(self)

    def __enter__(self) -> Self:
        if self._clock.stepper is None:
            self._network.connect()
        else:
            self._clock.stepper.take_turns(self._network.take)
        for node in self.nodes:
            local = self._local[node.id]
            attach(self._network, local, node, self._let_pass, self._timing_changed)
            self._boot(local)
        self._network.subscribe(0, self._on_nmt)
        self._network.subscribe(SYNC_COB_ID, self._on_sync)
        return self

    def __exit__(self, *_: object) -> None:
        if self._clock.stepper is not None:
            self._clock.stepper.end_turns(self._network.take)
        leave(self._network)

    def send_by(self, instead: Callable[[Send], Send]) -> None:
        """Replace the bus' `send` by what `instead` returns for it; call it under the clock's lock."""
        self._bus.send = instead(self._bus.send)  # type: ignore[method-assign,assignment]

    def add(self, device: SimulatedNode) -> None:
        """Let a device answer on the bus; call it before entering the context."""
        self.nodes.append(device)
        self._local[device.id] = local_node(device)

    def close(self) -> None:
        """Close the bus if the context was never entered."""
        self._bus.shutdown()

    @property
    def states(self) -> dict[int, str]:
        """NMT state of each node."""
        return {node.id: str(self._local[node.id].nmt.state) for node in self.nodes}

    @property
    def sync_rate(self) -> float:
        """Rate of the SYNC frames that a node sends; 0: no node sends any [Hz]."""
        return 1e9 / self._sync_period_ns if self._sync_period_ns else 0.0

    # --- what the nodes hear ---------------------------------------------------------------------------

    def _boot(self, local: Any) -> None:
        local.nmt.state = "INITIALISING"  # sends the boot-up message
        if HEARTBEAT_TIME in local.object_dictionary:
            local.nmt.state = "PRE-OPERATIONAL"  # starts the heartbeat
        else:
            local.nmt._state = PRE_OPERATIONAL  # canopen would ask for the object

    def _on_nmt(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if len(data) < NMT_FRAME:
            return
        command, target = data[0], data[1]
        for node in self.nodes:
            if target in (0, node.id):
                if command == NMT_START:
                    node.start()
                elif command in NMT_STOPS:
                    node.stop()
                elif command in NMT_RESETS:
                    self.reboot(node)

    def reboot(self, node: SimulatedNode) -> None:
        """Restart a node: it returns to the state after power-on, and announces itself."""
        node.reset()
        self._timing_changed()
        self._boot(self._local[node.id])

    def _let_pass(self) -> None:
        """Let the time of an SDO transfer pass. The client waits for the answer, so nobody else moves the clock."""
        if self._timing is not None:
            busy = max(self._busy_until_ns - self._clock.now_ns(), 0)
            self._clock.wait(1e-9 * (busy + self._timing.transfer_ns()))

    def _on_sync(self, _cob_id: int, _data: bytearray, _timestamp: float) -> None:
        """Handle a SYNC frame of a client."""
        if self._echoes:
            self._echoes -= 1
            return
        self._sample(np.array([self._clock.now_ns()]), send_sync=False)

    def _timing_changed(self) -> None:
        """Adopt the SYNC producer's settings. The first SYNC comes one period after the producer was switched on."""
        periods = (1000 * _sync_period(node) for node in self.nodes)
        period = next((each for each in periods if each), 0)
        if period != self._sync_period_ns:
            self._sync_from_ns = self._clock.now_ns() if period else NEVER
            self._sync_period_ns = period

    # --- what they do by themselves --------------------------------------------------------------------

    def next_event_ns(self) -> int:
        return min((task.due_ns for task in self._network.periodic), default=NEVER)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if self._sync_period_ns:
            first = (start_ns - self._sync_from_ns) // self._sync_period_ns + 1
            last = (end_ns - self._sync_from_ns) // self._sync_period_ns
            if last >= first:
                self._sample(self._sync_from_ns + np.arange(first, last + 1) * self._sync_period_ns, send_sync=True)
        for task in list(self._network.periodic):
            if task.due_ns <= end_ns:
                task.send()

    def _sample(self, time_ns: npt.NDArray[np.int64], *, send_sync: bool) -> None:
        """Let all operational nodes sample at each SYNC, and send their frames."""
        period = self._sync_period_ns or int(1e6)
        films = functools.cache(lambda: self._rig.film_voltages(time_ns, period))
        active = [node for node in self.nodes if self._local[node.id].nmt.state == "OPERATIONAL"]
        frames = [frame for node in active for frame in node.frames_at(time_ns, films, period)]
        if self._timing is not None and send_sync:
            sizes = [(cob_id, data.shape[1]) for cob_id, data in frames]
            in_time, busy_ns = self._timing.burst(sizes, self._sync_period_ns)
            frames = [frames[place] for place in in_time]
            self._busy_until_ns = int(time_ns[-1]) + busy_ns
        if send_sync:
            frames.insert(0, (SYNC_COB_ID, np.empty((len(time_ns), 0), np.uint8)))
            if self._echoes is not None:
                self._echoes += len(time_ns)
        if active and self.tap is not None:
            self.tap(time_ns, films(), period)
        hand_over(self._bus, Block(time_ns, frames))
        for node in active:
            node.sampled()


def _sync_period(node: SimulatedNode) -> int:
    """Period with which a node sends SYNC [µs]; 0: it sends none."""
    at = {f.address: f for f in node.contract.fields if f.address in (SYNC_COB, SYNC_PERIOD)}
    if len(at) < 2 or not int(node.settings[at[SYNC_COB].name]) & SYNC_PRODUCER:
        return 0
    return round(at[SYNC_PERIOD].to_raw(node.settings[at[SYNC_PERIOD].name]))
