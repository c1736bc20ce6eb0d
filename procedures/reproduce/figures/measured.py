"""Measurements of the simulated benches, for the figures of chapter 5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.models.evidence import Evidence
from palpate.procedures.measurements.loads.result import SweepResult
from palpate.procedures.measurements.modulus.result import ModulusResult


@dataclass(frozen=True, slots=True)
class Measured:
    """All measurements.

    Attributes:
        bench: bench of the single sensor, which measured first.
        swept: load sweep over all samples for each design.
        evidence: what agreement of the sweep's force ratios is worth, for each design.
        blind: the same sweep by a model that knows nothing of the experiments, for each design and parameter set.
        tested: compression test of each sample.
    """

    bench: BenchDescription
    swept: Mapping[str, SweepResult]
    evidence: Mapping[str, Evidence]
    blind: Mapping[tuple[str, str], SweepResult]
    tested: Mapping[str, ModulusResult]
