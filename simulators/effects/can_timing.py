"""Frames take time on the CAN bus, and only a limited number fits into a SYNC period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from palpate.instrument.contracts.own import CHANNELS, bus_load, stuff_bits
from palpate.instrument.quantity import BitsPerSecond
from palpate.simulators.physics.effect import Bound, CanEffect, Case, Kind

SDO_BYTES = 8


class CanTiming(CanEffect):
    """A classic bus with 11-bit identifiers.

    At each SYNC the nodes' frames are sent in the order of their identifiers. Frames that the next SYNC overtakes are
    lost, because a node keeps only the newest [A]. An SDO transfer waits until the frames are through, or for that
    SYNC, and then takes the time of its request and answer. Heartbeats, emergencies and NMT commands are few and take
    no time.
    """

    kind: ClassVar[Kind] = "timing"
    cancels_in_ratio: ClassVar[bool] = True

    bitrate: BitsPerSecond = Field(default=1e6, ge=1e4, le=1e6)  # [A]
    # "worst": as many stuff bits as there can be; "mean": as many as random data have [S]
    stuffing: Literal["worst", "mean"] = "worst"

    def frame_ns(self, size: int) -> int:
        """Time [ns] of a frame of `size` data bytes with the gap after it."""
        return round(1e9 * (47 + 8 * size + stuff_bits(size, self.stuffing)) / self.bitrate)

    def burst(self, frames: Sequence[tuple[int, int]], period_ns: int) -> tuple[list[int], int]:
        end = self.frame_ns(0)
        sent: list[int] = []
        for place in sorted(range(len(frames)), key=lambda place: frames[place][0]):
            if end + self.frame_ns(frames[place][1]) > period_ns:
                return sent, period_ns
            end += self.frame_ns(frames[place][1])
            sent.append(place)
        return sent, end

    def transfer_ns(self) -> int:
        return 2 * self.frame_ns(SDO_BYTES)

    def known_bound(self, case: Case) -> Bound:
        """Timing alone does not change results, but lost samples can change anything."""
        nodes = math.ceil(len(case.design.films) / CHANNELS)
        change = 0.0 if bus_load(nodes, case.rate, self.bitrate) <= 1 else math.inf
        return Bound(change, change)
