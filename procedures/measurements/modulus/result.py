"""What the compression of a sample reads and finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.findings.compression import Compression, CompressionPoint
from palpate.instrument.sensor.sample import Sample
from palpate.instrument.uncertainty.propagation import Propagated

NAMES = (
    ("tangent_modulus", "Pa"), ("secant_modulus", "Pa"), ("unloading_modulus", "Pa"), ("thickness", "m"),
    ("bench_compliance", "m_per_N"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class DisplaysPoint:
    """The indicator's displays at one place of the positioner, in a `series`: bare, loading or unloading."""

    series: str
    position_m: float
    reading_mV: float
    readings_mV: tuple[float, ...]
    incidents: int


@dataclass(frozen=True, slots=True)
class ModulusResult:
    sample: Sample
    compression: Compression

    @property
    def points(self) -> Sequence[CompressionPoint]:
        """Stress and strain, of the sample alone."""
        return self.compression.points

    @property
    def budgets(self) -> Sequence[Propagated]:
        """In the order of NAMES."""
        return self.results()

    def results(self) -> tuple[Propagated, ...]:
        """In the order of NAMES."""
        c = self.compression
        return c.tangent, c.secant, c.unloading, c.thickness, c.compliance

    def summary(self) -> dict[str, Any]:
        """Results under their public names. linearity and energy_loss are fractions."""
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
