"""What the simulated benches have measured, for the figures of chapter 5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.findings.evidence import Evidence
from palpate.procedures.measurements.loads.procedure import SweepResult
from palpate.procedures.measurements.modulus.procedure import ModulusResult


@dataclass(frozen=True, slots=True)
class Measured:
    """All of it.

    Attributes:
        bench: that of the single sensor, which measured the first of it.
        swept: design -> load sweep over all samples.
        evidence: design -> what the force ratios of its sweep are worth beside the thesis' own.
        blind: design and parameter set -> the same sweep by a model that knows nothing of the experiments.
        tested: sample -> compression test.
    """

    bench: BenchDescription
    swept: Mapping[str, SweepResult]
    evidence: Mapping[str, Evidence]
    blind: Mapping[tuple[str, str], SweepResult]
    tested: Mapping[str, ModulusResult]
