"""What can be read from a run on disk, in whatever format it is stored."""

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
        hashed: whether each row carries the hash of the one before, so that none can be lost unnoticed.
        header: without `status` and `summary`.
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
        """How many points there are."""
        ...

    def points(self) -> Iterator[Point]:
        """In order."""
        ...

    def events(self) -> list[dict[str, Any]]:
        """In order: `bench_ns`, `kind`, `message`."""
        ...

    def waveforms(self, point_id: int | None = None, name: str | None = None) -> Iterator[Waveform]:
        """In order, one in memory at a time; of one point and name alone where they are given."""
        ...

    def faults(self) -> Iterator[str]:
        """Damage that no point, waveform or event shows, each in a sentence: it lies in the file between them."""
        ...
