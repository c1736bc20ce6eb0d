"""What the waveforms of a simulated sweep show, as they were recorded: the oscilloscope's reading, and distortion."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.signals.oscilloscope import Distortion, Oscilloscope, ScopeReading, distortion
from palpate.procedures.records.run import Run
from palpate.procedures.steps.agreement import FALSE_ALARMS

SCOPE = Oscilloscope()


@dataclass(frozen=True, slots=True)
class PointTraces:
    """What the waveforms of one point show.

    Attributes:
        load_mV: the oscilloscope's reading of the load in mV of the load cell. A run records no waveform of that; it
            is the sum of the base films' forces, by the line of Table 5.1 without its zero, since the signal is AC.
        distortions: of each film.
    """

    load_mV: ScopeReading
    distortions: tuple[Distortion, ...]


Traces = Mapping[tuple[str, float], PointTraces]  # by sample and load [N]


def read_traces(folder: Path, design: Design, frequency: float) -> Traces:
    """What the waveforms of a recorded load sweep show. Raises RecordError, EstimateError."""
    run, found = Run.open(folder), {}
    by_point = itertools.groupby(run.waveforms(), key=lambda waveform: waveform.point_id)
    for point, (_, waveforms) in zip(run.points(), by_point, strict=True):
        several = {waveform.name: waveform for waveform in waveforms}
        rate = several[design.films[0].name].rate
        volts = np.array([several[film.name].samples for film in design.films], dtype=np.float64)
        bases = [number for number, film in enumerate(design.films) if film.kind == FILM_KINDS[1]]
        force = sum(volts[number] / design.films[number].sensitivity for number in bases)
        fit = fit_sine(np.arange(volts.shape[1]) / rate, volts, frequency)
        found[point["sample"], point["load_N"]] = PointTraces(
            SCOPE.read(rate, THESIS_LOAD_CELL.sensitivity_mV_per_N * force, frequency),
            tuple(distortion(fit, number, each) for number, each in enumerate(volts)),
        )
    return found


def traces_said(design: Design, points: Mapping[str, PointTraces]) -> str:
    """Sentence on what the oscilloscope shows, and on the distortion of every film by sample (thesis 5.4.1)."""
    told = "; ".join(
        f"{film.name} " + ", ".join(_said(key, traces.distortions[number]) for key, traces in points.items())
        for number, film in enumerate(design.films)
    )
    why = "* more than noise explains" if "*" in told else "noise explains all of it: no effect of this scene distorts"
    return (
        "our oscilloscope shows the base films' force in mV of the load cell, one sweep on 8 bits. Total harmonic"
        f" distortion in percent (u), by film and sample: {told} ({why}; the thesis saw it under samples 2 and 5)"
    )


def _said(sample: str, seen: Distortion) -> str:
    return f"{sample}: {100 * seen.value:.3f} ({100 * seen.u:.3f}){'*' * (seen.by_noise < FALSE_ALARMS)}"
