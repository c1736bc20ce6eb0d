"""The command palpate characterise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.conducts import conducts
from palpate.procedures.commands.options import option

if TYPE_CHECKING:
    from palpate.procedures.measurements.characterise.procedure import Characterisation


@click.command(
    cls=options.Command,
    epilog="Examples:\n\n  palpate characterise\n\n  palpate characterise --scene noisy_lab --drift-time '10 min'"
    "\n\n  palpate characterise --tolerance '1 %' --drift-time '1 min' --dry-run\n\n  palpate characterise --budget",
)
@option("--sample", default="1", help="Rubber sample under the probe.")
@option("--loads", callback=texts.loads, default="1.5 N:4.5 N:0.5 N", help="first:last:step or a list; peak to peak.")
@options.dwell_option
@options.frequency_option
@option("--drift-time", callback=texts.quantity("s"), default="5 min", help="How long one load is held to see drift.")
@option(
    "--tolerance",
    callback=texts.share,
    help="Relative standard uncertainty of each film's force sensitivity: the loads up are repeated until all have it.",
)
@option(
    "--time",
    callback=texts.bench_time("20 min"),
    help="Bench time, which is filled with repeated loads up and not exceeded.",
)
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def characterise(
    sample: str,
    loads: tuple[float, ...],
    dwell: float,
    frequency: float,
    drift_time: float,
    tolerance: float | None,
    time: float | None,
) -> Characterisation:
    """Measure the sensor's characteristics (thesis 2.1), each with its standard uncertainty.

    Signal-to-noise ratio, force sensitivity, resolution, linearity, hysteresis, dynamic range and drift of every film,
    and the sensor's spatial resolution. The loads go up, then down; then the middle one is held.

    With --tolerance or --time a plan says, before anything moves, how often the loads go up, what that takes and how
    uncertain each figure will be. A tolerance that the load cell's calibration does not allow is refused.
    """
    from palpate.procedures.measurements.characterise.procedure import Characterisation

    return Characterisation(sample, loads, dwell, frequency, drift_time, tolerance, time)
