"""One table of what can go wrong on a bench and what is then done, and the function that does it.

A step of a procedure, such as setting a load or recording a point, is carried out as a whole and repeated as a whole.
Between two attempts the outputs go to zero, and every device is identified again and gets its settings back. Each
incident is an event of the record, and each point says how many incidents it had.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from palpate.drivers.bench import Bench
from palpate.instrument.bench.patience import READ_ATTEMPTS
from palpate.instrument.errors import (
    BenchError,
    BenchInUse,
    DeviceError,
    EstimateError,
    IdentityError,
    LinkError,
    SafetyError,
    SampleError,
    SettingsLost,
    Unfed,
    UnreachableError,
)
from palpate.instrument.findings.film_forces import FilmForces
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, FilmRecord, Films

# --- Flags of points: why a point is not used, or what its record cannot tell --------------------------

CLIPPED, NOT_FINITE, UNSETTLED, FAULT, DRIFTED = "clipped", "not finite", "unsettled", "fault", "drifted"
FORCE, FREQUENCY = "force", "frequency"
HUM, SHORT = "hum", "short"
USED = frozenset((HUM, SHORT))
"""Flags with which a point is valid all the same. Its record is too short to tell hum from the drive, or 1/f noise from
white noise; where the effect can be estimated, the point's uncertainty contains it."""

_APART = "further apart than noise explains (by noise alone only 6 points of 100,000 differ so much)"
FLAGS: dict[str, str] = {
    CLIPPED: "a film's voltage exceeds the range of its converter; take a smaller load",
    NOT_FINITE: "a film's samples are not finite numbers; check its sensor node",
    UNSETTLED: "the films still drift when the time to settle is over; wait longer, or check for warming",
    FAULT: "a sensor node reported an emergency during the dwell; the events of the run say which",
    DRIFTED: "after the dwell the load cell reads another load than was set; check the mounting of the sample",
    FORCE: f"films and load cell measure different forces, {_APART}; check their calibrations, and look for a "
    "loose or swapped film",
    FREQUENCY: f"films and exciter have different frequencies, {_APART}; check the exciter",
    HUM: "the dwell is too short to separate mains hum from the drive; the point is used, but hum may change it",
    SHORT: "the dwell is too short to know the noise well; the point is used, with a large uncertainty",
}
"""Meaning and remedy of each flag of a point."""


@runtime_checkable
class Judged(Protocol):
    """A point that is valid or not; `flags` say why."""

    @property
    def valid(self) -> bool: ...
    @property
    def flags(self) -> Sequence[str]: ...


def check_some_valid(points: Sequence[Judged]) -> None:
    """Check that a run has a valid point. Raises EstimateError: it has none; the message counts their flags."""
    if any(point.valid for point in points):
        return
    raise EstimateError(f"no point of {len(points)} is valid, so there is no result. {reasons(points)}")


def reasons(points: Sequence[Judged]) -> str:
    """Flags of points, the commonest first: how often each occurs, what it means, and its remedy."""
    counts = Counter(flag for point in points for flag in point.flags)
    return "; ".join(f"{flag} ({count}): {_meaning(flag)}" for flag, count in counts.most_common())


def causes(flags: Sequence[str]) -> str:
    """Flags of one point with what they mean, and their remedies."""
    return "; ".join(f"{flag}: {_meaning(flag)}" for flag in flags)


def _meaning(flag: str) -> str:
    return FLAGS.get(flag, "the events of the run say why")


# -------------------------------------------------------------------------------------------------------
# Whether two devices that measure the same quantity agree within their uncertainties. This is checked at each
# point
#
# The load cell and the base films measure the force. The exciter and the nodes' clock have the drive's frequency. A
# wrong calibration, a film that came off, or an exciter that drifts does not show in the readings of one device
# alone.

FALSE_ALARMS = 6.3e-5  # of points that agree: 4 standard uncertainties of a normal distribution
CRYSTALS = 1e-4  # relative difference of two clocks [A]


def forces_differ(forces: FilmForces, frequency: float, load: float, load_u: float, known: float = math.inf) -> bool:
    """Whether films and load cell measure different forces.

    Args:
        forces: forces by the films.
        frequency: frequency of the drive [Hz].
        load: load by the load cell, peak to peak [N].
        load_u: standard uncertainty of the load [N].
        known: degrees of freedom of `load_u`.
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
            Component("load cell", load_u, degrees_of_freedom=known),
        ),
    )
    return _differ(difference, (1 - passed) * load)


def frequencies_differ(films: Films, record: FilmRecord) -> bool:
    """Whether the films swing with another frequency than was set: then their phase turns between the record's halves.

    A record of less than two cycles cannot tell.
    """
    half = record.time.size // 2
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
    between = 2 * math.pi * float(record.time[-half:].mean() - record.time[:half].mean())
    halves = tuple(
        Component(name, float(fit.phase_u[loudest]) / between, degrees_of_freedom=fit.degrees_of_freedom)
        for name, fit in (("first half", first), ("second half", second))
    )
    off = Budget("frequency less what was set", turned / between, "Hz", halves)
    return _differ(off, CRYSTALS * films.frequency + films.frequency_step / 2)


def _differ(difference: Budget, allowed: float) -> bool:
    """Whether a difference exceeds what is allowed plus what its uncertainty explains."""
    return not abs(difference.value) <= difference.expanded(1 - FALSE_ALARMS) + allowed


# -------------------------------------------------------------------------------------------------------

T = TypeVar("T")

ASK_AGAIN, READ_BACK, REPEAT, RESTORE, NOTE, MARK, USE, STOP = (
    "ask again", "read back", "repeat the step", "restore the settings, repeat the step", "note",
    "repeat the point, then mark it", "mark the point and use it", "stop",
)  # fmt: skip
ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class Policy:
    """What is done about an incident.

    Attributes:
        incident: what goes wrong.
        seen: the errors by which it is known, or where it is noticed.
        does: what is done about it.
        attempts: number of attempts in all, after which the run stops or the point is marked.
    """

    incident: str
    seen: tuple[type[BenchError], ...] | str
    does: str
    attempts: int = 1


# The first policy that fits an error counts.
POLICIES = (
    Policy("a limit of the bench is passed, or the exciter has tripped", (SafetyError,), STOP),
    Policy("another device answers at the address of one", (IdentityError,), STOP),
    Policy("another program has the exciter", (BenchInUse,), STOP),
    Policy("another sample is mounted than was ordered, or it was away meanwhile", (SampleError,), STOP),
    Policy("the rig cannot reach what is asked for", (UnreachableError,), STOP),
    Policy("settings are lost or changed: power cycle, reboot, front panel", (SettingsLost,), RESTORE, ATTEMPTS),
    Policy("a device does not answer, or the link is lost", (LinkError,), RESTORE, ATTEMPTS),
    Policy("a device refuses, or gives no valid reading", (DeviceError,), RESTORE, ATTEMPTS),
    Policy("no valid answer to a read", "in the driver", ASK_AGAIN, READ_ATTEMPTS),
    Policy("a write is not confirmed", "in the driver", READ_BACK),
    Policy("a node or its bus reports trouble: emergency, missing heartbeat, error frames", "after a step", NOTE),
    Policy("films clipped, not finite, unsettled; emergency in a dwell; load drifted", "of a point", MARK, ATTEMPTS),
    Policy(
        "films and load cell measure different forces (`force`), films and exciter have different frequencies "
        "(`frequency`), further apart than noise explains (by noise alone only 6 points of 100,000)",
        "of a point", MARK, ATTEMPTS,
    ),
    Policy("the record is too short to separate hum (`hum`), or to know its noise (`short`)", "of a point", USE),
)  # fmt: skip


def policy_for(error: BenchError) -> Policy:
    """The policy for an error. An error without one stops the run."""
    for policy in POLICIES:
        if not isinstance(policy.seen, str) and isinstance(error, policy.seen):
            return policy
    return Policy("the bench cannot", (type(error),), STOP)


def carry_out(bench: Bench, what: str, step: Callable[[], T], again: Callable[[], object] = lambda: None) -> T:
    """Carry out a step and return what it returns. If the bench fails, do what the policy says.

    On a bench whose incidents nobody records (`Bench.attend`), the step is carried out once.

    Args:
        bench: the open bench.
        what: names the step in incidents.
        step: the step.
        again: brings the bench from zero to where the step begins. It is called before the step is repeated.

    Raises:
        BenchError: the step failed, or the bench could not be put right. The outputs are off, and the device that
            failed counts as broken.
    """
    if not bench.attended:
        return step()
    driving = bench.driving
    bench.incidents.first = ""
    attempt = 0
    while True:
        attempt += 1
        try:
            if attempt > 1:
                bench.recover()
                if driving:
                    bench.drive()
                again()
            result = step()
            bench.check_settings()
            return result
        except BenchError as error:
            policy = policy_for(error)
            if attempt >= policy.attempts:
                bench.declare_broken(error)
                if isinstance(error, Unfed) and bench.incidents.first:
                    raise Unfed(bench.incidents.first, f"After that, {error.args[0]}", device=error.device) from error
                raise
            bench.incidents.note(f"{what}: {error}; {policy.does}")


# -------------------------------------------------------------------------------------------------------
# What a change of the surroundings adds to the films' signals at rest, beyond the drift that they had before it
#
# An amplifier's offset drifts by damp, or by an earlier change, and that is no answer to this change. So the films
# are recorded several times before the change and once after it, without a drive. A straight line through the records
# before predicts the one after. The line's uncertainty allows for a curve in its place, and for a random walk.

Floats = npt.NDArray[np.float64]

RECORDS = 8  # before the change
APART = 4.0  # s, from one record to the next
LENGTH = 1.0  # s, of each record: whole cycles of the mains
BEFORE = RECORDS * APART  # s, that the records before the change take
RESPONSE = 10.0  # s, after which an amplifier with a time constant of 1 s has answered a change


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """One record at rest.

    Attributes:
        time: time of its middle [s].
        voltage: mean voltages (films,) [V].
        lost: flags, if the record is not to be used.
    """

    time: float
    voltage: Floats
    lost: frozenset[str]


@dataclass(frozen=True, slots=True, eq=False)
class Added:
    """What a change has added to the films' signals.

    Attributes:
        voltage, u: added voltages and their standard uncertainties (films,) [V].
        after: time since the change [s].
        lost: flags, if one of the records is not to be used.
    """

    voltage: Floats
    u: Floats
    after: float
    lost: frozenset[str]


def before_change(films: Films) -> list[Standing]:
    """Record the films as they drift at rest. Call it with the outputs off."""
    found = []
    for _ in range(RECORDS):
        found.append(_standing(films))
        films.bench.clock.wait(APART - LENGTH)
    return found


def after_change(films: Films, before: list[Standing]) -> Added:
    """Find what a change has added. Call it as soon as the change is made, with the records from before it."""
    changed = 1e-9 * films.bench.clock.now_ns()
    films.bench.clock.wait(RESPONSE)
    now = _standing(films)
    since = [each.time - now.time for each in before]
    added, u = np.empty(len(now.voltage)), np.empty(len(now.voltage))
    for film, step in enumerate(films.steps()):
        drift = [float(each.voltage[film]) for each in before]
        if not np.isfinite([*drift, now.voltage[film]]).all():
            added[film] = u[film] = math.nan
            continue
        rounding = step / math.sqrt(12)  # of a signal that stays within one step; noise would average it out
        line, curve = (interpolate(since, drift, rounding, degree) for degree in (1, 2))
        predicted = float(line.coefficients[0])
        added[film] = now.voltage[film] - predicted
        bend = float(curve.coefficients[0]) - predicted
        noise = math.hypot(math.sqrt(line.covariance[0, 0]), max(line.residual_sd, rounding), bend)
        u[film] = max(noise, _wandered(drift, -since[-1] / APART))
    return Added(added, u, now.time - changed, frozenset().union(now.lost, *(each.lost for each in before)))


def _wandered(drift: list[float], hops: float) -> float:
    """Standard deviation of a random walk with drift, some records after the last one.

    The residuals of a line make too little of 1/f noise. A random walk with the same steps wanders no less than it.
    """
    each = float(np.std(np.diff(drift), ddof=1))
    return each * math.sqrt(hops + hops**2 / (len(drift) - 1))


def _standing(films: Films) -> Standing:
    heard, begun = films.emergencies(), films.bench.clock.now_ns()
    record = carry_out(films.bench, "films at rest", partial(films.acquire, LENGTH))
    ended = films.bench.clock.now_ns()
    flags = {
        CLIPPED: record.clipped.any(),
        NOT_FINITE: not np.isfinite(record.voltage).all(),
        FAULT: films.emergencies() > heard and not record.clipped.any(),
    }
    lost = frozenset(flag for flag, raised in flags.items() if raised)
    return Standing(0.5e-9 * (begun + ended), record.voltage.mean(axis=1), lost)
