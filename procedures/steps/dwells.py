"""The load sets of which the result of a procedure is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.instrument.sensor.sample import Sample


@dataclass(frozen=True, slots=True)
class Dwells:
    """Settled load sets of one frequency.

    Attributes:
        objects: the samples or other objects.
        loads: least and greatest load, peak to peak [N].
        frequency: frequency of the load [Hz].
        dwell: shortest dwell [s].
    """

    objects: Sequence[Sample]
    loads: tuple[float, float]
    frequency: float
    dwell: float
