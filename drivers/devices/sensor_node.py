"""Driver of the sensor nodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from palpate.drivers.clock import Clock
from palpate.drivers.devices.canopen_device import MOST_EMERGENCIES, CanopenDevice
from palpate.drivers.links.can import CanLink, FrameCallback
from palpate.instrument.contracts import sensor_node
from palpate.instrument.contracts.contract import Pdo
from palpate.instrument.contracts.sensor_node import (
    CHANNELS,
    FULL_SCALE_COUNTS,
    RANGE_VOLTS,
    SYNC_COB_ID,
    SYNC_PRODUCER,
)
from palpate.instrument.errors import DeviceError, LinkError, RangeError

CONTRACT = sensor_node.CONTRACT
_SAMPLES, _STAMP = CONTRACT.pdos
_SAMPLES_SIZE, _STAMP_SIZE = (sum(CONTRACT[f].size for f in pdo.fields) for pdo in (_SAMPLES, _STAMP))
_FRAME_PAIR = np.dtype([("samples", "<i2", CHANNELS), ("counter", "<u4"), ("saturation", "u1")])
_MOST = (1 << 8 * CONTRACT["sample_counter"].size) - 1  # samples before the counter starts again
LATEST_WAITS = 10
LARGEST_RECORDING = 10_000_000  # greatest number of samples if the caller gives none


@dataclass(frozen=True, slots=True)
class Recording:
    """The samples of one node.

    Attributes:
        node: its node id.
        rate: sample rate [Hz].
        time: time since the start of the acquisition, shape (n,) [s].
        voltage: voltage of each channel, shape (4, n) [V].
        saturated: whether a sample is saturated, shape (4, n).
    """

    node: int
    rate: float
    time: npt.NDArray[np.float64]
    voltage: npt.NDArray[np.float64]
    saturated: npt.NDArray[np.bool_]


class CanopenSensorNode(CanopenDevice):
    """One sensor node on the CAN bus."""

    contract = CONTRACT
    orders = frozenset({"sync_cob_id"})  # it starts and stops SYNC
    ranges: ClassVar[Mapping[str, float]] = {name: RANGE_VOLTS[raw] for name, raw in sensor_node.RANGES.items()}  # V

    def __init__(self, link: CanLink, node_id: int, clock: Clock) -> None:
        super().__init__(link, node_id, clock)
        self.rate = 1000.0
        self._volts_per_count = np.ones(CHANNELS)
        self._frames: list[bytearray] = []
        self._most = 0  # greatest number of frames that are kept, because a node may send without end

    def connect(self) -> None:
        """Join the bus, identify the node, and read its settings. Raises as `identify` does."""
        self._join()
        self.rate = self._sync_rate()
        self._read_heartbeat()
        for channel in range(1, CHANNELS + 1):
            self._volts_per_count[channel - 1] = RANGE_VOLTS[int(self.get(f"range_{channel}"))] / FULL_SCALE_COUNTS
        self._listen()

    def set_range(self, channel: int, range_: str) -> None:
        """Set the input range of a channel (1 to 4): "5 V" or "500 mV"."""
        self.set(f"range_{channel}", range_)
        self._volts_per_count[channel - 1] = RANGE_VOLTS[sensor_node.RANGES[range_]] / FULL_SCALE_COUNTS

    def set_sample_rate(self, rate: float) -> None:
        """Set the sample rate [Hz], by the period of SYNC; it holds for all nodes while this one produces SYNC.

        Raises:
            RangeError: the rate is not above 0, or its period is outside the contract's limits.
        """
        if not rate > 0:
            raise RangeError(f"{self.name}: sample rate {rate:g} Hz is not above 0; give a positive one")
        self.set("sync_period", 1.0 / rate)
        self.rate = 1.0 / self.get("sync_period")

    def _sync_rate(self) -> float:
        """The node's present sample rate [Hz]; 0: it sends no SYNC, which is the default of CiA 301."""
        held = self._held("sync_period")
        return 1.0 / self._value("sync_period", held) if any(held) else 0.0

    def reset_integrators(self) -> None:
        """Discharge the integrators of all charge amplifiers, so that their outputs start again from zero."""
        for channel in range(1, CHANNELS + 1):
            self.set(f"reset_{channel}", 1)

    def resolution(self, channel: int) -> float:
        """Step of a channel's converter (1 to 4) on its present range [V]."""
        return float(self._volts_per_count[channel - 1])

    def acquire(self, duration: float) -> Recording:
        """Sample for `duration` [s], with SYNC from this node. See the function `acquire`."""
        return acquire([self], duration)[0]

    def acquire_with(self, others: Sequence[CanopenSensorNode], duration: float) -> list[Recording]:
        """Sample for `duration` [s] together with `others`, with SYNC from this node. See the function `acquire`."""
        return acquire([self, *others], duration)

    def arm(self, count: int = LARGEST_RECORDING) -> None:
        """Forget earlier samples, and take `count` samples from the next SYNC on."""
        self._frames = []
        self._most = 2 * count
        self.start()

    def disarm(self) -> None:
        """Take no more samples."""
        self.stop()

    def _hearing(self, pdo: Pdo) -> FrameCallback:
        """The frames of both PDOs are kept, in the order in which they came."""
        return self._on_frame

    def _on_frame(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if len(self._frames) < self._most:
            self._frames.append(data)

    def collect(self, count: int) -> Recording:
        """The first `count` samples since `arm`.

        Raises:
            LinkError: frames are missing, doubled or out of order; the message names the first such sample.
            DeviceError: the node has sent more emergencies than can be kept.
        """
        frames, self._frames, self._most = self._frames, [], 0
        if len(self.emergencies) == MOST_EMERGENCIES:
            raise DeviceError(f"{self.name}: has sent {MOST_EMERGENCIES} emergencies; find out why, then open it again")
        lost = f"{self.name}: samples are missing from number {{}} on; the bus lost frames, record again"
        sizes = np.fromiter(map(len, frames), int)
        odd = np.flatnonzero(sizes != np.resize([_SAMPLES_SIZE, _STAMP_SIZE], sizes.size))
        good = int(odd[0]) if odd.size else sizes.size
        if good // 2 < count:
            raise LinkError(lost.format(good // 2 + 1))
        pairs = np.frombuffer(b"".join(frames[: 2 * count]), _FRAME_PAIR)
        counter = pairs["counter"].astype(np.int64)
        wrong = np.flatnonzero(counter != np.arange(1, count + 1))
        if wrong.size:
            raise LinkError(lost.format(int(wrong[0]) + 1))
        saturation = pairs["saturation"]
        return Recording(
            node=self.id,
            rate=self.rate,
            time=np.arange(1, count + 1) / self.rate,
            voltage=pairs["samples"].T * self._volts_per_count[:, np.newaxis],
            saturated=(saturation >> np.arange(CHANNELS, dtype=np.uint8)[:, np.newaxis] & 1).astype(bool),
        )


def acquire(nodes: Sequence[CanopenSensorNode], duration: float) -> list[Recording]:
    """Sample with all `nodes` together for `duration` [s]; the first one produces SYNC.

    A node's answer to a request follows its samples on the bus, so when it has told its count, every
    sample up to there has arrived; each count is then checked against what came.

    Raises:
        RangeError: this is less than one sample, or more than the nodes can count; nothing is sent.
        LinkError: samples were lost.
        DeviceError: the nodes took too few samples.
    """
    producer = nodes[0]
    if not producer.rate:
        raise DeviceError(
            f"{producer.name}: sync_period (1006h) is 0, so it sends no SYNC and nothing is sampled; set the sample "
            "rate first",
            device=producer.name,
        )
    samples = duration * producer.rate
    if not (math.isfinite(samples) and samples > 0.5):
        raise RangeError(
            f"{producer.name}: duration {duration:g} s is not finite and at least one sample at {producer.rate:g} Hz"
        )
    count = round(samples)
    if count > _MOST:
        raise RangeError(
            f"{producer.name}: {count} samples are more than the nodes' counters tell apart, {_MOST}; "
            f"record at most {_MOST / producer.rate:.6g} s at once"
        )
    for node in nodes:
        node.rate = producer.rate
        node.arm(count)
    producer.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    try:
        producer.clock.wait(duration)
        for _ in range(LATEST_WAITS):
            missing = count - int(min(node.get("sample_counter") for node in nodes))
            if missing <= 0:
                break
            producer.clock.wait(missing / producer.rate)
        else:
            raise DeviceError(f"{producer.name}: {missing} of {count} samples were not taken; check SYNC and NMT state")
    finally:
        producer.set("sync_cob_id", SYNC_COB_ID)
        for node in nodes:
            node.disarm()
    return [node.collect(count) for node in nodes]
