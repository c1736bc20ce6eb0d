"""A long dwell, whose samples are stored while it lasts, and are read again from the record piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.procedures.records.chain import ChainFile, Content
from palpate.procedures.records.record_file import IN_A_FRAME, as_samples, wave_frame, waves
from palpate.procedures.records.run import telling_damage
from palpate.procedures.records.run_folder import RECORD


class StoredDwell:
    """The samples of one dwell at a point that is not stored yet. If it is taken anew, that is another dwell.

    Attributes:
        point_id: the point.
        number: number of the dwell at this point, from 1.
        samples: number of samples of each waveform so far.
    """

    def __init__(self, folder: Path, point_id: int, number: int, store: Callable[[Sequence[Content]], int]) -> None:
        """`store` puts frames into the record in a folder, and returns where they begin in its file."""
        self.point_id, self.number, self.samples = point_id, number, 0
        self._path, self._store = folder / RECORD, store
        self._begins, self._waveforms = 0, 0

    def add(self, waveforms: Mapping[str, tuple[float, np.ndarray]]) -> None:
        """Store the next samples of all waveforms; they are durable on return.

        Raises:
            RangeError: as `Recorder.point`, or they are not as many of each, or too many for a row of the record.
            RecordError: they cannot be stored.
        """
        named = {name: (rate, as_samples(name, rate, samples)) for name, (rate, samples) in waveforms.items()}
        counts = {samples.size for _, samples in named.values()}
        if len(counts) != 1 or max(counts) > IN_A_FRAME:
            raise RangeError(f"a piece of a dwell has {counts} samples; give as many of each, {IN_A_FRAME} at most")
        begins = self._store(
            [
                wave_frame(self.point_id, name, rate, samples, self.samples, self.number)
                for name, (rate, samples) in named.items()
            ]
        )
        if not self.samples:
            self._begins, self._waveforms = begins, len(named)
        self.samples += counts.pop()

    def pieces(self) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
        """All samples again: of each piece the number of its first sample, from 0, and the samples by name.

        Raises:
            RecordError: they are not as they were written.
        """
        piece: dict[str, np.ndarray] = {}
        first = 0
        with telling_damage(self._path), ChainFile(self._path) as file:
            frames = waves(file, self._begins)
            while first < self.samples:
                wave = next(frames, None)
                if wave is None:
                    raise ValueError(f"samples of point {self.point_id} are missing from number {first + 1} on")
                piece[wave.name] = wave.samples
                if len(piece) == self._waveforms:
                    yield first, piece
                    first, piece = first + wave.samples.size, {}
