"""Every fault on everything that can have it, in the middle of a procedure: what comes of it.

The outcome is a result that is right within its stated uncertainty, with the incident in the record; or one that is
marked; or a stop with an error that says what failed, and outputs at zero. Anything else is WRONG.
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.bench import Bench
from drivers.incident import INCIDENT
from instrument.calibration import STANDARD_GRAVITY, THESIS_LOAD_CELL
from instrument.designs import get_design
from instrument.errors import PalpateError
from procedures import load_cell, load_sweep
from procedures.load_plan import SweepSettings
from procedures.record import Recorder
from procedures.run import Run
from simulators.bench import SimulatedBench
from simulators.faults import FAULTS, fault_class
from simulators.faults.can import CanFault
from simulators.faults.fault import NODE, parse_faults
from simulators.faults.indicator import IndicatorFault
from simulators.faults.node import FilmFault
from simulators.scene import Scene, read_scene

ONCE, STAYS = "once", "stays"
LONG = "100000 s"
A_WHILE = "1 s"  # a single frame is a heartbeat as often as a sample
SETTLED = 2.1  # s, after which a watchdog has dropped what nobody could switch off

# What somebody turns at each device.
PANEL = {
    "signal_generator": (("amplitude", 0.5), ("frequency", 11.0), ("output", 0.0)),
    "shaker_amplifier": (("gain", 3.0), ("enable", 0.0)),
    "strain_indicator": (("gage_factor", 4.0), ("mode", 0.0), ("filter", 5.0)),
    "positioner": (("limit_high", 0.02),),
    "sensor_node_1": (("range_1", 0.0), ("sync_period", 0.01)),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cell:
    procedure: str
    kind: str
    on: str
    lasts: str
    more: tuple[tuple[str, Any], ...] = ()

    @property
    def name(self) -> str:
        setting = f" {self.more[0][1]}" if self.more else ""
        return f"{self.kind}{setting}, {self.on}, {self.lasts}, {self.procedure}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """`verdict`: right, marked, stopped or WRONG. `said`: the error, or what is wrong."""

    verdict: str
    incidents: int = 0
    said: str = ""


@functools.cache
def scene() -> Scene:
    """The thesis' bench without the scatter of the films' gains, behind which a wrong number could hide."""
    whole = read_scene("thesis_single")
    return replace(whole, effects={name: e for name, e in whole.effects.items() if name != "gain_scatter"})


def _sweep(bench: Bench, record: Recorder) -> Any:
    settings = SweepSettings(("2",), (2.0, 3.0), 0.2, 10.0)
    result = load_sweep.run(bench, get_design("single"), THESIS_LOAD_CELL, settings, record, _silent)
    return [(point.force_ratio, point.force_ratio_u, point.valid) for point in result.points]


def _calibrate(bench: Bench, record: Recorder) -> Any:
    loads = tuple(1e-3 * gram * STANDARD_GRAVITY for gram in (140, 340, 540, 740))
    result = load_cell.run(bench, load_cell.LoadCellSettings(loads), record, _silent, datetime(2025, 3, 14, tzinfo=UTC))
    return [(result.calibration.sensitivity_mV_per_N, result.calibration.sensitivity_u, True)]


def _silent(_done: int, _total: int, _what: str) -> None:
    pass


PROCEDURES: dict[str, Callable[[Bench, Recorder], Any]] = {"sweep loads": _sweep, "calibrate load-cell": _calibrate}


def cells() -> Iterator[Cell]:
    """The whole matrix."""
    for procedure in PROCEDURES:
        for kind in FAULTS:
            for target in fault_class(kind).targets:
                on = f"{NODE}1" if target == NODE else target
                mores: list[tuple[tuple[str, Any], ...]] = [()]
                if kind == "front_panel":
                    mores = [(("setting", setting), ("value", value)) for setting, value in PANEL[on]]
                for more in mores:
                    yield from (Cell(procedure, kind, on, lasts, more) for lasts in (ONCE, STAYS))


@functools.cache
def undisturbed(procedure: str) -> tuple[list[tuple[float, float, bool]], float]:
    """The result without faults, and the bench time in the middle of a point in its middle [s]."""
    with tempfile.TemporaryDirectory() as folder:
        result, run, _ = _done(procedure, scene(), Path(folder) / "run")
        assert not isinstance(result, PalpateError)
        times = [point["bench_ns"] for point in run.points()]
        before, after = times[len(times) // 2 - 1], times[len(times) // 2]
        assert not [event for event in run.events() if event["kind"] == INCIDENT]
        return result, 1e-9 * (before + after) / 2


def play(cell: Cell) -> Outcome:
    """What comes of one cell."""
    expected, middle = undisturbed(cell.procedure)
    table = {"kind": cell.kind, "on": cell.on, "at": f"{middle} s", **dict(cell.more)}
    if cell.lasts == STAYS:
        table["lasts"] = LONG
    elif issubclass(fault_class(cell.kind), (CanFault, IndicatorFault, FilmFault)):
        table["lasts"] = A_WHILE
    with tempfile.TemporaryDirectory() as folder:
        faulty = replace(scene(), faults=parse_faults([table], 1, "matrix"))
        result, run, live = _done(cell.procedure, faulty, Path(folder) / "run")
        incidents = sum(event["kind"] == INCIDENT for event in run.events())
        if live:
            return Outcome("WRONG", incidents, f"outputs are at {live:g} V")
        if isinstance(result, PalpateError):
            clear = run.status == "failed" and len(str(result)) > 20
            return Outcome("stopped" if clear else "WRONG", incidents, f"{type(result).__name__}: {result}")
        for (value, u, valid), (right, _, _) in zip(result, expected, strict=True):
            if valid and not abs(value - right) <= u:
                return Outcome("WRONG", incidents, f"{value:.5g} ± {u:.2g}, should be {right:.5g}, without a mark")
        return Outcome("right" if all(valid for _, _, valid in result) else "marked", incidents)


def _done(procedure: str, of: Scene, folder: Path) -> tuple[Any, Run, float]:
    """The result or the error, the run, and the greatest output voltage that is left in the end [V]."""
    header = {"procedure": procedure, "simulated": True, "started": "2025-03-14T15:09:26Z"}
    with SimulatedBench(of) as sim:
        try:
            with Recorder.create(folder, header) as record:
                with Bench(sim.description, sim.clock, sim.operator) as bench:
                    bench.attend(record.event)
                    result = PROCEDURES[procedure](bench, record)
                record.finish("complete", {})
        except PalpateError as error:
            result = error
        sim.clock.wait(SETTLED)
        least, greatest = sim.amplifier.voltage().extremes()
    return result, Run.open(folder), max(math.fabs(least), math.fabs(greatest))
