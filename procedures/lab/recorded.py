"""The bench of a recorded run, as its record tells it, to evaluate its points anew. Nothing is opened or sent."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

from palpate.drivers.clock import WallClock
from palpate.drivers.roles import LoadIndicator
from palpate.instrument.bench.description import recorded_bench
from palpate.instrument.calibration.files import read_calibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import ConfigError, UsageError
from palpate.procedures.lab.calibrations import KEPT
from palpate.procedures.lab.lab import Lab
from palpate.procedures.lab.logged import Used, mounting_in, scene_in
from palpate.procedures.lab.open import driven_bench, lab_with
from palpate.procedures.lab.operator import ConsoleOperator
from palpate.procedures.lab.session import Outcome, Promise, outcome_of
from palpate.procedures.records.resumed import header_of
from palpate.procedures.records.run import Run


def recorded_lab(run: Run) -> Lab:
    """The bench of a run with the calibrations that it used.

    Raises:
        ConfigError: the package of a device, the sensor's design or a calibration is not known here.
        RecordError: the run has not the header of a procedure on a bench.
    """
    header, where = header_of(run), str(run.folder)
    bench = driven_bench(recorded_bench(header["bench"], f"{where}: its bench file"), WallClock(), ConsoleOperator())
    for device in bench.devices:
        if device.name not in header["devices"]:
            bench.leave_out(device, UsageError("the run did not use it"))
        else:
            device.serial, device.simulated = header["devices"][device.name], run.simulated
    indicator = bench.maybe(LoadIndicator)
    with suppress(ConfigError):  # only a load cell's calibration tells what its indicator told then
        kept = read_calibration(run.folder / KEPT, LoadCellCalibration)
        if indicator is not None:
            indicator.resolution_mV, indicator.gage_factor = kept.resolution_mV, kept.gage_factor
    return lab_with(bench, Used.of(header, where), run.folder.name, run.started)


def recorded_outcome(run: Run, lab: Lab) -> Outcome:
    """What the result of a recorded run has in JSON; its time here is not known.

    Raises ConfigError: its scene is wrong.
    """
    header, summary = run.header, run.summary
    seconds: Any = summary.get("bench_seconds", math.nan)
    found = outcome_of(lab, run.folder, scene_in(header, run.folder), mounting_in(header), header, seconds, math.nan)
    promise: Any = {key: summary[key] for key in Promise.__annotations__ if key in summary}
    kept = str(run.folder / KEPT)
    return {
        **found,
        **promise,
        "calibration_file": kept,
        "film_calibration_file": kept,
        "model_calibration_file": kept,
        "certificate": str(run.folder / "certificate.md"),
    }
