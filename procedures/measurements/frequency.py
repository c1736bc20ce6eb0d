"""Frequency sweep: gain and phase of each film, the charge amplifiers' corner, and resonance (thesis 2.1.4, 6.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from palpate.instrument.calibration.films import LOAD_CELL
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError, quoted
from palpate.instrument.quantity import parse, parse_list, show
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.frequency_response import (
    TACTILE,
    Corner,
    Resonance,
    fit_corner,
    fit_resonance,
    high_pass,
    phase_lead,
)
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.engine.plan import Plan, Step, first_steps, noise_of, point_seconds
from palpate.procedures.engine.procedure import Expected, Measurement, Report, RequiredLoads, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.prospects import expected_ratio, film_noise, load_cell_of, load_on, reading_u
from palpate.procedures.measurements.settings import PeakLoad, SampleName
from palpate.procedures.measurements.work import Sweep, SweepWork
from palpate.procedures.records.columns import Column, columns_of, gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, new_table, stamped
from palpate.procedures.steps.checks import check_end, check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, check_nodes
from palpate.procedures.steps.probe import press

# --- the points and the result of a frequency sweep ----------------------------------------------------

FEWEST = 3  # least number of points for a corner


def in_touch(point: FrequencyPoint) -> str:
    """Whether a point lies within the band of touch, for its row in a table."""
    return "yes" if point.tactile else ""


@dataclass(frozen=True, slots=True)
class FilmFrequencyResponse:
    """Response of one film.

    The exciter and the nodes have no common clock, so the phase relative to the drive is unknown.
    """

    film: Annotated[str, Column("name of the film")]
    gain_V_per_N: Annotated[float, Column("voltage over load", "V/N", "mV/N", ".3g", 1e3, u="gain_u")]
    gain_u: float
    phase_deg: Annotated[
        float, Column("phase lead over the first base film; `phase_u` by noise and hum", "°", "°", "+z.2f", u="phase_u")
    ]
    phase_u: float


@dataclass(frozen=True, slots=True)
class FrequencyPoint:
    """One frequency. Loads are peak to peak."""

    frequency_Hz: Annotated[float, Column("the frequency", "Hz", "Hz", "g")]
    tactile: Annotated[bool, Column("whether it lies within the band of touch", head="touch", cell=in_touch)]
    load_measured_N: columns.PrintedLoad
    load_measured_u: float
    response_N_per_V: Annotated[
        float, Column("the measured load over the exciter's voltage", "N/V", "load/drive\nN/V", "z.3f")
    ]
    films: Annotated[tuple[FilmFrequencyResponse, ...], Column("the response of each film", each="film")]
    valid: columns.Valid
    dwell_s: columns.Dwell
    settling_s: columns.Settling
    attempts: columns.Attempts
    flags: columns.Flags


@dataclass(frozen=True, slots=True)
class FrequencyResult:
    """The result of a frequency sweep.

    Attributes:
        points: the points.
        corners: corner of each film's charge amplifier, by film; None: the sweep shows none.
        resonance: resonance of shaker, object and sensor; None: the sweep shows none.
        budgets: uncertainty budget of each corner and gain above it, and of the resonance and its damping.
    """

    points: list[FrequencyPoint]
    corners: dict[str, Corner | None]
    resonance: Resonance | None
    budgets: tuple[Budget, ...] = ()

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""
        return {
            "corners": [{"film": film, **_corner_fields(corner)} for film, corner in self.corners.items()],
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


def _corner_fields(corner: Corner | None) -> dict[str, float | None]:
    if corner is None:
        return dict.fromkeys(("gain", "gain_u", "corner_Hz", "corner_u", "time_constant_s"))
    return {**asdict(corner), "time_constant_s": corner.time_constant}


def evaluate(points: Sequence[FrequencyPoint], design: Design, calibration: LoadCellCalibration) -> FrequencyResult:
    """Find corners and resonance from the valid points; they are None if there are too few points.

    The load cell's curve shifts the load, and with it the gain, alike at all points. So it adds to the gain above a
    corner, and not to what the fits find from the differences between the points.
    """
    valid = [point for point in points if point.valid]
    frequency = [point.frequency_Hz for point in valid]
    load = np.array([point.load_measured_N for point in valid])
    curve_u = [calibration.curve_u(each) / each for each in load.tolist()]
    corners: dict[str, Corner | None] = dict.fromkeys(film.name for film in design.films)
    budgets: list[Budget] = []
    if len(valid) >= FEWEST:
        freedom = float(calibration.degrees_of_freedom or math.inf)
        for i, film in enumerate(design.films):
            gain = np.array([point.films[i].gain_V_per_N for point in valid])
            gain_u = np.array([point.films[i].gain_u for point in valid])
            corner = fit_corner(frequency, gain, np.sqrt(gain_u**2 - (gain * curve_u) ** 2))
            if corner is None:
                continue
            load_cell = Component(LOAD_CELL, calibration.mean_curve_u(load), corner.gain, freedom)
            above = Budget(f"gain of film {film.name}", corner.gain, "V/N", (_of_points(corner.gain_u), load_cell))
            corners[film.name] = replace(corner, gain_u=above.u)
            budgets += [_fitted(f"corner of film {film.name}", corner.corner_Hz, corner.corner_u, "Hz"), above]
    resonance = None
    if len(valid) > FEWEST:
        response = np.array([point.response_N_per_V for point in valid])
        load_u = np.array([point.load_measured_u for point in valid])
        resonance = fit_resonance(frequency, response, response * np.sqrt((load_u / load) ** 2 - np.square(curve_u)))
    if resonance is not None:
        budgets.append(_fitted("resonance", resonance.frequency_Hz, resonance.frequency_u, "Hz"))
        budgets.append(_fitted("damping ratio", resonance.damping, resonance.damping_u, ""))
    return FrequencyResult(list(points), corners, resonance, tuple(budgets))


def _fitted(quantity: str, value: float, u: float, unit: str) -> Budget:
    """The budget of a quantity that the differences between the points alone make uncertain."""
    return Budget(quantity, value, unit, (_of_points(u),))


def _of_points(u: float) -> Component:
    return Component("points of the sweep", u)


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
        return Plan(self.name, steps, predicted(steps, self._expected(target)))

    def _expected(self, target: Target) -> list[Expected]:
        """Relative uncertainties of each film's corner and gain; none for a film whose corner the sweep would not show.

        Both come from the fit of the sweep itself, for gains without an error of their own. A film's gain scatters as
        the design says [M], noise is that of usual films [A], and the corner is that of usual charge amplifiers [A]. No
        resonance is expected: whether the sweep shows one is for the run to tell.
        """
        design, cell = target.design, load_cell_of(target)
        ratio, curve_u = expected_ratio(design, self.sample), cell.mean_curve_u(np.array([self.load]))
        dwells = [dwell_at(frequency, self.dwell) for frequency in self.frequencies]
        corner = 1 / (2 * math.pi * CHARGE_AMPLIFIER)
        passed = np.exp(high_pass(np.asarray(self.frequencies, dtype=np.float64), 0.0, corner))
        found = []
        for film in design.films:
            force = load_on(design, film, ratio, self.load)
            noise = film_noise(film, force, 1.0, noise_of(design)) / np.sqrt(dwells) / passed
            u = np.sqrt(film.scatter**2 + noise**2 + reading_u(cell, self.load) ** 2)
            fitted = fit_corner(self.frequencies, passed, passed * u)
            if fitted is not None:
                found.append(Expected(f"corner of film {film.name}", fitted.corner_u / fitted.corner_Hz))
                found.append(Expected(f"gain of film {film.name}", math.hypot(fitted.gain_u / fitted.gain, curve_u)))
        return found

    def begin(self, plan: Plan[FrequencyStep], lab: Lab, record: Recorder) -> FrequencySweepWork:
        return FrequencySweepWork(lab, record, self)

    def evaluate(self, points: Sequence[FrequencyPoint], plan: Plan[FrequencyStep], lab: Lab) -> FrequencyResult:
        return evaluate(points, lab.design, lab.calibration)

    def report(self, result: FrequencyResult, lab: Lab) -> Report:
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
        point = point_of(self.lab.design, step.frequency_Hz, measured, self.servo.amplitude)
        return self.measurement(point, measured)


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


def point_of(design: Design, frequency: float, measured: FilmPoint, amplitude: float) -> FrequencyPoint:
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


# --- what it shows -------------------------------------------------------------------------------------


def show_sweep(result: FrequencyResult, design: Design, outcome: Outcome) -> list[object]:
    """Gains and phases, the corner of each film, and the resonance."""
    title = "Gain (mV/N) and phase (degrees, before the first base film)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(FrequencyPoint))
    corners = new_table(
        stamped(outcome["simulated"], "Charge amplifiers: corner of each film"),
        "film", "corner\nHz", "u", "time constant\ns", "gain above it\nmV/N", "u",
    )  # fmt: skip
    for name, c in result.corners.items():
        if c is None:
            corners.add_row(name, "not seen", "-", "-", "-", "-")
        else:
            corners.add_row(
                name, f"{c.corner_Hz:z.4f}", f"{c.corner_u:z.4f}", f"{c.time_constant:z.3f}", f"{1e3 * c.gain:z.3f}",
                f"{1e3 * c.gain_u:z.3f}",
            )  # fmt: skip
    r = result.resonance
    below = (
        "resonance      none within the sweep"
        if r is None
        else f"resonance      {r.frequency_Hz:z.1f} Hz, u = {r.frequency_u:z.1f} Hz, damping ratio {r.damping:z.2f}"
    )
    touch = f"touch          within the band of touch, to {TACTILE:g} Hz"
    unseen = {"not seen": "the sweep does not reach low enough, or has too few valid points"}
    return [
        points, *legend(points), *([touch] if any(p.tactile for p in result.points) else []), corners,
        *legend(corners, marks=unseen), below,
    ]  # fmt: skip


def plot_sweep(result: FrequencyResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot gains and phases with the band of touch, and the drive's response; returns the PNG file."""
    figure, (left, middle, right) = new_figure(simulated, 3, f"frequency response, design {design.name}")
    frequency = [p.frequency_Hz for p in result.points]
    for i, (marker, film) in enumerate(zip(itertools.cycle(MARKERS), design.films)):
        responses = [p.films[i] for p in result.points]
        look: dict[str, Any] = {"marker": marker, "ms": 4, "lw": 1, "capsize": 2}
        left.errorbar(frequency, *with_u(responses, "gain_V_per_N", 1e3), **look, label=film.name)
        middle.errorbar(frequency, *with_u(responses, "phase_deg"), **look)
        corner = result.corners[film.name]
        if corner is not None:
            left.axvline(corner.corner_Hz, color=f"C{i % 10}", lw=1, ls=":", label="" if i else "corner")
    response = [p.response_N_per_V for p in result.points]
    u = [p.response_N_per_V * p.load_measured_u / p.load_measured_N for p in result.points]
    right.errorbar(frequency, response, u, fmt="ko-", ms=4, lw=1, capsize=2)
    for ax in (left, middle, right):
        ax.set_xscale("log")
        ax.axvspan(min(*frequency, TACTILE), TACTILE, color="tab:green", alpha=0.08, label=f"touch, to {TACTILE:g} Hz")
        ax.set_xlabel("frequency (Hz)")
    left.set_yscale("log")
    left.set_ylabel("gain (mV/N; bars: u)")
    middle.set_ylabel("phase before first base film (°; bars: u)")
    right.set_ylabel("load for the drive (N/V; bars: u of the load)")
    name_all(left)
    return save(figure, folder)
