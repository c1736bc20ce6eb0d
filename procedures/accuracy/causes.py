"""Possible causes of the difference between models and experiments, by the models and by the readings themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from palpate.instrument.models.validation import SIGN, Validation, measured_designs, validate
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.accuracy import readings, stiffening, what_if
from palpate.procedures.console.progress import Progress
from palpate.procedures.reproduce.solutions import Solutions

# All rubber as in 5.3, and as the calibration of Table 5.1 would have it; least and greatest load of 5.4 [N].
TIMES, LOADS = (1.0, 9.5), (1.5, 4.0)
JUDGED = "surface"


@dataclass(frozen=True, slots=True)
class Stiffening:
    """Springs that stiffen, on one sensor: the mean over the samples of their force ratio over that of linear ones.

    Attributes:
        times: all moduli are so many times those of the thesis.
        force: [N].
    """

    times: float
    force: float
    over_linear: float


@dataclass(frozen=True, slots=True)
class Gain:
    """One factor for all readings of an arrangement, as a wrong sensitivity of its films would be.

    Attributes:
        factor: geometric mean over the samples of model over measured.
        left: rms of what the factor leaves [percent].
    """

    design: str
    factor: float
    left: float


@dataclass(frozen=True, slots=True)
class Causes:
    """All results of `palpate accuracy validation --what-if`."""

    effects: tuple[what_if.Effect, ...]
    measured_contrasts: Mapping[str, float]
    stiffening: tuple[Stiffening, ...]
    gains: tuple[Gain, ...]
    readings: tuple[readings.Copied, ...]

    @classmethod
    def of(cls, solutions: Solutions, progress: Progress) -> Self:
        """Compute all causes, from the models and from the thesis' tables. Raises EstimateError."""
        return cls(
            effects=tuple(what_if.effects(solutions, progress)),
            measured_contrasts=what_if.measured_contrasts(),
            stiffening=tuple(_stiffened(times, force) for times in TIMES for force in LOADS),
            gains=tuple(_gain(validate(design, "physical", JUDGED)) for design in measured_designs()),
            readings=tuple(readings.copied()),
        )

    def record(self) -> dict[str, Any]:
        """Under public names."""
        gains: list[Mapping[str, Any]] = [
            {"design": gain.design, "factor": gain.factor, "left_rms_percent": gain.left} for gain in self.gains
        ]
        return {
            "sign": SIGN,
            "what_if": [effect.record() for effect in self.effects],
            "measured_pair_over_single": dict(self.measured_contrasts),
            "stiffening": [
                {"moduli_times": each.times, "load_N": each.force, "ratio_over_linear": each.over_linear}
                for each in self.stiffening
            ],
            "gains": gains,
            "readings": [asdict(each) for each in self.readings],
        }


def _stiffened(times: float, force: float) -> Stiffening:
    from palpate.instrument.models.foundation import springs

    design = get_design(what_if.ONE)
    over = [
        stiffening.force_ratio(design, sample, force, times) / springs.force_ratio(design, sample)
        for sample in SAMPLES.values()
    ]
    return Stiffening(times, force, math.fsum(over) / len(over))


def _gain(found: Validation) -> Gain:
    logs = [math.log1p(value / 100) for value in found.percent.values()]
    factor = math.exp(math.fsum(logs) / len(logs))
    left = [(1 + value / 100) / factor - 1 for value in found.percent.values()]
    return Gain(found.design, factor, 100 * math.sqrt(math.fsum(value**2 for value in left) / len(left)))
