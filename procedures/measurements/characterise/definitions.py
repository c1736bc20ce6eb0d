"""Definitions of a sensor's figures of merit: the equation, and what the thesis says in chapter 2.

V: peak-to-peak voltage of a film; F: load by the load cell, peak to peak; a + b F: least-squares line through the loads
that increase; residual: what is left of the signal beside the sine, about a line through each cycle. The names of the
two linearities are those of ISA-51.1.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Definition:
    """Definition of a figure of merit.

    Attributes:
        unit: unit of the figure; "" for a ratio.
        equation: its equation.
        thesis: the thesis' section, and what it says if that differs or is no definition.
    """

    unit: str
    equation: str
    thesis: str


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """A property of section 2.1 that another command measures."""

    quantity: str
    thesis: str
    command: str


SNR, PEAK_SNR = "signal-to-noise ratio", "peak signal-to-noise ratio"
SENSITIVITY, RESOLUTION, SPATIAL_RESOLUTION = "force sensitivity", "resolution", "spatial resolution"
LINEARITY, ZERO_BASED_LINEARITY = "linearity", "zero-based linearity"
HYSTERESIS, DYNAMIC_RANGE, DRIFT = "hysteresis", "dynamic range", "drift"
SCALED = SENSITIVITY, RESOLUTION  # figures whose uncertainty is a share of them

DEFINITIONS = {
    SNR: Definition("dB", "20 lg(rms of the sine / rms of the residual)", "2.1.1, for random noise"),
    PEAK_SNR: Definition("dB", "20 lg(peak of the sine / greatest |residual|)", "2.1.1, peak over peak"),
    SENSITIVITY: Definition("V/N", "b = dV/dF", "2.1.2, 2.1.5"),
    RESOLUTION: Definition("N", "2 u(V) / b, u(V) by noise", "2.1.2 asks for 5 to 10 mN"),
    LINEARITY: Definition("", "max |V - a - b F| / (b (F_max - F_min))", "2.1.5, a straight line"),
    ZERO_BASED_LINEARITY: Definition(
        "", "max |V - c F| / (c F_max), c = sum(F V) / sum(F^2)", "2.1.5, proportional output"
    ),
    HYSTERESIS: Definition("", "max |(V - b F)_down - (V - b F)_up| / (b (F_max - F_min))", "2.1.6 asks for none"),
    DYNAMIC_RANGE: Definition("dB", "20 lg(greatest force / resolution)", "2.1, the name alone"),
    DRIFT: Definition("1/min", "slope of V / mean(V) over time, F held", "2.1.6, of temperature alone"),
    SPATIAL_RESOLUTION: Definition("m", "lesser side of the cell of one tooth", "2.1.3, size of a tactel"),
}

ELSEWHERE = (
    Elsewhere("frequency response", "2.1.4", "palpate sweep frequency"),
    Elsewhere("temperature variation", "2.1.6", "palpate sweep temperature"),
)


def elsewhere() -> list[dict[str, str]]:
    """The properties that other commands measure, under public names."""
    return [asdict(each) for each in ELSEWHERE]
