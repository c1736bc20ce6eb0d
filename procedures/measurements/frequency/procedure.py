"""Frequency sweep: gain and phase of each film, the charge amplifiers' corner, and resonance (thesis 2.1.4, 6.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError, quoted
from palpate.instrument.quantity import parse, parse_list, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.frequency_response import TACTILE, fit_corner, high_pass, phase_lead
from palpate.procedures.engine.plan import Plan, Step, first_steps, noise_of, point_seconds
from palpate.procedures.engine.procedure import Measurement, Report, RequiredLoads
from palpate.procedures.engine.promise import Expected, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.frequency.result import (
    FEWEST,
    FilmFrequencyResponse,
    FrequencyPoint,
    FrequencyResult,
    evaluate,
)
from palpate.procedures.measurements.prospects import expected_ratio, film_noise, load_cell_of, load_on, reading_u
from palpate.procedures.measurements.settings import PeakLoad, SampleName
from palpate.procedures.measurements.sweep import Sweep, SweepWork
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_end, check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, check_nodes
from palpate.procedures.steps.probe import press

# --- What a frequency sweep is expected to give: the corner of each film and its gain above it ---------
#
# Both come from the fit of the sweep itself, for gains without an error of their own. A film's gain scatters as the
# design says [M], noise is that of usual films [A], and the corner is that of usual charge amplifiers [A]. No
# resonance is expected: whether the sweep shows one is for the run to tell.


def expected_corners(
    design: Design,
    ratio: float,
    frequencies: Sequence[float],
    dwells: Sequence[float],
    load: float,
    cell: LoadCellCalibration,
) -> list[Expected]:
    """Relative uncertainties of each film's corner and gain; none for a film whose corner the sweep would not show.

    Args:
        design: design of the sensor.
        ratio: expected force ratio of the sample.
        frequencies: frequencies of the points [Hz].
        dwells: dwell of each [s].
        load: load, peak to peak [N].
        cell: calibration of the load cell.
    """
    curve_u = cell.mean_curve_u(np.array([load]))
    corner = 1 / (2 * math.pi * CHARGE_AMPLIFIER)
    passed = np.exp(high_pass(np.asarray(frequencies, dtype=np.float64), 0.0, corner))
    found = []
    for film in design.films:
        noise = film_noise(film, load_on(design, film, ratio, load), 1.0, noise_of(design)) / np.sqrt(dwells) / passed
        u = np.sqrt(film.scatter**2 + noise**2 + reading_u(cell, load) ** 2)
        fitted = fit_corner(frequencies, passed, passed * u)
        if fitted is not None:
            found.append(Expected(f"corner of film {film.name}", fitted.corner_u / fitted.corner_Hz))
            found.append(Expected(f"gain of film {film.name}", math.hypot(fitted.gain_u / fitted.gain, curve_u)))
    return found


# --- the procedure -------------------------------------------------------------------------------------

DEFAULT = "0.1 Hz:100 Hz:13"
RANGE = (0.1, 100.0)  # Hz
GRID = 1e-3  # Hz, to which frequencies that are spread over a range are rounded
MOST = 200  # greatest number of frequencies
CYCLES = 3  # least number of cycles in a dwell


@dataclass(frozen=True, slots=True)
class FrequencyStep(Step):
    """One frequency."""

    frequency_Hz: float


@dataclass(frozen=True)
class FrequencySweep(Sweep[FrequencyStep, FrequencyPoint, FrequencyResult]):
    """Find gain and phase of each film over frequency, the charge amplifiers' corner, and a resonance."""

    name = "sweep-frequency"
    point = FrequencyPoint
    resumable_on_real_bench = True

    frequencies: Annotated[
        tuple[float, ...],
        Setting(
            "Hz",
            "Frequencies of the load: first:last:count, logarithmic, or a list.",
            parse_frequencies,
            default=DEFAULT,
        ),
    ] = field(default_factory=lambda: parse_frequencies(DEFAULT))
    sample: SampleName = "1"
    load: PeakLoad = 2.0
    dwell: Annotated[float, Setting("s", "Shortest time at a point; at least three cycles.")] = 1.0

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: a frequency is outside 0.1 to 100 Hz or between the exciter's steps, there are too few of
                them, the load exceeds the force limit, the dwell is not finite, or the bench has too few sensor nodes.
            UnknownName: there is no such sample.
        """
        check_nodes(target.design, target.nodes, target.channels)
        get_sample(self.sample)
        check_force((self.load,), target.force_limit)
        check_end(self.dwell)
        if len(self.frequencies) < FEWEST:
            raise RangeError(f"a corner takes {FEWEST} frequencies or more, not {len(self.frequencies)}; give more")
        check_increasing("frequencies", self.frequencies, "Hz")
        for frequency in self.frequencies:
            check_frequency(frequency, target, RANGE)
            check_time(dwell_at(frequency, self.dwell), frequency)

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads((self.load,), self.extrapolate)

    def plan(self, target: Target) -> Plan[FrequencyStep]:
        """All points: every frequency, from low to high."""
        steps: list[FrequencyStep] = []
        for frequency in self.frequencies:
            dwell = dwell_at(frequency, self.dwell)
            seconds = point_seconds(frequency, dwell, not steps, first_steps(self.load), target.mounts)
            what, group = show(frequency, "Hz"), f"mount sample {self.sample}"
            steps.append(FrequencyStep(dwell, seconds, None, frequency, what=what, group=group))
        ratio = expected_ratio(target.design, self.sample)
        dwells = [dwell_at(frequency, self.dwell) for frequency in self.frequencies]
        cell = load_cell_of(target)
        found = expected_corners(target.design, ratio, self.frequencies, dwells, self.load, cell)
        return Plan(self.name, steps, predicted(steps, found))

    def begin(self, plan: Plan[FrequencyStep], lab: Lab, record: Recorder) -> FrequencySweepWork:
        return FrequencySweepWork(lab, record, self)

    def evaluate(self, points: Sequence[FrequencyPoint], plan: Plan[FrequencyStep], lab: Lab) -> FrequencyResult:
        return evaluate(points, lab.design, lab.calibration)

    def report(self, result: FrequencyResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.frequency.report import plot_sweep, show_sweep

        simulated = lab.bench.simulated
        return Report(partial(show_sweep, result, lab.design), partial(plot_sweep, result, lab.design, simulated))


class FrequencySweepWork(SweepWork):
    """The bench work: one load on one sample, set again at each frequency."""

    def __init__(self, lab: Lab, record: Recorder, sweep: FrequencySweep) -> None:
        for frequency in sweep.frequencies:
            lab.bench.check_frequency(frequency)
        super().__init__(lab, record, sweep, (sweep.load,), sweep.frequencies[0], (sweep.sample,))
        self._sweep = sweep
        self._preloaded = 0.0

    def arrange(self, step: FrequencyStep) -> None:
        sample = get_sample(self._sweep.sample)
        self._preloaded = press(self.lab.bench, self.lab.calibration, sample, self.preload)

    def take(self, step: FrequencyStep) -> Measurement[FrequencyPoint]:
        self.films.set_frequency(step.frequency_Hz)
        self.hold(self._preloaded)
        dwell = dwell_at(step.frequency_Hz, self._sweep.dwell)
        measured = self.measured(self._sweep.load, step.what, dwell, compare=False)
        point = _point(self.lab.design, step.frequency_Hz, measured, self.servo.amplitude)
        return Measurement(point, measured.waveforms(self.lab.design))


def parse_frequencies(text: str) -> tuple[float, ...]:
    """Frequencies from a text [Hz].

    The text is a list as "1 Hz, 10 Hz", or "0.1 Hz:100 Hz:16" with first, last and number of frequencies, which are
    spaced evenly in the logarithm and rounded to 1 mHz between the ends.

    Raises:
        QuantityError: a part is no frequency.
        RangeError: the frequencies do not increase, or there are fewer than 3 or more than 200.
    """
    parts = text.split(":")
    if len(parts) == 3:
        first, last, count = parse(parts[0], "Hz"), parse(parts[1], "Hz"), parse(parts[2], "", "16")
        if not (0 < first < last and count == round(count) and FEWEST <= count <= MOST):
            raise RangeError(
                f"frequencies {quoted(text)}: give first:last:count with first < last and a count of {FEWEST} to {MOST}"
            )
        even = np.geomspace(first, last, round(count))
        inner = (round(float(f) / GRID) * GRID for f in even[1:-1])
        found = (first, *(round(f, 9) for f in inner), last)
    elif len(parts) == 1:
        found = parse_list(text, "Hz")
    else:
        raise RangeError(f"frequencies {quoted(text)}: give first:last:count, such as '0.1 Hz:100 Hz:16', or a list")
    if list(found) != sorted(set(found)):
        raise RangeError(f"frequencies {quoted(text)}: they must increase, each by {GRID:g} Hz or more")
    if not FEWEST <= len(found) <= MOST:
        raise RangeError(
            f"frequencies {quoted(text)}: {len(found)} frequencies; give {FEWEST} to {MOST} to find a corner"
        )
    return found


def dwell_at(frequency: float, shortest: float) -> float:
    """Dwell of whole cycles at a frequency: at least three, and at least `shortest` [s]."""
    return max(CYCLES, math.ceil(shortest * frequency * (1 - 1e-9))) / frequency


def _point(design: Design, frequency: float, measured: FilmPoint, amplitude: float) -> FrequencyPoint:
    fit = measured.fit
    reference = next(i for i, film in enumerate(design.films) if film.kind == FILM_KINDS[1])
    relative_u = fit.amplitude_u / np.where(fit.amplitude > 0, fit.amplitude, np.nan)
    films = []
    for i, film in enumerate(design.films):
        gain = 2 * float(fit.amplitude[i]) / measured.load_measured_N
        phase, phase_u = phase_lead(fit, i, reference)
        load_u = measured.load_measured_u / measured.load_measured_N
        relative = math.hypot(film.scatter, float(relative_u[i]), load_u)
        films.append(
            FilmFrequencyResponse(film.name, gain, gain * relative, math.degrees(phase), math.degrees(phase_u))
        )
    return gathered(
        FrequencyPoint, measured,
        frequency_Hz=frequency,
        tactile=frequency <= TACTILE,
        response_N_per_V=measured.load_measured_N / (2 * amplitude),
        films=tuple(films),
    )  # fmt: skip
