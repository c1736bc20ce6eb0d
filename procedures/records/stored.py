"""Reading a run on disk, whatever its record format is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

Status = Literal["running", "complete", "stopped", "failed"]


@dataclass(frozen=True, slots=True)
class Waveform:
    """Samples of one signal at one point: `samples`, shape (n,), float32; `rate`, Hz."""

    point_id: int
    name: str
    rate: float
    samples: np.ndarray


@dataclass(frozen=True, slots=True)
class Point:
    """A point as it is stored: `text` is its data as canonical JSON, `waveforms` are the names of its waveforms."""

    id: int
    bench_ns: int
    text: str
    waveforms: tuple[str, ...]


class Stored(Protocol):
    """A run as it was at one moment. Reading a damaged part raises ValueError, TypeError, KeyError or sqlite3.Error.

    Attributes:
        hashed: whether each row holds the hash of the row before, so that none can be lost unnoticed.
        header: the header, without `status` and `summary`.
    """

    @property
    def hashed(self) -> bool: ...
    @property
    def header(self) -> Mapping[str, Any]: ...
    @property
    def status(self) -> str: ...
    @property
    def summary(self) -> Mapping[str, Any]: ...

    def count(self) -> int:
        """Number of points."""
        ...

    def points(self) -> Iterator[Point]:
        """All points in order."""
        ...

    def events(self) -> list[dict[str, Any]]:
        """All events in order: `bench_ns`, `kind`, `message`."""
        ...

    def waveforms(self, point_id: int | None = None, name: str | None = None) -> Iterator[Waveform]:
        """Waveforms in order, one in memory at a time; only those of a point and a name where these are given."""
        ...

    def faults(self) -> Iterator[str]:
        """One sentence for each damage between points, waveforms and events, which none of them shows."""
        ...
