"""One point at the present load: the films settle, are recorded, fitted and judged. A flagged attempt is repeated.

films = Films(bench, design, frequency=10.0, largest=4.0)
...                                     # mount, preload, drive
servo.set(3.0)
point = measure(films, servo, 3.0, dwell=1.0, record=record)
point.fit.amplitude, point.flags, film_forces(design, point.fit).force_ratio
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.drivers.devices.exciter import Exciter
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.own import LONGEST_WHOLE
from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.film_forces import LEAST_SIGNAL, FilmForces, film_forces
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.signals.dwell import RequiredDwell
from palpate.instrument.signals.estimate import FEW_DEGREES, SineFit
from palpate.instrument.signals.oscilloscope import Distortion, distortion
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import Waveforms
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, FilmRecord, Films, LongFilmRecord, short_length
from palpate.procedures.steps.flags import (
    CLIPPED,
    DRIFTED,
    FAULT,
    FORCE,
    FREQUENCY,
    HUM,
    NOT_FINITE,
    SHORT,
    UNSETTLED,
    USED,
    causes,
)
from palpate.procedures.steps.policy import ATTEMPTS, carry_out
from palpate.procedures.steps.servo import READINGS, LoadServo

# --- Whether two devices that measure the same quantity agree within their uncertainties. This is checked at each point
#
# The load cell and the base films measure the force. The exciter and the nodes' clock have the drive's frequency. A
# wrong calibration, a film that came off, or an exciter that drifts does not show in the readings of one device alone.

FALSE_ALARMS = 6.3e-5  # of points that agree: 4 standard uncertainties of a normal distribution
CRYSTALS = 1e-4  # relative difference of two clocks [A]
HARMONICS = 0.01  # of a load, peak to peak [A]


def forces_differ(
    forces: FilmForces, frequency: float, load: float, load_u: float, load_freedom: float = math.inf
) -> bool:
    """Whether films and load cell measure different forces.

    Args:
        forces: forces by the films.
        frequency: frequency of the drive [Hz].
        load: load by the load cell, peak to peak [N].
        load_u: standard uncertainty of the load [N].
        load_freedom: degrees of freedom of `load_u`.
    """
    # The films' sensitivities do not contain what the charge amplifier takes away at low frequencies.
    passed = 1 / math.hypot(1.0, 1 / (2 * math.pi * frequency * CHARGE_AMPLIFIER))
    noise_u = forces.force_total_noise_u
    difference = Budget(
        "films less load cell",
        forces.force_total_N - load,
        "N",
        (
            Component("films' noise", noise_u, degrees_of_freedom=forces.degrees_of_freedom),
            Component("films' gains", math.sqrt(max(forces.force_total_u**2 - noise_u**2, 0.0))),
            Component("load cell", load_u, degrees_of_freedom=load_freedom),
        ),
    )
    return _differ(difference, (1 - passed) * load)


def loads_differ(waveform: float, waveform_u: float, load: float, load_u: float) -> bool:
    """Whether the waveform of the load indicator's output and its display tell different loads, peak to peak [N].

    Args:
        waveform, waveform_u: load by the sine of the waveform, and its standard uncertainty.
        load, load_u: load by the display, in which harmonics count.
    """
    parts = (Component("waveform", waveform_u), Component("display", load_u))
    return _differ(Budget("waveform less display", waveform - load, "N", parts), HARMONICS * load)


def frequencies_differ(films: Films, record: FilmRecord | LongFilmRecord) -> bool:
    """Whether the films swing with another frequency than was set: then their phase turns between the record's halves.

    A record of less than two cycles cannot tell.
    """
    half = record.samples // 2
    if half / record.rate * films.frequency < 1:
        return False
    try:
        first, second = (films.fit(part(half / record.rate)) for part in (record.first, record.last))
    except EstimateError:
        return False  # there are too few good samples, and other flags say so
    loudest = int(np.argmax(first.amplitude))
    if not min(first.amplitude[loudest], second.amplitude[loudest]) > 0:
        return False
    turned = math.remainder(float(second.phase[loudest] - first.phase[loudest]), 2 * math.pi)
    between = 2 * math.pi * record.between(half)
    halves = tuple(
        Component(name, float(fit.phase_u[loudest]) / between, degrees_of_freedom=fit.degrees_of_freedom)
        for name, fit in (("first half", first), ("second half", second))
    )
    off = Budget("frequency less what was set", turned / between, "Hz", halves)
    return _differ(off, CRYSTALS * films.frequency + films.frequency_step / 2)


def _differ(difference: Budget, allowed: float) -> bool:
    """Whether a difference exceeds what is allowed plus what its uncertainty explains."""
    return not abs(difference.value) <= difference.expanded(1 - FALSE_ALARMS) + allowed


# --- The load as the waveform of the load indicator's output tells it, and how the films lie in phase with it

LOAD_N, LOAD_U = "load_waveform_N", "load_waveform_u"


def load_columns(
    load: FilmRecord | LongFilmRecord, films: SineFit, design: Design, calibration: LoadCellCalibration
) -> dict[str, float | None]:
    """What the waveform of the load tells of a point, by the names of its columns.

    `load_waveform_N` is the load, peak to peak [N], and `phase_FILM_deg` is how far a film leads it [degrees];
    `load_waveform_u` [N] and `phase_FILM_u` [degrees] are their standard uncertainties. All are None where the waveform
    is clipped, or no sine can be fitted to it.

    Args:
        load: the samples of the load indicator's output.
        films: fit of the films over the same times.
        design: the sensor.
        calibration: calibration of the load cell, which holds for its output as for its display.
    """
    names = [re.sub(r"[^A-Za-z0-9]+", "_", film.name) for film in design.films]
    columns = [LOAD_N, LOAD_U, *(f"phase_{name}_{what}" for name in names for what in ("deg", "u"))]
    if load.clips.any():
        return dict.fromkeys(columns)
    try:
        fit = load.fit(films.frequency, clipped=False)
        newtons, _ = calibration.load(calibration.zero_mV + 2e3 * float(fit.unbiased[0]))
    except EstimateError:
        return dict.fromkeys(columns)
    noise_u = 2e3 * float(fit.amplitude_u[0]) / calibration.sensitivity_mV_per_N
    values = [newtons, math.hypot(noise_u, calibration.curve_u(newtons))]
    for phase, phase_u in zip(films.phase, films.phase_u, strict=True):
        lead = math.remainder(float(phase - fit.phase[0]), 2 * math.pi)
        values += [math.degrees(lead), math.degrees(math.hypot(float(phase_u), float(fit.phase_u[0])))]
    return dict(zip(columns, values, strict=True))


def doubt(columns: Mapping[str, float | None], load: float, load_u: float) -> str:
    """Why the waveform of the load is in doubt, for people; empty: it is not.

    Args:
        columns: what it tells of a point, from `load_columns`.
        load: load by the load indicator, peak to peak [N].
        load_u: its standard uncertainty [N].
    """
    newtons, u = columns.get(LOAD_N), columns.get(LOAD_U)
    if newtons is None or u is None:
        return "the waveform of the load is clipped, or no sine; check the channel of load_channel" if columns else ""
    if not loads_differ(newtons, u, load, load_u):
        return ""
    return (
        f"the waveform of the load gives {newtons:.3g} N, and the load indicator {load:.3g} N; check load_channel, "
        "that the indicator's output gives the mV that its display shows, and the zero of the load cell's calibration"
    )


# --- the point -----------------------------------------------------------------------------------------

PILOT_CYCLES = 40  # 1000 samples, which tell the power of white noise to 5 %
LARGEST_DRIFT = 0.1  # of the load, at the end of the dwell; two steps of the indicator at least
LARGEST_HUM = 0.01  # part of the hum that may be in an amplitude before the point is flagged
LARGEST_DISTORTION = 0.01  # harmonics over the drive before an event tells of them [A]
MOST_OF = 0.7  # part of an amplitude's uncertainty that is hum's: half of its variance

DwellChoice = Callable[[SineFit], RequiredDwell]


@dataclass(frozen=True, slots=True, eq=False)
class FilmPoint:
    """The films under one load, by the last attempt.

    Attributes:
        load_measured_N, load_measured_u: load by the load cell after the dwell, peak to peak, and its standard
            uncertainty.
        indicator_mV: reading of the indicator for this load.
        fit: fit of all films in the design's order, by the good samples if there are enough.
        record: the samples of all films.
        dwell_s: length of the record.
        relative_u_predicted: relative standard uncertainty for which the dwell was chosen; None: it was given.
        settling_s: time that the films took to settle.
        attempts: number of attempts.
        flags: why the point is not used, or what its record cannot tell (`flags.USED`).
        incidents: how many failures of the bench were made good since the point before.
        beside: what the waveform of the load tells, by the names of its columns; empty: no channel samples it.
    """

    load_measured_N: float
    load_measured_u: float
    indicator_mV: float
    fit: SineFit
    record: FilmRecord | LongFilmRecord
    dwell_s: float
    relative_u_predicted: float | None
    settling_s: float
    attempts: int
    flags: tuple[str, ...]
    incidents: int = 0
    beside: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def valid(self) -> bool:
        """Whether the point is used."""
        return USED.issuperset(self.flags)

    def forces(self, design: Design) -> FilmForces:
        """Forces and force ratios by the films.

        Raises:
            EstimateError: a base film gives too little for a ratio; flags of the point are named as the cause.
        """
        try:
            return film_forces(design, self.fit)
        except EstimateError as error:
            if self.valid:
                raise
            raise EstimateError(f"{causes(self.flags)} ({error})") from None

    def waveforms(self, design: Design) -> Waveforms:
        """Sample rate [Hz] and voltages [V] of each film by its name, and of the load, for the record."""
        return self.record.waveforms([film.name for film in design.films])


def measure(
    films: Films,
    servo: LoadServo,
    load: float,
    dwell: float | DwellChoice,
    record: Recorder,
    what: str = "",
    compare: bool = True,
    quick: bool = False,
) -> FilmPoint:
    """Measure the point at the load that the servo has set.

    An attempt that gets a flag is rejected and repeated, and an event of the record says why. Before the next attempt
    films that clipped are set to the widest range, and a load that drifted is set anew. The last of `ATTEMPTS` attempts
    counts, whatever its flags. Where hum cannot be separated from the drive, an event says how much of it may be in an
    amplitude.

    Args:
        films: the films of the sensor.
        servo: the servo that has set the load.
        load: the load that was set, peak to peak [N].
        dwell: length of the record [s], or how to choose it from the fit of a short record.
        record: record of the run, for events.
        what: names the point in events.
        compare: whether films and load cell must agree on the force; not where the films' sensitivity is measured.
        quick: read the load cell once instead of several times, and do not wait for it while the films settle: where
            only the ratio is sought, and the load's amplitude is known.

    Raises:
        SafetyError, DeviceError, LinkError, UnreachableError: the bench failed.
        EstimateError: the dwell gives no estimate.
    """
    named = what or f"{load:g} N"
    for attempt in range(1, ATTEMPTS + 1):
        point = carry_out(
            films.bench,
            named,
            lambda attempt=attempt: _attempt(films, servo, load, dwell, record, attempt, compare, quick),  # type: ignore[misc]
            again=lambda: servo.set(load),
        )
        if point.valid or attempt == ATTEMPTS:
            break
        record.event(
            "rejected",
            f"{named}, attempt {attempt}: {', '.join(point.flags)}",
            films.bench.clock.now_ns(),
        )
        films.widen(point.record)
        if DRIFTED in point.flags:
            carry_out(films.bench, named, lambda: servo.set(load))
    if HUM in point.flags:
        record.event(
            "hum",
            f"{named}: hum cannot be told from the drive;{_share_of_hum(point.fit)} dwell longer, or drive further from"
            " 50 and 60 Hz and from their aliases",
            films.bench.clock.now_ns(),
        )
    for film, seen in _distorted(films.design, point):
        record.event(
            "distorted",
            f"{named}: harmonics of {seen.value:.2%} (u {seen.u:.2%}) of the drive in film {film!r}, of which the fit"
            " tells nothing; lower the load, press harder before it, or check amplifier and contact",
            films.bench.clock.now_ns(),
        )
    if why := doubt(point.beside, point.load_measured_N, point.load_measured_u):
        record.event("load", f"{named}: {why}", films.bench.clock.now_ns())
    return replace(point, incidents=films.bench.incidents.new())


def _attempt(
    films: Films,
    servo: LoadServo,
    load: float,
    dwell: float | DwellChoice,
    run: Recorder,
    attempt: int,
    compare: bool,
    quick: bool,
) -> FilmPoint:
    watch, readings = (servo.glance, 1) if quick else (servo.watch, READINGS)
    short, settling, settled = films.settle(watch, dwell if isinstance(dwell, float) else None)
    heard = films.emergencies()
    record, duration, predicted_u = _recorded(films, dwell, short, run)
    reading = servo.read(readings)
    films.bench.role(Exciter).check()
    measured, measured_u = servo.calibration.load(reading.reading_mV, readings)
    measured_u = math.hypot(measured_u, reading.u_mV / servo.calibration.sensitivity_mV_per_N)
    load_freedom = float(servo.calibration.degrees_of_freedom or math.inf)
    fit = films.fit(record)
    defects = {
        CLIPPED: record.clips.any(),
        NOT_FINITE: record.gaps.any(),
        UNSETTLED: not settled,
        FAULT: films.emergencies() > heard and not (record.clips.any() or (record.load and record.load.clips.any())),
        DRIFTED: not abs(measured - load) <= max(LARGEST_DRIFT * load, 2 * servo.calibration.resolution()),
    }
    flags = [flag for flag, raised in defects.items() if raised]
    if not flags:  # a bad record is not worth more checks
        flags = _disagreements(films, record, fit, compare, measured, measured_u, load_freedom)
    if not flags:
        flags = _marks(films.design, fit)
    return FilmPoint(
        load_measured_N=measured,
        load_measured_u=measured_u,
        indicator_mV=reading.reading_mV,
        fit=fit,
        record=record,
        dwell_s=duration,
        relative_u_predicted=predicted_u,
        settling_s=settling,
        attempts=attempt,
        flags=tuple(flags),
        beside=load_columns(record.load, fit, films.design, servo.calibration) if record.load else {},
    )


def _disagreements(
    films: Films,
    record: FilmRecord | LongFilmRecord,
    fit: SineFit,
    compare: bool,
    load: float,
    load_u: float,
    load_freedom: float,
) -> list[str]:
    """Flags of devices that measure the same quantity and do not agree."""
    found = []
    if compare and forces_differ(film_forces(films.design, fit), films.frequency, load, load_u, load_freedom):
        found.append(FORCE)
    if frequencies_differ(films, record):
        found.append(FREQUENCY)
    return found


def _marks(design: Design, fit: SineFit) -> list[str]:
    """Flags for what the record cannot tell."""
    return [mark for mark, set_ in ((HUM, may_be_hum(fit)), (SHORT, is_short(design, fit))) if set_]


def may_be_hum(fit: SineFit) -> bool:
    """Whether hum may change an amplitude: it is not fitted, wanders unseen, or is too near to the drive."""
    wanders = bool((fit.hum_u > MOST_OF * fit.amplitude_u).any())
    return fit.hum > LARGEST_HUM or wanders or fit.beside_mains


def _distorted(design: Design, point: FilmPoint) -> Iterator[tuple[str, Distortion]]:
    """Names of films whose waveforms are distorted by more than noise explains, and how much."""
    _, voltage = point.record.first(min(point.dwell_s, LONGEST_WHOLE)).usable(clipped=True)
    for number, film in enumerate(design.films):
        # A record of few or uneven cycles, or with hum on its harmonics, tells no distortion.
        with contextlib.suppress(EstimateError):
            seen = distortion(point.fit, number, voltage[number])
            if seen.value > LARGEST_DISTORTION and seen.by_noise < FALSE_ALARMS:
                yield film.name, seen


def _share_of_hum(fit: SineFit) -> str:
    return f" of 1 mV of hum up to {fit.most_hum:.2g} mV may be in an amplitude;" if fit.most_hum > 0 else ""


def is_short(design: Design, fit: SineFit) -> bool:
    """Whether the uncertainty of the ratio is mostly noise, and the record is too short to know the noise well."""
    if fit.degrees_of_freedom >= FEW_DEGREES or not _all_bases_answer(design, fit):  # most fits end here
        return False
    forces = film_forces(design, fit)
    return is_mostly_noise(forces.force_ratio_u, forces.noise_u, forces.degrees_of_freedom)


def is_mostly_noise(force_ratio_u: float, noise_u: float, degrees_of_freedom: float) -> bool:
    """Whether a ratio's uncertainty has few degrees of freedom because of those of its part by noise."""
    if degrees_of_freedom >= FEW_DEGREES or noise_u == 0:
        return False
    return degrees_of_freedom * (force_ratio_u / noise_u) ** 4 < FEW_DEGREES


def _all_bases_answer(design: Design, fit: SineFit) -> bool:
    """Whether every base bears a load, so that there is a ratio: not where one tooth of several bases is pressed."""
    bases = np.array([film.kind == FILM_KINDS[1] for film in design.films])
    return bool((fit.amplitude[bases] > LEAST_SIGNAL * fit.amplitude_u[bases]).all())


def _recorded(
    films: Films, dwell: float | DwellChoice, short: SineFit, run: Recorder
) -> tuple[FilmRecord | LongFilmRecord, float, float | None]:
    """The record, its length [s], and the uncertainty for which the length was chosen.

    A short record tells the noise to a fifth, and so the dwell that is needed. If that is longer than the short record,
    a pilot record tells it to a twentieth. A pilot that is long enough is itself the record.
    """
    if isinstance(dwell, float):
        return films.recorded(dwell, run), dwell, None
    chosen = dwell(short)
    if chosen.dwell * short.rate <= short.samples * (1 + 1e-9):
        return films.recorded(chosen.dwell, run), chosen.dwell, chosen.u
    pilot = films.acquire(pilot_length(films.frequency))
    chosen = dwell(films.fit(pilot))
    enough = chosen.dwell <= pilot_length(films.frequency)
    return pilot.first(chosen.dwell) if enough else films.recorded(chosen.dwell, run), chosen.dwell, chosen.u


def pilot_length(frequency: float) -> float:
    """Length of a pilot record at a frequency [Hz], from which a dwell is chosen [s]."""
    return PILOT_CYCLES / frequency


def recording_seconds(dwell: float, frequency: float) -> float:
    """Time for a dwell [s] that is chosen at the point, with its pilot, at a frequency [Hz] [s]."""
    pilot = pilot_length(frequency)
    return dwell if dwell <= short_length(frequency) else pilot if dwell <= pilot else pilot + dwell
