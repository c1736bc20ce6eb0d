"""The bench work of a load-cell calibration: reads the load cell under one weight after the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, Positioner, why_invalid
from palpate.instrument.calibration.load_cell_fit import STANDARD_GRAVITY
from palpate.instrument.errors import DeviceError
from palpate.instrument.quantity import show
from palpate.procedures.engine.plan import Step
from palpate.procedures.engine.procedure import Measurement
from palpate.procedures.measurements.load_cell.result import (
    CREEP_TIMES,
    FILTER,
    INTERVAL,
    LOADING,
    REPEATS,
    SETTLING,
    ZERO_AFTER,
    ZERO_BEFORE,
    LoadCellPoint,
)
from palpate.procedures.records.columns import gathered
from palpate.procedures.steps.indicator import steady
from palpate.procedures.steps.policy import carry_out

RECOVERY = 300.0  # s without load before the creep test, so that the creep of the runs is gone
# The zero may move in a run by these steps of the display plus this fraction of the span [A]; ISO 376 has 0.1 %.
RETURN_STEPS, RETURN_OF_SPAN = 1.5, 0.01


@dataclass(frozen=True, slots=True)
class WeightStep(Step):
    """One weight on the load cell.

    Attributes:
        position_deg: position of the cell about its axis.
        run: number of the run, from 1.
        direction: "loading", "unloading", "zero_before", "zero_after", or "creep_..._s".
        load_N: the load.
        creep_s: time since the weight was placed [s]; 0: no creep test, it is read once it has settled.
    """

    position_deg: float
    run: int
    direction: str
    load_N: float
    creep_s: float = 0.0


class Weighing:
    """The bench work: reads the load cell under one weight after the other.

    Args:
        bench: the open bench.
        turns: whether the cell is turned to several positions.
        creeps: whether the creep is watched at the end.
    """

    def __init__(self, bench: Bench, turns: bool, creeps: bool) -> None:
        self._bench, self._turns, self._creeps = bench, turns, creeps
        indicator = bench.role(LoadIndicator)
        bench.rest()
        bench.role(Positioner).home()
        indicator.clear_tare()
        indicator.track(FILTER)
        self._resolution_mV = indicator.read().resolution_mV
        self._zero_mV = self._span_mV = 0.0
        self._creeping_ns = 0

    def arrange(self, step: WeightStep) -> None:
        if self._turns:
            self._bench.operator.turn_load_cell(step.position_deg)

    def take(self, step: WeightStep) -> Measurement[LoadCellPoint]:
        if step.creep_s:
            self._creep(step)
        else:
            self._bench.operator.place_weight(step.load_N / STANDARD_GRAVITY)
            self._bench.clock.wait(SETTLING)
        point = self._read(step)
        error = None
        if step.direction == ZERO_BEFORE:
            self._zero_mV = point.reading_mV
        elif step.direction == LOADING:
            self._span_mV = point.reading_mV - self._zero_mV
        elif step.direction == ZERO_AFTER:
            error = self._drift(self._zero_mV, point.reading_mV, self._span_mV)
        return Measurement(point, error=error)

    def end(self) -> None:
        if self._creeps:
            self._bench.operator.place_weight(0.0)

    def _creep(self, step: WeightStep) -> None:
        """Wait until the greatest load has been on the cell for the step's time; the first step has it placed."""
        bench, clock = self._bench, self._bench.clock
        if step.creep_s == CREEP_TIMES[0]:
            clock.wait(RECOVERY)
            bench.operator.place_weight(step.load_N / STANDARD_GRAVITY)
            self._creeping_ns = clock.now_ns()
        clock.wait(step.creep_s - (clock.now_ns() - self._creeping_ns) * 1e-9)

    def _read(self, step: WeightStep) -> LoadCellPoint:
        what = f"{step.direction}, {show(step.load_N, 'N')}"
        again = partial(self._bench.clock.wait, SETTLING)
        values = carry_out(self._bench, what, partial(_displays, self._bench), again=again)
        return gathered(
            LoadCellPoint, step,
            load_gf=round(1e3 * step.load_N / STANDARD_GRAVITY, 6),
            reading_mV=sum(values) / len(values),
            readings_mV=tuple(values),
            incidents=self._bench.incidents.new(),
        )  # fmt: skip

    def _drift(self, before: float, after: float, span: float) -> DeviceError | None:
        """An error if the zero has moved too far from before to after a run [mV]; else None."""
        allowed = RETURN_STEPS * self._resolution_mV + RETURN_OF_SPAN * abs(span)
        if not abs(after - before) <= allowed:
            name = self._bench.role(LoadIndicator).name
            return DeviceError(
                f"{name}: in a run the zero moved from {before:.4g} to {after:.4g} mV, by more than {allowed:.2g} mV; "
                "let cell and indicator warm up, look for loose wires, and calibrate again",
                device=name,
            )
        return None


def _displays(bench: Bench) -> list[float]:
    values = []
    for number in range(REPEATS):
        if number:
            bench.clock.wait(INTERVAL)
        reading = steady(bench)
        if not reading.valid:
            name = bench.role(LoadIndicator).name
            raise DeviceError(
                f"{name}: {why_invalid(reading)}; check the cell and wait until the weight rests", device=name
            )
        values.append(reading.reading_mV)
    return values
