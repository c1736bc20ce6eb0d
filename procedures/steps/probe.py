"""The probe: at home, where the load cell must read its zero, and pressed on a sample with a static force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from palpate.drivers.roles import LoadIndicator, Positioner, SampleChanger
from palpate.instrument.bench.operator import mount_anew
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import BenchError, DeviceError, SafetyError, SampleError, UnreachableError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import READINGS, TRACK_FILTER, TRACK_SETTLING, read_indicator

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench

UNLOADING = 2.0  # s, until nothing of the last load is left in the indicator's filter
APPROACH_STEP = 2e-3  # m
CONTACT = 0.3  # N, surely more than noise
ZERO_TOLERANCE = 3.0  # standard uncertainties
PRELOAD_TOLERANCE = 0.05  # of the preload
PRELOAD_STEPS = 40


def check_zero(bench: Bench, calibration: LoadCellCalibration) -> None:
    """Clear the tare and compare the unloaded cell's reading with the zero of its calibration. The probe must be home.

    Raises:
        BenchError: the cell reads something else, so that every load and the force limit would be wrong.
        DeviceError: the indicator gives no valid reading.
    """
    carry_out(bench, "zero of the load cell", lambda: _check_zero(bench, calibration))


def withdraw(bench: Bench) -> None:
    """Set the outputs to zero and move the probe home."""
    carry_out(bench, "probe home", lambda: _withdraw(bench))


def finish(bench: Bench, calibration: LoadCellCalibration) -> None:
    """End a run: withdraw the probe and check that the load cell still reads its zero.

    Raises:
        BenchError: the zero has moved, so that the loads since the start are in doubt.
        DeviceError: the indicator gives no valid reading.
    """
    withdraw(bench)
    bench.clock.wait(UNLOADING)
    try:
        check_zero(bench, calibration)
    except BenchError as error:
        error.add_note("the zero has moved since the start: loads of this run are in doubt")
        raise


def _check_zero(bench: Bench, calibration: LoadCellCalibration) -> None:
    indicator = bench.role(LoadIndicator)
    indicator.clear_tare()
    indicator.track(TRACK_FILTER)
    bench.clock.wait(TRACK_SETTLING)
    reading = read_indicator(bench)
    if not reading.valid:
        name = indicator.name
        raise DeviceError(
            f"{name}: no valid reading without load: {reading.wrong}; let the bench come to rest, check it", device=name
        )
    scatter = 0.0 if calibration.scatter_mV is None else calibration.reading_u(READINGS)
    allowed = ZERO_TOLERANCE * math.hypot(calibration.zero_u, calibration.resolution_mV, scatter)
    if not abs(reading.reading_mV - calibration.zero_mV) <= allowed:
        raise BenchError(
            f"{indicator.name}: reads {reading.reading_mV:.4g} mV without load, the calibration "
            f"({calibration.source}) says {calibration.zero_mV:.4g} ± {allowed:.2g} mV; take the load off, or run "
            "palpate calibrate load-cell"
        )


def preload(bench: Bench, calibration: LoadCellCalibration, force: float) -> float:
    """Lower the probe until it presses with about a force [N]. Returns the force that was reached [N].

    The probe moves in equal steps until it touches, then by the slope of the last two readings, but never farther than
    one such step.

    Raises:
        UnreachableError: the positioner's travel ends before the force is reached.
        SafetyError: the force passes the bench's limit; the probe has been moved home.
        DeviceError: the indicator gives no valid reading.
    """
    positioner = bench.role(Positioner)
    bench.role(LoadIndicator).track(TRACK_FILTER)
    travel = positioner.travel()
    position, load = 0.0, 0.0
    before: tuple[float, float] | None = None
    for _ in range(PRELOAD_STEPS):
        step = APPROACH_STEP
        if before is not None and abs(load - before[1]) > 2 * calibration.resolution():
            step = (force - load) * (position - before[0]) / (load - before[1])
            step = max(-APPROACH_STEP, min(step, APPROACH_STEP))
        if position + step > travel:
            break
        before = (position, load) if load > CONTACT else None
        position += step
        positioner.move(position)
        bench.clock.wait(TRACK_SETTLING)
        load = force_at(bench, calibration, position)
        if abs(load - force) <= max(PRELOAD_TOLERANCE * force, 0.6 * calibration.resolution()):
            return load
    raise not_reached(force, load, position, travel)


def force_at(bench: Bench, calibration: LoadCellCalibration, position: float, readings: int = READINGS) -> float:
    """Force that the probe presses with at a position [m], by the mean of some readings [N].

    Raises:
        SafetyError: the force passes the bench's limit; the probe has been moved home.
        DeviceError: the indicator gives no valid reading.
    """

    def within_limit(reading_mV: float) -> None:
        pressed = calibration.load(reading_mV)[0]
        if not pressed <= bench.force_limit:
            bench.role(Positioner).home()
            raise SafetyError(f"preload of {pressed:.3g} N passes the bench's force limit of {bench.force_limit:g} N")

    reading = read_indicator(bench, readings, within_limit)
    if not reading.valid:
        name = bench.role(LoadIndicator).name
        raise DeviceError(
            f"{name}: no valid reading at {1e3 * position:.3f} mm: {reading.wrong}; check the bridge", device=name
        )
    within_limit(reading.reading_mV)
    return calibration.load(reading.reading_mV)[0]


def not_reached(force: float, load: float, position: float, travel: float) -> UnreachableError:
    """The error for a static force [N] that is not reached, with the load [N] at the last position, and the travel."""
    return UnreachableError(
        f"a preload of {force:.3g} N is not reached: {load:.3g} N at {1e3 * position:.3f} mm, and the positioner ends "
        f"at {1e3 * travel:.3f} mm; see that a sample is mounted, ask for smaller loads, or mount a stiffer one"
    )


def press(bench: Bench, calibration: LoadCellCalibration, sample: Sample, force: float) -> float:
    """Have a sample mounted and press the probe on it with a static force [N]. The outputs are then on, at zero.

    Returns the force that was reached [N]. Raises as `mount` and `preload`.
    """
    withdraw(bench)
    mount(bench, sample)
    return lower(bench, calibration, force, f"sample {sample.name}")


def mount(bench: Bench, sample: Sample, anew: bool = False) -> None:
    """Have a sample mounted, by the sample changer if there is one, else by a person. The probe must be home.

    Args:
        bench: the bench.
        sample: the sample.
        anew: whether it lies there already and is to be taken off before. A changer leaves such a sample alone, so that
            it lays another one in between.

    Raises:
        UnknownName: the changer does not hold the sample.
        SampleError: it is to be mounted anew, and the changer holds no other.
        BenchError: the changer failed, or nobody confirmed that the sample is mounted.
    """
    changer = bench.maybe(SampleChanger)
    if changer is None:
        (partial(mount_anew, bench.operator) if anew else bench.operator.mount)(sample)
        return
    if anew:
        other = other_sample(changer, sample)
        carry_out(bench, f"mounting of sample {other}", lambda: changer.mount(other))
    carry_out(bench, f"mounting of sample {sample.name}", lambda: bench.operator.mount(sample))


def other_sample(changer: SampleChanger, sample: Sample) -> str:
    """Name of a sample that a changer can lay in place of another one. Raises SampleError: it holds no other."""
    other = next((name for name in changer.samples if name != sample.name), None)
    if other is None:
        raise SampleError(
            f"the sample changer holds {sample.name!r} alone, and does not take it off in order to mount it anew; put "
            "another sample into one of its places, or give --mountings 1"
        )
    return other


def lower(bench: Bench, calibration: LoadCellCalibration, force: float, onto: str) -> float:
    """As `press`, but on what lies under the probe already. `onto` names it. The probe must be home."""
    reached = carry_out(bench, f"preload of {show(force, 'N')} on {onto}", lambda: preload(bench, calibration, force))
    carry_out(bench, "outputs on", bench.drive)
    return reached


def _withdraw(bench: Bench) -> None:
    bench.rest()
    bench.role(Positioner).home()


# -------------------------------------------------------------------------------------------------------
# A quick approach: the probe goes down at speed, with the force read after each step, to a static force
#
# first = approach(bench, calibration, 1.2, "sample 2")
#     ...                                       # the same object is mounted again
#     approach(bench, calibration, 1.2, "sample 2", free_until=first.free)
#
# `probe.preload` moves at 1 mm/s, and takes the mean of four readings after each step. Here the probe moves at 5
# mm/s, and the force is read once after each step until the probe touches. No step is longer than one of `preload`,
# but for the way that is known to be free.

SPEED = 5e-3  # m/s; greatest of the micro-positioner
FILTER = 0.03  # s, time constant of the indicator
FILTERED = 0.2  # s, until a reading is stable with it
FIRST_PRESS = 0.25  # of a step, which follows the step that touched: it tells the stiffness


@dataclass(frozen=True, slots=True)
class Contact:
    """The probe on an object.

    Attributes:
        force: the static force that it presses with [N].
        position: where it stands [m].
        free: lowest position at which it did not touch yet [m].
    """

    force: float
    position: float
    free: float


def approach(
    bench: Bench, calibration: LoadCellCalibration, force: float, onto: str, *, free_until: float = 0.0
) -> Contact:
    """Lower the probe from home until it presses with a static force [N]. The outputs are then on, at zero.

    The first move goes to one step above the position `free_until`. Steps go on until the probe touches;
    then follow a short one that tells the stiffness, and steps by the slope of the last two readings.

    Args:
        bench: the open bench; the probe must be at home.
        calibration: calibration of the load cell.
        force: the static force [N].
        onto: names what lies under the probe, in incidents.
        free_until: a position that is known to be free, because the same object was touched below it [m].

    Raises:
        UnreachableError: the positioner's travel ends before the force is reached.
        SafetyError: the force passes the bench's limit; the probe has been moved home.
        DeviceError: the indicator gives no valid reading.
    """
    first = max(free_until - APPROACH_STEP, 0.0)
    found = carry_out(
        bench, f"preload of {show(force, 'N')} on {onto}", lambda: _lowered(bench, calibration, force, first)
    )
    carry_out(bench, "outputs on", bench.drive)
    return found


def _lowered(bench: Bench, calibration: LoadCellCalibration, force: float, first: float) -> Contact:
    positioner = bench.role(Positioner)
    bench.role(LoadIndicator).track(FILTER)
    travel, enough = positioner.travel(), max(PRELOAD_TOLERANCE * force, 0.6 * calibration.resolution())
    position, load, free, step = 0.0, 0.0, 0.0, first or APPROACH_STEP
    before: tuple[float, float] | None = None
    for _ in range(PRELOAD_STEPS):
        if position + step > travel:
            break
        position += step
        positioner.move(position, SPEED)
        bench.clock.wait(FILTERED)
        load = force_at(bench, calibration, position, READINGS if before else 1)
        if load <= CONTACT:
            free, step, before = position, APPROACH_STEP, None
            continue
        if before is None:
            load = force_at(bench, calibration, position)
        if abs(load - force) <= enough:
            return Contact(load, position, free)
        if before is None:
            step = FIRST_PRESS * APPROACH_STEP if load < force else -FIRST_PRESS * APPROACH_STEP
        elif abs(load - before[1]) > 2 * calibration.resolution():
            step = (force - load) * (position - before[0]) / (load - before[1])
            step = max(-APPROACH_STEP, min(step, APPROACH_STEP))
        else:
            step = APPROACH_STEP if load < force else -APPROACH_STEP
        before = position, load
    raise not_reached(force, load, position, travel)
