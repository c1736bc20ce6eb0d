"""The readings in the frames of a node that samples: integers, their scale, and where they are saturated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from palpate.instrument.bench.role_maps.sensor_node import raw_limits
from palpate.instrument.contracts.contract import Contract, Pdo

Floats = npt.NDArray[np.float64]
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
