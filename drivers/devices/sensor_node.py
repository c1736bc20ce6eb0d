"""Drivers of sensor nodes, which sample films at each SYNC: that of makers' nodes, by their maps, and that of ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt

from palpate.drivers.clock import Clock
from palpate.drivers.devices.canopen_device import MOST_EMERGENCIES, CanopenDevice
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.links.can import CanLink, FrameCallback
from palpate.instrument.arrays import Floats
from palpate.instrument.bench.links import Octets
from palpate.instrument.bench.role_maps import VOLTS, NodeSettings, SensorNodeMap, raw_limits
from palpate.instrument.contracts.contract import Contract, Pdo
from palpate.instrument.contracts.own import (
    CHANNELS,
    FULL_SCALE_COUNTS,
    LONGEST_WHOLE,
    RANGE_VOLTS,
    RANGES,
    SENSOR_NODE,
    SYNC_COB_ID,
    SYNC_PRODUCER,
    frames_load,
)
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, RangeError, UnknownName

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


Pieces = Generator[list[Recording], None, None]
"""What several nodes sample together, piece by piece; the sampling ends when it is closed."""


# -------------------------------------------------------------------------------------------------------
# The readings in the frames of a node that samples: integers, their scale, and where they are saturated

Kept = Sequence[tuple[int, bytes]]
"""Frames, each with the number of the SYNC before it."""
BROKEN = -1  # number of a frame of a wrong size


class Counts:
    """How the frames of a node become readings.

    Attributes:
        pdos: the PDOs that hold channels.
        sizes: bytes of their frames.
        step: step of each channel, shape (channels,) [unit of the readings].
        full_scale: greatest reading that every channel can have, of either sign [unit of the readings].
    """

    def __init__(self, contract: Contract, channels: Sequence[str]) -> None:
        self._contract, self._channels = contract, channels
        self.pdos = tuple(pdo for pdo in contract.pdos if set(pdo.fields) & set(channels))
        self.sizes = tuple(sum(contract[name].size for name in pdo.fields) for pdo in self.pdos)
        self.step = np.ones(len(channels))
        self._low, self._high = np.zeros(len(channels)), np.zeros(len(channels))
        self.full_scale = 0.0

    def read_scales(self, beside: Callable[[str], Mapping[str, float]]) -> None:
        """Take in the scales; `beside` gives what the node tells of a field's scale. Raises what `beside` raises."""
        for number, name in enumerate(self._channels):
            f = self._contract[name]
            self.step[number] = self._contract.step(name, beside(name))
            self._low[number], self._high[number] = raw_limits(f, self.step[number])
        offset = np.array([self._contract[name].offset for name in self._channels])
        ends = np.abs([self.step * self._low + offset, self.step * self._high + offset])
        self.full_scale = float(ends.max(axis=0).min() if (self._low < 0).all() else ends[1].min())

    def first_wrong(self, pdo: Pdo, frames: Kept, count: int) -> int | None:
        """Number of the first SYNC, up to `count`, that was not answered by one whole frame; None: there is none."""
        size = self.sizes[self.pdos.index(pdo)]
        numbers = np.fromiter((number if len(data) == size else BROKEN for number, data in frames[:count]), int)
        wrong = np.flatnonzero(numbers != np.arange(1, len(numbers) + 1))
        if not wrong.size:
            return len(numbers) + 1 if len(numbers) < count else None
        due, came = int(wrong[0]) + 1, int(numbers[wrong[0]])
        return max(came, 1) if BROKEN < came < due else due  # a second answer to an earlier one, or none to this one

    def decoded(self, frames: Mapping[str, Kept]) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Readings, shape (channels, n), and whether each is at the end of its range, where it may be saturated.

        NaN: the node says that it has no reading.
        """
        raw = np.array([self._raw(name, frames) for name in self._channels])
        offset = np.array([self._contract[name].offset for name in self._channels])
        readings = raw * self.step[:, np.newaxis] + offset[:, np.newaxis]
        for number, name in enumerate(self._channels):
            if missing := self._contract[name].missing:
                readings[number, np.isin(raw[number], missing)] = np.nan
        return readings, (raw <= self._low[:, np.newaxis]) | (raw >= self._high[:, np.newaxis])

    def _raw(self, channel: str, frames: Mapping[str, Kept]) -> npt.NDArray[np.int64]:
        pdo = next(pdo for pdo in self.pdos if channel in pdo.fields)
        before = pdo.fields[: pdo.fields.index(channel)]
        at, f = sum(self._contract[name].size for name in before), self._contract[channel]
        data = np.frombuffer(b"".join(each for _, each in frames[pdo.name]), np.uint8)
        octets = data.reshape(len(frames[pdo.name]), -1)[:, at : at + f.size].astype(np.int64)
        raw: npt.NDArray[np.int64] = octets @ (1 << 8 * np.arange(f.size))
        if f.type.startswith("int"):
            raw = np.where(raw >= 1 << 8 * f.size - 1, raw - (1 << 8 * f.size), raw)
        return raw


# --- The SYNC of a CAN bus, by which its nodes sample (CiA 301, 7.2.5) ---------------------------------
#
# One of the nodes sends it, whose crystal keeps the rate. This program sends none: between two programs of a PC a
# frame may wait for milliseconds, and a sample that is taken at another time than its number says is wrong.

COB_ID, PERIOD = 0x1005, 0x1006  # objects
MICROSECONDS = 1e6
LONGEST = (1 << 32) - 1  # µs
BLOCK = 16  # SYNCs whose time stamps are compared with the next ones by their median
SHIFT = 0.4  # of a period: how far they must move until a SYNC is taken to be missing


class Asks(Protocol):
    """The node for which SYNC is sent, whose name stands in messages."""

    name: str
    link: CanLink


class Sync:
    """Switches SYNC on and off in the node that sends it."""

    def __init__(self, asking: Asks, node_id: int) -> None:
        self._asking, self.node_id = asking, node_id
        self.rate = 0.0  # SYNCs a second; 0: not set

    def set_rate(self, rate: float) -> None:
        """Set the rate [1/s], while no SYNC is sent. Raises RangeError, LinkError, DeviceError."""
        period = MICROSECONDS / rate if rate > 0 else math.inf
        if not 1 <= round(min(period, 2 * LONGEST)) <= LONGEST:
            raise RangeError(f"{self._asking.name}: no period of SYNC gives {rate:g} samples/s; give 0.001 to 1e6")
        self.off()  # a program that was killed may have left it on
        self._write(PERIOD, round(period))
        self.rate = MICROSECONDS / round(period)

    def lost(self) -> bool:
        """Whether the node that sends SYNC no longer holds its rate. Raises LinkError, DeviceError."""
        if not self.rate:
            return False
        held = self._asking.link.upload(self._asking.name, self._asking.link.add_node(self.node_id), PERIOD, 0, 4)
        return int.from_bytes(held, "little") != round(MICROSECONDS / self.rate)

    def restore(self) -> None:
        """Write the rate again. Raises LinkError, DeviceError."""
        if self.rate:
            self.set_rate(self.rate)

    def on(self) -> None:
        self._write(COB_ID, SYNC_PRODUCER | SYNC_COB_ID)

    def off(self) -> None:
        self._write(COB_ID, SYNC_COB_ID)

    def _write(self, index: int, value: int) -> None:
        link, who = self._asking.link, f"{self._asking.name}, whose SYNC node {self.node_id} sends"
        try:
            link.download(who, link.add_node(self.node_id), index, 0, value.to_bytes(4, "little"))
        except DeviceError as error:
            raise DeviceError(
                f"{error}, writing {index:04X}h; a node that sends SYNC takes this, so name one by sync_node"
            ) from None


def missing_sync(stamps: Sequence[float], rate: float) -> int | None:
    """Number of the SYNC from which on some are missing or too many, by the times at which they came; None: none is.

    A lost SYNC moves all later ones by a period, and a late time stamp moves itself alone. So the medians of successive
    blocks are compared.

    Args:
        stamps: time stamps of the CAN adapter or its driver, shape (n,) [s].
        rate: SYNCs a second.
    """
    late = np.asarray(stamps) * rate - np.arange(len(stamps))
    blocks = [float(np.median(late[at : at + BLOCK])) for at in range(0, len(late), BLOCK)]
    return next((at * BLOCK + 1 for at, (one, two) in enumerate(pairwise(blocks)) if abs(two - one) > SHIFT), None)


# --- the driver ----------------------------------------------------------------------------------------

FIXED = "fixed"  # name of the only range
# How far SYNCs may be from the bench's clock: a part of them, some at both ends, and how late a machine may be [s].
SLACK, EDGES, LATE = 1e-3, 2, 0.1


class MappedNode(CanopenDevice):
    """One node that samples films at each SYNC, as the map of its kind says."""

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        assert place.kind is not None
        table = place.kind.table(SensorNodeMap)
        return cls._fitted(cls(place.link, place.unit, place.clock, place.kind.contract, table, place.settings), place)

    def __init__(
        self,
        link: CanLink,
        node_id: int,
        clock: Clock,
        contract: Contract,
        table: SensorNodeMap,
        settings: NodeSettings,
    ) -> None:
        super().__init__(link, node_id, clock, contract)
        self.table, self._node_settings = table, settings
        self.sync: Sync | None = None
        sync_node = settings.sync_node or (node_id if table.sends_sync else 0)
        if sync_node:
            self.sync = Sync(self, sync_node)
        self.counts = Counts(contract, table.channels)
        self._frames: dict[str, list[tuple[int, bytes]]] = {}
        self._stamps: list[float] = []
        self.syncs = 0  # SYNCs since `arm`
        self._most = 0  # greatest number of SYNCs and frames that are kept, because a node may send without end

    def connect(self) -> None:
        """Join the bus, identify the node, set its PDOs up, and read how it scales its readings. Raises as `identify`.

        DeviceError: the node does not take a PDO.
        """
        super().connect()
        self.link.subscribe(SYNC_COB_ID, self._on_sync)
        self.counts.read_scales(self._scales.beside)

    @property
    def volts_per_unit(self) -> float:
        """What one unit of its readings stands for [V]. Raises ConfigError: the bench file does not say it."""
        unit, given = self.contract[self.table.channels[0]].unit, self._node_settings.volts_per_unit
        if (given is None) != (unit in VOLTS):
            wants = f"tells {unit} itself; leave it out" if unit in VOLTS else (
                f"reads {unit or 'counts'}; give what one of them stands for in V, as its input stage is wired"
            )  # fmt: skip
            raise ConfigError(f"{self.name}: volts_per_unit in its section of the bench file: the node {wants}")
        return VOLTS[unit] if given is None else given

    @property
    def ranges(self) -> Mapping[str, float]:
        """Its only range, which it cannot change [V]. Raises ConfigError as `volts_per_unit`."""
        return {FIXED: self.volts_per_unit * self.counts.full_scale}

    def check_section(self, settings: NodeSettings, frequency: float) -> None:
        """As for every device. Raises ConfigError: the section does not say what a count is."""
        _ = self.volts_per_unit

    def set_range(self, channel: int, range_: str) -> None:
        """Raises UnknownName: this is not the range that it has."""
        if range_ not in self.ranges:
            raise UnknownName(f"range of the {self.contract.title}", range_, self.ranges)

    def resolution(self, channel: int) -> float:
        """Step of a channel's converter (1 to its number of channels) [V]."""
        return self.volts_per_unit * abs(float(self.counts.step[channel - 1]))

    def set_sample_rate(self, rate: float) -> None:
        """Set the sample rate [Hz], by the period of SYNC.

        Raises:
            RangeError: the node cannot take so many samples a second, or no period of SYNC gives this rate.
            ConfigError: no node is named that sends SYNC.
            LinkError, DeviceError: the node that sends SYNC does not take it.
        """
        if not 0 < rate <= self.table.fastest:
            raise RangeError(
                f"{self.name}: sample rate {rate:g} Hz is not above 0 and up to {self.table.fastest:g} Hz, the most "
                "that it takes; lower the frequency of the drive"
            )
        self._sync().set_rate(rate)

    def _sync(self) -> Sync:
        """The SYNC by which it samples. Raises ConfigError: none is named."""
        if self.sync is None:
            raise ConfigError(
                f"{self.name}: cannot send SYNC, and a PC's own would come too early or too late; write sync_node = ID "
                "in its section of the bench file, of a node on its bus that sends SYNC"
            )
        return self.sync

    def acquire_with(self, others: Sequence[MappedNode], duration: float) -> list[Recording]:
        """Sample for `duration` [s] together with `others`, with the SYNC of this node's section.

        The nodes count no samples, so each frame belongs to the SYNC before it, of which each node must send one. The
        SYNCs themselves are compared with the bench's clock and, on a real bus, with their time stamps.

        Raises:
            RangeError: this is less than one sample, or more than the bus can carry; nothing is sent.
            ConfigError: a node is on another bus; nothing is sent.
            LinkError: samples were lost.
            DeviceError: no rate is set, or no SYNC came.
        """
        sync = self._sync()
        nodes, rate, clock = [self, *others], sync.rate, self.clock
        if not rate:
            raise DeviceError(f"{self.name}: no sample rate is set; set it self", device=self.name)
        if stray := next((node.name for node in others if node.link is not self.link), None):
            raise ConfigError(f"{stray}: is on another bus than {self.name}, whose SYNC it does not hear; put it there")
        samples = duration * rate
        if not (math.isfinite(samples) and 0.5 < samples <= LARGEST_RECORDING):
            raise RangeError(
                f"{self.name}: duration {duration:g} s is not finite, at least one sample at {rate:g} Hz and at most "
                f"{LARGEST_RECORDING} samples"
            )
        load = frames_load([size for node in nodes for size in node.counts.sizes], rate, self.link.bitrate)
        if load > 1:
            raise RangeError(
                f"{self.name}: {len(nodes)} nodes at {rate:g} samples/s fill {100 * load:.0f} % of a bus of "
                f"{self.link.bitrate:g} bit/s; raise its bit rate or lower the frequency of the drive"
            )
        count = round(samples)
        for node in nodes:
            node.arm(count)
        asked = clock.now_ns()
        sync.on()
        try:
            began = clock.now_ns()
            for wait in (duration + 1 / rate, *LATEST_WAITS * (1 / rate,)):
                clock.wait(wait)
                self._barrier()
                if self.syncs > count:  # the frames of SYNC number `count` have come before the next one
                    break
            ended = clock.now_ns()
        finally:
            sync.off()
            for node in nodes:
                node.disarm()
        _check_rate(self, sync, (1e-9 * (ended - began), 1e-9 * (clock.now_ns() - asked)))
        return [node.collect(count, rate) for node in nodes]

    def arm(self, count: int = LARGEST_RECORDING) -> None:
        """Forget earlier samples, and take `count` samples from the next SYNC on."""
        self._frames = {pdo.name: [] for pdo in self.contract.pdos}
        self._stamps, self.syncs = [], 0
        self._most = 2 * count
        self.start()

    def disarm(self) -> None:
        """Take no more samples."""
        self.stop()

    def _on_sync(self, _cob_id: int, _data: bytearray, timestamp: float) -> None:
        self.syncs += 1
        if len(self._stamps) < self._most:
            self._stamps.append(timestamp)

    def _hearing(self, pdo: Pdo) -> FrameCallback:
        """Each frame is kept with the number of the SYNC before it."""

        def heard(_cob_id: int, data: bytearray, _timestamp: float) -> None:
            kept = self._frames.get(pdo.name)
            if kept is not None and len(kept) < self._most:
                kept.append((self.syncs, bytes(data)))

        return heard

    def collect(self, count: int, rate: float) -> Recording:
        """The first `count` samples since `arm`; what is saturated shows by counts at the end of their range.

        Raises:
            LinkError: frames are missing, doubled or out of order; the message names the first such sample.
            DeviceError: the node has sent more emergencies than can be kept.
        """
        frames, stamps, self._frames, self._most = self._frames, self._stamps, {}, 0
        if len(self.emergencies) == MOST_EMERGENCIES:
            raise DeviceError(f"{self.name}: has sent {MOST_EMERGENCIES} emergencies; find out why, then open it again")
        lost = [missing_sync(stamps[: count + 1], rate)] if self.link.stamped else []
        lost += [self.counts.first_wrong(pdo, frames[pdo.name], count) for pdo in self.counts.pdos]
        if wrong := [number for number in lost if number is not None]:
            raise LinkError(
                f"{self.name}: samples are missing from number {min(wrong)} on; the bus lost frames, record again",
                device=self.name,
            )
        volts, saturated = self.counts.decoded({pdo.name: frames[pdo.name][:count] for pdo in self.counts.pdos})
        time: npt.NDArray[np.float64] = np.arange(1, count + 1) / rate
        return Recording(self.id, rate, time, self.volts_per_unit * volts, saturated)

    def notices(self) -> list[str]:
        """Emergencies, a missing heartbeat, and a status that says that readings are not good."""
        found = super().notices()
        if self.table.status is not None:
            status = self.contract.choice(self.table.status, self.held(self.table.status))
            found += [] if status == "ok" else [f"{self.name}: {self.table.status} is {status}"]
        return found

    def differences(self) -> list[str]:
        found = super().differences()
        if self.sync is not None and self.sync.lost():
            found.append(f"{self.name}: node {self.sync.node_id}, which sends SYNC, no longer holds its period")
        return found

    def restore(self) -> None:
        """As of every node; the node that sends SYNC gets its period again as well."""
        super().restore()
        if self.sync is not None:
            self.sync.restore()


def _check_rate(node: MappedNode, sync: Sync, within: tuple[float, float]) -> None:
    """Raises LinkError, DeviceError: not as many SYNCs came as fit between the least and the greatest time [s]."""
    if not node.syncs:
        raise DeviceError(
            f"{node.name}: no SYNC came; check that node {sync.node_id} is there and sends it (1005h, 1006h)",
            device=node.name,
        )
    low, high = (seconds * sync.rate for seconds in within)
    edges = EDGES + LATE * sync.rate
    if not low * (1 - SLACK) - edges <= node.syncs <= high * (1 + SLACK) + edges:
        raise LinkError(
            f"{node.name}: {node.syncs} SYNCs came in {within[0]:.4g} s, {low:.0f} were due; the bus lost frames, or "
            "another node sends SYNC as well",
            device=node.name,
        )


# --- ours ----------------------------------------------------------------------------------------------

CONTRACT = SENSOR_NODE
_SIZES = [sum(CONTRACT[f].size for f in pdo.fields) for pdo in CONTRACT.pdos]  # of its frames, in their order
_FRAME_PAIR = np.dtype([("samples", "<i2", CHANNELS), ("counter", "<u4"), ("saturation", "u1")])
_MOST = (1 << 8 * CONTRACT["sample_counter"].size) - 1  # samples before the counter starts again


class CanopenSensorNode(CanopenDevice):
    """One of our sensor nodes, which a map does not describe: it numbers its samples, and tells which are saturated.

    So its samples are checked by their numbers, not by the SYNCs before them, and its channels have ranges.
    """

    contract = CONTRACT
    orders = frozenset({"sync_cob_id"})  # it starts and stops SYNC
    ranges: ClassVar[Mapping[str, float]] = {name: RANGE_VOLTS[raw] for name, raw in RANGES.items()}  # V

    def __init__(self, link: CanLink, node_id: int, clock: Clock) -> None:
        super().__init__(link, node_id, clock)
        self.rate = 1000.0
        self._volts_per_count = np.ones(CHANNELS)
        self._data, self._sizes = bytearray(), bytearray()  # of the frames that came, one after the other
        self._collected = 0  # samples since `arm` that were collected
        self._most = 0  # greatest number of frames that are kept, because a node may send without end

    def connect(self) -> None:
        """Join the bus, identify the node, and read its settings. Raises as `identify` does."""
        self._join()
        self.rate = self._sync_rate()
        self._read_heartbeat()
        for channel in range(1, CHANNELS + 1):
            self._volts_per_count[channel - 1] = RANGE_VOLTS[int(self.get(f"range_{channel}"))] / FULL_SCALE_COUNTS
        self._listen()
        self.link.take_blocks(self._on_frame, self._on_block)

    def set_range(self, channel: int, range_: str) -> None:
        """Set the input range of a channel (1 to 4): "5 V" or "500 mV"."""
        self.set(f"range_{channel}", range_)
        self._volts_per_count[channel - 1] = RANGE_VOLTS[RANGES[range_]] / FULL_SCALE_COUNTS

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

    def pieces_with(self, others: Sequence[CanopenSensorNode], duration: float) -> Pieces:
        """The same while it lasts. See the function `in_pieces`."""
        return in_pieces([self, *others], duration)

    def arm(self, count: int = LARGEST_RECORDING) -> None:
        """Forget earlier samples, and take `count` samples from the next SYNC on."""
        self._data, self._sizes = bytearray(), bytearray()
        self._collected = 0
        self._most = 2 * count
        self.start()

    def disarm(self) -> None:
        """Take no more samples."""
        self.stop()

    def _hearing(self, pdo: Pdo) -> FrameCallback:
        """The frames of both PDOs are kept, in the order in which they came."""
        return self._on_frame

    def _on_frame(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if len(self._sizes) < self._most:
            self._data += data
            self._sizes.append(len(data))

    def _on_block(self, columns: Mapping[int, Octets]) -> None:
        """The frames of several SYNCs are kept in the same order as if they came one by one."""
        count = max(self._most - len(self._sizes), 0) // len(columns)
        sent = [data[:count] for data in columns.values()]
        self._data += np.hstack(sent).tobytes()
        self._sizes += len(sent[0]) * bytes(data.shape[1] for data in sent)

    def collect(self, count: int) -> Recording:
        """The next `count` samples since `arm`, which it then forgets.

        Raises:
            LinkError: frames are missing, doubled or out of order; the message names the first such sample.
            DeviceError: the node has sent more emergencies than can be kept.
        """
        if len(self.emergencies) == MOST_EMERGENCIES:
            raise DeviceError(f"{self.name}: has sent {MOST_EMERGENCIES} emergencies; find out why, then open it again")
        lost = f"{self.name}: samples are missing from number {{}} on; the bus lost frames, record again"
        first, frames = self._collected + 1, len(_SIZES) * count
        came = np.frombuffer(bytes(self._sizes[:frames]), np.uint8)  # of copies, because more may come meanwhile
        odd = np.flatnonzero(came != np.tile(np.array(_SIZES, np.uint8), count)[: came.size])
        good = int(odd[0]) if odd.size else came.size
        if good < frames:
            raise LinkError(lost.format(first + good // len(_SIZES)))
        size = count * _FRAME_PAIR.itemsize
        pairs = np.frombuffer(bytes(self._data[:size]), _FRAME_PAIR)
        del self._data[:size], self._sizes[:frames]
        self._most -= frames
        self._collected += count
        counter = pairs["counter"].astype(np.int64)
        number = np.arange(first, first + count)
        wrong = np.flatnonzero(counter != number)
        if wrong.size:
            raise LinkError(lost.format(first + int(wrong[0])))
        saturation = pairs["saturation"]
        return Recording(
            node=self.id,
            rate=self.rate,
            time=number / self.rate,
            voltage=pairs["samples"].T * self._volts_per_count[:, np.newaxis],
            saturated=(saturation >> np.arange(CHANNELS, dtype=np.uint8)[:, np.newaxis] & 1).astype(bool),
        )


PIECE = 5.0  # s, the pieces of a recording that is not taken at once


def acquire(nodes: Sequence[CanopenSensorNode], duration: float) -> list[Recording]:
    """Sample with all `nodes` together for `duration` [s]; the first one produces SYNC. Raises as `in_pieces`."""
    return [_joined(pieces) for pieces in zip(*in_pieces(nodes, duration), strict=True)]


def _joined(pieces: Sequence[Recording]) -> Recording:
    if len(pieces) == 1:
        return pieces[0]
    first = pieces[0]
    time, voltage, saturated = (
        np.concatenate([getattr(piece, name) for piece in pieces], axis=-1) for name in ("time", "voltage", "saturated")
    )
    return Recording(first.node, first.rate, time, voltage, saturated)


def in_pieces(nodes: Sequence[CanopenSensorNode], duration: float) -> Pieces:
    """Sample with all `nodes` together for `duration` [s], and give the samples while it lasts.

    The first node produces SYNC until all pieces are taken, or whoever takes them stops. Up to `LONGEST_WHOLE` there is
    one piece. A longer recording comes in pieces of `PIECE`, of which none is kept, so that it needs no more memory.

    A node's answer to a request follows its samples on the bus, so when it has told its count, every
    sample up to there has arrived; each count is then checked against what came.

    Raises:
        RangeError: this is less than one sample, or more than the nodes can count; nothing is sent.
        LinkError: samples were lost.
        DeviceError: the nodes took too few samples.
    """
    producer = nodes[0]
    count = _samples(producer, duration)
    for node in nodes:
        node.rate = producer.rate
        node.arm(count)
    piece = count if duration <= LONGEST_WHOLE else max(round(PIECE * producer.rate), 1)
    producer.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    try:
        for first in range(0, count, piece):
            last = min(first + piece, count)
            producer.clock.wait(duration if piece == count else (last - first) / producer.rate)
            _await(nodes, last)
            if last < count:
                yield [node.collect(last - first) for node in nodes]
    finally:
        producer.set("sync_cob_id", SYNC_COB_ID)
        for node in nodes:
            node.disarm()
    yield [node.collect(last - first) for node in nodes]


def _samples(producer: CanopenSensorNode, duration: float) -> int:
    """Number of samples in a duration [s]. Raises RangeError, DeviceError: it cannot be recorded."""
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
    return count


def _await(nodes: Sequence[CanopenSensorNode], count: int) -> None:
    """Wait until each node has taken so many samples. Raises DeviceError: they take too few."""
    producer = nodes[0]
    for _ in range(LATEST_WAITS):
        missing = count - int(min(node.get("sample_counter") for node in nodes))
        if missing <= 0:
            return
        producer.clock.wait(missing / producer.rate)
    raise DeviceError(f"{producer.name}: {missing} of {count} samples were not taken; check SYNC and NMT state")
