"""The points and the result of a compression test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from palpate.instrument.findings.compression import Compression, CompressionPoint
from palpate.instrument.sensor.sample import Sample
from palpate.instrument.uncertainty.budget import Propagated
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column

NAMES = (
    ("tangent_modulus", "Pa"), ("secant_modulus", "Pa"), ("unloading_modulus", "Pa"), ("thickness", "m"),
    ("bench_compliance", "m_per_N"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class DisplaysPoint:
    """Readings of the indicator at one position."""

    series: Annotated[str, Column('"bare", "loading" or "unloading"')]
    position_m: Annotated[float, Column("position of the positioner", "m")]
    reading_mV: Annotated[float, columns.READING]
    readings_mV: columns.Readings
    incidents: columns.Incidents


@dataclass(frozen=True, slots=True)
class ModulusResult:
    """The tested sample and the evaluation of its compression."""

    sample: Sample
    compression: Compression

    @property
    def points(self) -> Sequence[CompressionPoint]:
        """Stress and strain of the sample, with the bench's compliance taken off."""
        return self.compression.points

    @property
    def budgets(self) -> Sequence[Propagated]:
        """The results with their budgets, in the order of NAMES."""
        return self.results()

    def results(self) -> tuple[Propagated, ...]:
        """The results, in the order of NAMES."""
        c = self.compression
        return c.tangent, c.secant, c.unloading, c.thickness, c.compliance

    def summary(self) -> dict[str, Any]:
        """The results for JSON; linearity and energy_loss are fractions."""
        public: dict[str, Any] = {"sample": self.sample.name}
        for (name, unit), found in zip(NAMES, self.results(), strict=True):
            public |= {f"{name}_{unit}": found.value, f"{name}_u": found.u}
        return {
            **public,
            "linearity": self.compression.linearity,
            "energy_loss": self.compression.energy_loss.value,
            "energy_loss_u": self.compression.energy_loss.u,
            "thesis_modulus_Pa": self.sample.modulus,
        }
