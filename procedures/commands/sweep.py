"""The commands palpate sweep loads, sweep frequency, sweep temperature and sweep position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import options, texts
from palpate.procedures.commands.conducts import conducts
from palpate.procedures.commands.options import option

if TYPE_CHECKING:
    from palpate.procedures.measurements.frequency.procedure import FrequencySweep
    from palpate.procedures.measurements.loads.procedure import LoadSweep
    from palpate.procedures.measurements.position.procedure import PositionSweep
    from palpate.procedures.measurements.temperature.procedure import TemperatureSweep

MODEL = option("--model", metavar="NAME", help="Sensor model of the scene, as in `palpate model ratio`, or auto.")


@click.group(cls=options.Group)
def sweep() -> None:
    """Sweep a quantity and record the sensor's response. At a terminal `p` pauses between points, Ctrl-C stops."""


@sweep.command(
    epilog="Examples:\n\n  palpate sweep loads\n\n  palpate sweep loads --samples 1,3 --loads '2 N, 3 N' --dwell '2 s'"
    "\n\n  palpate sweep loads --scene thesis_common_base --tolerance '6 %'"
    "\n\n  palpate sweep loads --loads '3 N' --tolerance '1 %'"
    "\n\n  palpate sweep loads --model column --seed 7 --json\n\n  palpate sweep loads --bench lab.toml --out first-day"
)
@option("--samples", callback=texts.samples, default="1-6", help="Rubber samples, in order.")
@options.loads_option(None)
@option("--dwell", callback=texts.quantity("s"), help="Time over which each point is averaged (default: 1 s).")
@option(
    "--tolerance",
    callback=texts.share,
    help="Instead of --dwell: relative standard uncertainty of each point; where no load set can have it, of the mean"
    " of each sample: its loads are then repeated.",
)
@options.frequency_option
@MODEL
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def loads(
    samples: tuple[str, ...],
    loads: tuple[float, ...] | None,
    dwell: float | None,
    tolerance: float | None,
    frequency: float,
    extrapolate: bool,
) -> LoadSweep:
    """Load each sample with each load set and measure the force ratio.

    Prints for every point the load, indicator reading, film voltages, forces and the force ratio with its standard
    uncertainty, for each tooth if there are several; then the mean ratio and the softness order, with the thesis'
    values.
    """
    from palpate.procedures.measurements.loads.procedure import LoadSweep

    if dwell is not None and tolerance is not None:
        raise UsageError("--dwell and --tolerance: the tolerance determines the dwell; give only one of them")
    return LoadSweep(samples, loads, 1.0 if dwell is None else dwell, frequency, tolerance, extrapolate)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep frequency\n\n  palpate sweep frequency --frequencies '0.2 Hz, 1 Hz, 10 Hz'"
    " --sample 6\n\n  palpate sweep frequency --scene everything --dry-run"
)
@option(
    "--frequencies",
    callback=texts.frequencies,
    default="0.1 Hz:100 Hz:13",
    help="first:last:count, logarithmic, or a list.",
)
@options.sample_option
@options.load_option
@option("--dwell", callback=texts.quantity("s"), default="1 s", help="Shortest time at a point; at least three cycles.")
@MODEL
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def frequency(
    frequencies: tuple[float, ...], sample: str, load: float, dwell: float, extrapolate: bool
) -> FrequencySweep:
    """Measure gain and phase of each film over frequency, the charge amplifiers' corner, and the resonance.

    The gain is film voltage over the load that the load cell measures. Exciter and sensor nodes have no common clock,
    so the phase is the lead over the first base film. The band of touch, up to 20 Hz, is marked.
    """
    from palpate.procedures.measurements.frequency.procedure import FrequencySweep

    return FrequencySweep(frequencies, sample, load, dwell, extrapolate)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep temperature\n\n  palpate sweep temperature --scene long_drift"
    "\n\n  palpate sweep temperature --temperatures '0 K, 5 K, 15 K, 10 K' --soak '10 min' --bench lab.toml"
)
@option(
    "--temperatures",
    callback=texts.quantities("K"),
    default="0 K, 5 K, 15 K, 10 K",
    help="Relative to the start, in order.",
)
@option("--soak", callback=texts.quantity("s"), default="30 min", help="Wait before each change.")
@options.sample_option
@options.load_option
@options.dwell_option
@options.frequency_option
@MODEL
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts("humid_body")
def temperature(
    temperatures: tuple[float, ...],
    soak: float,
    sample: str,
    load: float,
    dwell: float,
    frequency: float,
    extrapolate: bool,
) -> TemperatureSweep:
    """Measure what a change of temperature adds to the films' signals, and what a fitted trend leaves of it.

    A point is measured right after each change of the surroundings. The errors of a lock-in amplifier and of a
    voltmeter on the same record are shown next to the fit with a trend. The default scene is humid_body; only scenes
    with the effect pyroelectric have anything to show.
    """
    from palpate.procedures.measurements.temperature.procedure import TemperatureSweep

    return TemperatureSweep(temperatures, sample, load, dwell, frequency, soak, extrapolate)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep position"
    "\n\n  palpate sweep position --positions '6 mm, 12 mm, 18 mm' --sample 6 --load '3 N'"
    "\n\n  palpate sweep position --positions '2 mm, 12 mm' --tolerance '0.1 mm' --dry-run"
)
@option("--positions", callback=texts.positions, default="0 mm:24 mm:2 mm", help="first:last:step or a list; along x.")
@options.sample_option
@options.load_option
@option("--dwell", callback=texts.quantity("s"), help="Time over which each point is averaged (default: 1 s).")
@option(
    "--tolerance",
    callback=texts.quantity("m", "0.1 mm"),
    help="Instead of --dwell: standard uncertainty of each found place; load sets are repeated until it is reached.",
)
@option(
    "--time",
    callback=texts.bench_time("30 min"),
    help="Instead of --dwell: bench time of the sweep, which is filled with load sets and not exceeded.",
)
@options.frequency_option
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@conducts("thesis_common_base")
def position(
    positions: tuple[float, ...],
    sample: str,
    load: float,
    dwell: float | None,
    tolerance: float | None,
    time: float | None,
    frequency: float,
    extrapolate: bool,
) -> PositionSweep:
    """Move a point load along the base of two teeth, and find its place and size from the films.

    With --tolerance or --time a plan says, before anything moves, how many load sets there are at each position, what
    they take and how well the places will be known. A tolerance that some positions cannot have is refused with what
    binds there, and with the positions that can. The default scene is thesis_common_base. The thesis' Table A2.7 is
    shown next to it, with its doubts.
    """
    from palpate.procedures.measurements.position.procedure import PositionSweep

    if dwell is not None and (tolerance is not None or time is not None):
        raise UsageError("--dwell and --tolerance or --time: these determine the dwell; leave --dwell out")
    dwell = 1.0 if dwell is None else dwell
    return PositionSweep(positions, sample, load, dwell, frequency, extrapolate, tolerance, time)
