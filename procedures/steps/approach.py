"""A quick approach: the probe goes down at speed, with the force read after each step, to a static force.

    first = approach(bench, calibration, 1.2, "sample 2")
    ...                                       # the same object is mounted again
    approach(bench, calibration, 1.2, "sample 2", known=first.free)

`probe.preload` moves at 1 mm/s, and takes the mean of four readings after each step. Here the probe moves at 5 mm/s,
and the force is read once after each step until the probe touches. No step is longer than one of `preload`, but for the
way that is known to be free.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, Positioner
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.quantity import show
from palpate.procedures.steps.indicator import READINGS
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.probe import (
    APPROACH_STEP,
    CONTACT,
    PRELOAD_STEPS,
    PRELOAD_TOLERANCE,
    force_at,
    not_reached,
)

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


def approach(bench: Bench, calibration: LoadCellCalibration, force: float, onto: str, *, known: float = 0.0) -> Contact:
    """Lower the probe from home until it presses with a static force [N]. The outputs are then on, at zero.

    The first move goes to one step above the position that is `known` to be free. Steps go on until the probe touches;
    then follow a short one that tells the stiffness, and steps by the slope of the last two readings.

    Args:
        bench: the open bench; the probe must be at home.
        calibration: calibration of the load cell.
        force: the static force [N].
        onto: names what lies under the probe, in incidents.
        known: a position that is known to be free, because the same object was touched below it [m].

    Raises:
        UnreachableError: the positioner's travel ends before the force is reached.
        SafetyError: the force passes the bench's limit; the probe has been moved home.
        DeviceError: the indicator gives no valid reading.
    """
    first = max(known - APPROACH_STEP, 0.0)
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
