"""What all sweeps have in common.

A field of `Sweep` is a setting of each sweep: an option of its command, told in its help, kept in its record.
`SweepWork` reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.procedures.engine.plan import B
from palpate.procedures.engine.procedure import P, Procedure, R, S
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.settings import Extrapolate
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.record import Recorder


@dataclass(frozen=True, kw_only=True)
class Sweep(Procedure[S, P, R, B]):
    """A sweep under a dynamic load. Its settings here are given by name."""

    pausable = True

    extrapolate: Extrapolate = False


class SweepWork(DynamicLoadWork):
    """The bench work of a sweep."""

    def __init__(
        self,
        lab: Lab,
        record: Recorder,
        sweep: Sweep[Any, Any, Any, Any],
        loads: Sequence[float],
        frequency: float,
        samples: Sequence[str],
    ) -> None:
        """Arguments and errors as of `DynamicLoadWork`."""
        super().__init__(lab, record, loads, frequency, samples, sweep.extrapolate)
