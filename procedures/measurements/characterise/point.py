"""The points of a characterisation, and what those at one load tell together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from palpate.instrument.signals.rapid_noise import of_greatest
from palpate.instrument.uncertainty.budget import Component
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column

LEAST_LOADS = 3  # for a line with its scatter
LOADING, UNLOADING, HOLDING = "loading", "unloading", "holding"


@dataclass(frozen=True, slots=True)
class FilmsPoint:
    """All films under one load. Loads and voltages are peak to peak."""

    direction: Annotated[str, Column('"loading", "unloading" or "holding"')]
    time_s: Annotated[float, Column("time since the load is held; 0 before that", "s")]
    load_N: columns.AskedLoad
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    voltages_V: columns.Volts
    voltages_u: tuple[float, ...]
    noise_V: Annotated[tuple[float, ...], Column("rms of each film's noise", "V", u="noise_u")]
    noise_u: tuple[float, ...]
    noise_freedom: Annotated[float, Column("degrees of freedom of `noise_u`")]
    noise_peak_V: Annotated[tuple[float, ...], Column("greatest value of each film's noise", "V")]
    samples: Annotated[int, Column("number of samples in the record")]
    valid: columns.Valid
    flags: columns.Flags
    attempts: columns.Attempts = 1
    incidents: columns.Incidents = 0
    seconds: columns.LapSeconds = None


@dataclass(frozen=True, slots=True)
class Top:
    """A film in all records at the greatest load [V], and how uncertain that is, as `Sources` has it."""

    volts: float
    noise_V: float
    peak_V: float
    records: int
    samples: int
    amplitude: Component
    residual: Component
    greatest: Component


def at_top(points: Sequence[FilmsPoint], number: int) -> Top:
    """A film, by its number in the design, in all records at the greatest load."""
    volts, volts_u, noise, noise_u, peak = (
        np.array([getattr(p, name)[number] for p in points])
        for name in ("voltages_V", "voltages_u", "noise_V", "noise_u", "noise_peak_V")
    )
    count, samples = len(points), points[-1].samples
    amplitude_u = float(np.linalg.norm(volts_u) / volts.sum())
    residual_u = float(np.linalg.norm(noise * noise_u) / (noise @ noise))
    known = math.fsum(p.noise_freedom for p in points)
    return Top(
        volts=float(volts.mean()),
        noise_V=math.sqrt(float(np.mean(noise**2))),
        peak_V=float(peak.mean()),
        records=count,
        samples=samples,
        amplitude=Component("amplitude", amplitude_u, kind="A"),
        residual=Component("noise, as measured", residual_u, 1.0, known, "A"),
        greatest=Component("greatest of the noise", of_greatest(samples) / math.sqrt(count), kind="A"),
    )


def means(points: Sequence[FilmsPoint], number: int) -> dict[float, tuple[float, float]]:
    """Mean measured load [N] and mean voltage of a film [V], by the load that was asked for [N]."""
    found = {}
    for load in dict.fromkeys(p.load_N for p in points):
        at = [(p.load_measured_N, p.voltages_V[number]) for p in points if p.load_N == load]
        loads, volts = zip(*at, strict=True)
        found[load] = math.fsum(loads) / len(at), math.fsum(volts) / len(at)
    return found
