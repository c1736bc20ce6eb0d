"""Every fault on everything that can have it, in the middle of a procedure: what comes of it.

The outcome is a result that is right within its stated uncertainty, with the incident in the record; or one that is
marked; or a stop with an error that says what failed, and outputs at zero. Anything else is WRONG.
"""

from __future__ import annotations

import functools
import math
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from palpate.drivers.bench import Bench
from palpate.drivers.incident import INCIDENT
from palpate.instrument.errors import PalpateError
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class, inject
from palpate.simulators.faults.can import CanFault, FilmFault
from palpate.simulators.faults.device import IndicatorFault
from palpate.simulators.faults.fault import parse_faults, places, struck
from palpate.simulators.scenes.scene import Scene
from tests.fault_procedures import PROCEDURES, SAMPLE, Found, scene, wrong

PROCESSES_A_CORE = 4
HASTY = "0.5 s"  # of the wall: where it is too short for a busy machine, one more thing fails, and the verdict holds
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
    "sample_changer": (("speed", 0.001),),
    "sensor_node_1": (("range_1", 0.0), ("sync_period", 0.01)),
    "exciter": (("mode", 1.0),),
    "load_cell": (("filter_level", 5.0),),
    "stage": (("limit_high", -20000.0), ("mode", 3.0)),
    "films": (("sync_period", 0.01), ("heartbeat", 0.0)),
}  # fmt: skip


Scenes = Callable[[str], Scene]


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


def cells(procedures: Iterable[str] = tuple(PROCEDURES), of: Scenes = scene) -> Iterator[Cell]:
    """The whole matrix of a bench; `of`: gives the scene of a procedure."""
    for procedure in procedures:
        standing = places(1, of(procedure).devices)
        for kind in FAULTS:
            for on in struck(fault_class(kind).targets, standing):
                mores: list[tuple[tuple[str, Any], ...]] = [()]
                if kind == "front_panel":
                    mores = [(("setting", setting), ("value", value)) for setting, value in PANEL[on]]
                for more in mores:
                    yield from (Cell(procedure, kind, on, lasts, more) for lasts in (ONCE, STAYS))


def incidents_of(run: Run) -> list[str]:
    """What failed in a run. That a reading could be a load in both orders of its words is told, and is no fault."""
    events = [event["message"] for event in run.events() if event["kind"] == INCIDENT]
    return [message for message in events if "with its words in the other order" not in message]


@functools.cache
def undisturbed(procedure: str, changer: bool = False, of: Scenes = scene) -> tuple[Found, float]:
    """The result without faults, and the bench time in the middle of a point in its middle [s]."""
    with tempfile.TemporaryDirectory() as folder:
        result, run, _ = _done(procedure, of(procedure), Path(folder) / "run", changer)
        assert not isinstance(result, PalpateError)
        times = [point["bench_ns"] for point in run.points()]
        before, after = times[len(times) // 2 - 1], times[len(times) // 2]
        assert not incidents_of(run)
        return result, 1e-9 * (before + after) / 2


def play(cell: Cell, of: Scenes = scene) -> Outcome:
    """What comes of one cell; `of`: gives the scene of its procedure."""
    return _play(cell, *undisturbed(cell.procedure, cell.on == "sample_changer", of), of)


def play_all(procedures: Sequence[str] = tuple(PROCEDURES), of: Scenes = scene) -> dict[Cell, Outcome]:
    """What comes of every cell, in as many processes as keep the cores busy: most of a cell is waiting in vain."""
    whole = list(cells(procedures, of))
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES_A_CORE * (os.cpu_count() or 1), spawned) as pool:
        kinds = [(procedure, changer) for procedure in procedures for changer in (False, True)]
        right = dict(zip(kinds, pool.map(partial(undisturbed, of=of), *zip(*kinds, strict=True)), strict=True))
        found = (right[cell.procedure, cell.on == "sample_changer"] for cell in whole)
        return dict(zip(whole, pool.map(partial(_play, of=of), whole, *zip(*found, strict=True)), strict=True))


def _play(cell: Cell, right: Found, middle: float, of: Scenes = scene) -> Outcome:
    table = {"kind": cell.kind, "on": cell.on, "at": f"{middle} s", **dict(cell.more)}
    if cell.lasts == STAYS:
        table["lasts"] = LONG
    elif issubclass(fault_class(cell.kind), (CanFault, IndicatorFault, FilmFault)):
        table["lasts"] = A_WHILE
    with tempfile.TemporaryDirectory() as folder:
        base = of(cell.procedure)
        faulty = replace(base, faults=parse_faults([table], places(1, base.devices), "matrix"))
        result, run, live = _done(cell.procedure, faulty, Path(folder) / "run", cell.on == "sample_changer")
        incidents = len(incidents_of(run))
        if live:
            return Outcome("WRONG", incidents, f"outputs are at {live:g} V")
        if isinstance(result, PalpateError):
            clear = run.status == "failed" and len(str(result)) > 20
            return Outcome("stopped" if clear else "WRONG", incidents, f"{type(result).__name__}: {result}")
        if said := wrong(result, right):
            return Outcome("WRONG", incidents, said)
        whole = result.keys() == right.keys() and all(value.valid for value in result.values())
        return Outcome("right" if whole else "marked", incidents)


def _done(procedure: str, of: Scene, folder: Path, changer: bool) -> tuple[Found | PalpateError, Run, float]:
    """The result or the error, the run, and the greatest output voltage that is left in the end [V]."""
    header = {"procedure": procedure, "simulated": True, "started": "2025-03-14T15:09:26Z"}
    result: Found | PalpateError
    samples = [get_sample(SAMPLE)] if changer else []
    with patch.object(inject, "TIMEOUT", HASTY), SimulatedBench(of, samples=samples) as sim:
        try:
            with Recorder.create(folder, header) as record:
                with Bench(sim.description, sim.clock, sim.operator) as bench:
                    bench.attend(record.event)
                    result = PROCEDURES[procedure](bench, record)
                record.finish("complete", {})
        except PalpateError as error:
            result = error
        sim.clock.wait(SETTLED)
        least, greatest = sim.rig.coil_voltage().extremes()
    return result, Run.open(folder), max(math.fabs(least), math.fabs(greatest))
