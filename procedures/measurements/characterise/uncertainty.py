"""What makes each figure of merit of a film uncertain, whether it was measured or is expected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.uncertainty.budget import Component
from palpate.procedures.measurements.characterise import definitions as named

DECIBELS = 20 / math.log(10)  # of a relative change


@dataclass(frozen=True, slots=True)
class Sources:
    """What a film's figures of merit are uncertain by. Components are relative to what they are of, but for `scatter`.

    Attributes:
        line: the slope of the line through the loads.
        cell: the load cell's sensitivity.
        noise: noise of an amplitude, in the mean over the loads.
        amplitude, residual, greatest: amplitude at the greatest load, rms and greatest value of the residual there.
        scatter: voltage of one load set about the line.
        typical, top: root mean square of the voltages, and that at the greatest load, in the unit of `scatter`.
        span: rise of the line from the least to the greatest load, in the unit of `scatter`.
        rounds: how often each load was set on the way up; on the way down it is set once.
        drift: slope of the amplitude under a load that is held [1/min].
        by_converter: whether the converter ends the dynamic range. Then the slope is in both of its ends and cancels.
    """

    line: Component
    cell: Component
    noise: Component
    amplitude: Component
    residual: Component
    greatest: Component
    scatter: Component
    typical: float
    top: float
    span: float
    rounds: float
    drift: Component
    by_converter: bool = False


def components(of: Sources) -> dict[str, tuple[Component, ...]]:
    """The components of each figure of merit. `factor` makes them contributions in the figure's unit."""

    def part(name: str, sets: float, whole: float) -> Component:
        return replace(of.scatter, name=name, u=of.scatter.u * math.sqrt(sets) / whole)

    mean = 1 / of.rounds
    gain = part("gain of a load set", mean, of.typical)  # gains scatter by a share of the load
    slope = of.line, of.cell
    return {
        named.SNR: (of.amplitude, gain, of.residual),
        named.PEAK_SNR: (of.amplitude, gain, of.greatest),
        named.SENSITIVITY: slope,
        named.RESOLUTION: (*slope, of.noise),
        named.LINEARITY: (part("scatter of a load", mean, of.span),),
        named.ZERO_BASED_LINEARITY: (part("scatter of a load", mean, of.top),),
        named.HYSTERESIS: (part("scatter of two loads", mean + 1, of.span),),
        named.DYNAMIC_RANGE: (*(() if of.by_converter else slope), of.noise),
        named.DRIFT: (of.drift,),
    }


def factor(quantity: str, value: float) -> float:
    """What a component is multiplied with to be a contribution to a figure of some value."""
    if named.DEFINITIONS[quantity].unit == "dB":
        return DECIBELS
    return value if quantity in named.SCALED else 1.0


def cell_component(calibration: LoadCellCalibration) -> Component:
    """Relative uncertainty of a slope by the load cell's sensitivity."""
    known = float(calibration.degrees_of_freedom or math.inf)
    return Component("load cell", calibration.sensitivity_u / calibration.sensitivity_mV_per_N, 1.0, known)


def noise_component(scatter: float, records: int, samples: int) -> Component:
    """Noise of an amplitude, in the mean over several records.

    A film that still settles has more noise in one record than in another, and more than random noise would differ.

    Args:
        scatter: relative standard deviation of the noise of single records.
        records: number of records.
        samples: number of samples in all of them.
    """
    scattered, random = scatter / math.sqrt(records), 1 / math.sqrt(2 * samples)
    freedom = records - 1 if scattered > random else math.inf
    return Component("noise, as measured", max(scattered, random), 1.0, freedom, "A")
