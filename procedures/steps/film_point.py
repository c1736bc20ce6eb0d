"""One point at the present load: the films settle, are recorded, fitted and judged; what is flagged is repeated.

films = Films(bench, design, frequency=10.0, largest=4.0)
...                                     # mount, preload, drive
servo.set(3.0)
point = measure(films, servo, 3.0, dwell=1.0, record=record)
point.fit.amplitude, point.flags, film_forces(design, point.fit).force_ratio
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.drivers.roles import Exciter
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.dwell import Dwell
from palpate.instrument.signals.estimate import FEW_DEGREES, SineFit
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.agreement import forces_differ, frequencies_differ
from palpate.procedures.steps.films import FilmRecord, Films, short_length
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
)
from palpate.procedures.steps.indicator import READINGS
from palpate.procedures.steps.policy import ATTEMPTS, carry_out
from palpate.procedures.steps.servo import LoadServo

PILOT_CYCLES = 40  # 1000 samples: 5 % of the power of white noise
LARGEST_DRIFT = 0.1  # of the load, by the end of the dwell; never finer than two steps of the indicator
LARGEST_HUM = 0.01  # of the hum in an amplitude, above which a point is marked
MOST_OF = 0.7  # of an amplitude's uncertainty, half of its variance, that is hum's

Floats = npt.NDArray[np.float64]
DwellChoice = Callable[[SineFit], Dwell]


@dataclass(frozen=True, slots=True, eq=False)
class FilmPoint:
    """The films under one load, as the last attempt has them.

    Attributes:
        load_N, load_u: by the load cell after the dwell, peak to peak; `indicator_mV` is its reading.
        fit: of all films in the design's order, by the good samples alone where they suffice.
        dwell, settling: that the attempt took [s].
        predicted_u: relative standard uncertainty that the dwell was chosen for; None: it was not chosen.
        attempts: how many there were.
        flags: why the last one is not to be used, and what its record cannot tell (`USED`).
        incidents: how often something went wrong on the bench since the point before and was made good.
    """

    load_N: float
    load_u: float
    indicator_mV: float
    fit: SineFit
    record: FilmRecord
    dwell: float
    predicted_u: float | None
    settling: float
    attempts: int
    flags: tuple[str, ...]
    incidents: int = 0

    @property
    def valid(self) -> bool:
        return USED.issuperset(self.flags)

    def waveforms(self, design: Design) -> dict[str, tuple[float, Floats]]:
        """For the record: rate and samples of each film by its name."""
        return {
            film.name: (self.record.rate, volts) for film, volts in zip(design.films, self.record.voltage, strict=True)
        }


def measure(
    films: Films,
    servo: LoadServo,
    load: float,
    dwell: float | DwellChoice,
    record: Recorder,
    what: str = "",
    compare: bool = True,
) -> FilmPoint:
    """The point at the present load, `load` N peak to peak, which `servo` has set.

    A flagged attempt is rejected, with an event of the record that says why, and repeated: clipped films on the wide
    range, a load that drifted off set anew. After `ATTEMPTS` the last one stands, with its flags. Where hum would not
    be told from the drive an event says how much of it may be in an amplitude.

    Args:
        dwell: s, or how to choose it from the fit of the last short record.
        what: names the point in events.
        compare: flag films that tell of another force than the load cell; not where their sensitivity is measured.

    Raises:
        SafetyError, DeviceError, LinkError, UnreachableError: the bench could not.
        EstimateError: the dwell gives no estimate.
    """
    named = what or f"{load:g} N"
    for attempt in range(1, ATTEMPTS + 1):
        point = carry_out(
            films.bench,
            named,
            lambda attempt=attempt: _attempt(films, servo, load, dwell, attempt, compare),  # type: ignore[misc]
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
    return replace(point, incidents=films.bench.incidents.new())


def _attempt(
    films: Films, servo: LoadServo, load: float, dwell: float | DwellChoice, attempt: int, compare: bool
) -> FilmPoint:
    short, settling, settled = films.settle(servo.watch, dwell if isinstance(dwell, float) else None)
    heard = films.emergencies()
    record, duration, predicted_u = _recorded(films, dwell, short)
    reading = servo.read()
    films.bench.role(Exciter).check()
    measured, measured_u = servo.calibration.load(reading.reading_mV, READINGS)
    known = float(servo.calibration.degrees_of_freedom or math.inf)
    fit = films.fit(record)
    defects = {
        CLIPPED: record.clipped.any(),
        NOT_FINITE: not np.isfinite(record.voltage).all(),
        UNSETTLED: not settled,
        FAULT: films.emergencies() > heard and not record.clipped.any(),
        DRIFTED: not abs(measured - load) <= max(LARGEST_DRIFT * load, 2 * servo.calibration.resolution()),
    }
    flags = [flag for flag, raised in defects.items() if raised]
    if not flags:  # of a bad record nothing more is to be said
        flags = _disagreements(films, record, fit, compare, measured, measured_u, known)
    if not flags:
        flags = _marks(films.design, fit)
    return FilmPoint(
        load_N=measured,
        load_u=measured_u,
        indicator_mV=reading.reading_mV,
        fit=fit,
        record=record,
        dwell=duration,
        predicted_u=predicted_u,
        settling=settling,
        attempts=attempt,
        flags=tuple(flags),
    )


def _disagreements(
    films: Films, record: FilmRecord, fit: SineFit, compare: bool, load: float, load_u: float, known: float
) -> list[str]:
    """Flags where two devices know one quantity and do not agree."""
    found = []
    if compare and forces_differ(film_forces(films.design, fit), films.frequency, load, load_u, known):
        found.append(FORCE)
    if frequencies_differ(films, record):
        found.append(FREQUENCY)
    return found


def _marks(design: Design, fit: SineFit) -> list[str]:
    """What the record cannot tell."""
    return [mark for mark, set_ in ((HUM, may_be_hum(fit)), (SHORT, is_short(design, fit))) if set_]


def may_be_hum(fit: SineFit) -> bool:
    """Whether hum may have an amplitude wrong: it has no columns, wanders unseen, or is too near to the drive."""
    wanders = bool((fit.hum_u > MOST_OF * fit.amplitude_u).any())
    return fit.hum > LARGEST_HUM or wanders or fit.beside_mains


def _share_of_hum(fit: SineFit) -> str:
    return f" of 1 mV of hum up to {fit.most_hum:.2g} mV may be in an amplitude;" if fit.most_hum > 0 else ""


def is_short(design: Design, fit: SineFit) -> bool:
    """Whether the ratio's uncertainty is mostly noise that so short a record knows badly."""
    if fit.degrees_of_freedom >= FEW_DEGREES:
        return False
    forces = film_forces(design, fit)
    if forces.noise_u == 0:
        return False
    freedom = forces.degrees_of_freedom * (forces.force_ratio_u / forces.noise_u) ** 4
    return freedom < FEW_DEGREES


def _recorded(films: Films, dwell: float | DwellChoice, short: SineFit) -> tuple[FilmRecord, float, float | None]:
    """Record, its dwell [s], and the uncertainty that it was chosen for.

    A short record tells noise, and so the dwell, to a fifth, a pilot to a twentieth. What of the pilot is as long as
    the dwell it asks for is the record.
    """
    if isinstance(dwell, float):
        return films.acquire(dwell), dwell, None
    chosen = dwell(short)
    if chosen.dwell * short.rate <= short.samples * (1 + 1e-9):
        return films.acquire(chosen.dwell), chosen.dwell, chosen.u
    pilot = films.acquire(pilot_length(films.frequency))
    chosen = dwell(films.fit(pilot))
    enough = chosen.dwell <= pilot_length(films.frequency)
    return pilot.first(chosen.dwell) if enough else films.acquire(chosen.dwell), chosen.dwell, chosen.u


def pilot_length(frequency: float) -> float:
    """Of a record that tells the noise at a frequency [Hz] for a dwell [s]."""
    return PILOT_CYCLES / frequency


def recording_seconds(dwell: float, frequency: float) -> float:
    """What a dwell that is chosen at the point takes with its pilot [s]."""
    pilot = pilot_length(frequency)
    return dwell if dwell <= short_length(frequency) else pilot if dwell <= pilot else pilot + dwell
