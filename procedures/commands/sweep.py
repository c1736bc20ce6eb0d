"""The commands palpate sweep loads, sweep frequency, sweep temperature and sweep position."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import (
    DRY_RUN,
    Choice,
    Group,
    Output,
    bench_options,
    budget_option,
    dwell_option,
    extrapolate_option,
    frequency_option,
    load_option,
    sample_option,
)

MODEL = click.option("--model", metavar="NAME", help="Sensor model of the scene, as in `palpate model ratio`, or auto.")


@click.group(cls=Group)
def sweep() -> None:
    """Sweep a quantity and record the sensor's response. At a terminal `p` pauses between points, Ctrl-C stops."""


@sweep.command(
    epilog="Examples:\n\n  palpate sweep loads\n\n  palpate sweep loads --samples 1,3 --loads '2 N, 3 N' --dwell '2 s'"
    "\n\n  palpate sweep loads --scene thesis_common_base --tolerance '6 %'"
    "\n\n  palpate sweep loads --model column --seed 7 --json\n\n  palpate sweep loads --bench lab.toml --out first-day"
)
@click.option("--samples", default="1-6", show_default=True, help="Rubber samples, in order.")
@click.option("--loads", default="1.5 N:4 N:0.5 N", show_default=True, help="first:last:step or a list; peak to peak.")
@click.option("--dwell", help="Time over which each point is averaged (default: 1 s).")
@click.option("--tolerance", help="Instead of --dwell: relative standard uncertainty that each point shall reach.")
@frequency_option
@MODEL
@extrapolate_option
@DRY_RUN
@bench_options
@budget_option
def loads(
    samples: str,
    loads: str,
    dwell: str | None,
    tolerance: str | None,
    frequency: str,
    model: str | None,
    extrapolate: bool,
    dry_run: bool,
    choice: Choice,
    output: Output,
) -> None:
    """Load each sample with each load set and measure the force ratio.

    Prints for every point the load, indicator reading, film voltages, forces and the force ratio with its standard
    uncertainty, for each tooth if there are several; then the mean ratio and the softness order, with the thesis'
    values.
    """
    from palpate.instrument.errors import UsageError
    from palpate.instrument.quantity import parse, parse_tolerance
    from palpate.instrument.sensor.sample import parse_samples
    from palpate.procedures.commands.procedures import measure, plan
    from palpate.procedures.measurements.loads.procedure import LoadSweep
    from palpate.procedures.steps.checks import parse_loads

    if dwell is not None and tolerance is not None:
        raise UsageError("--dwell and --tolerance: the tolerance determines the dwell; give only one of them")
    asked = LoadSweep(
        parse_samples(samples),
        parse_loads(loads),
        parse(dwell or "1 s", "s"),
        parse(frequency, "Hz"),
        None if tolerance is None else parse_tolerance(tolerance),
        extrapolate,
    )
    (plan if dry_run else measure)(asked, choice, output, model)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep frequency\n\n  palpate sweep frequency --frequencies '0.2 Hz, 1 Hz, 10 Hz'"
    " --sample 6\n\n  palpate sweep frequency --scene everything --dry-run"
)
@click.option(
    "--frequencies", default="0.1 Hz:100 Hz:13", show_default=True, help="first:last:count, logarithmic, or a list."
)
@sample_option
@load_option
@click.option("--dwell", default="1 s", show_default=True, help="Shortest time at a point; at least three cycles.")
@MODEL
@extrapolate_option
@DRY_RUN
@bench_options
def frequency(
    frequencies: str,
    sample: str,
    load: str,
    dwell: str,
    model: str | None,
    extrapolate: bool,
    dry_run: bool,
    choice: Choice,
    output: Output,
) -> None:
    """Measure gain and phase of each film over frequency, the charge amplifiers' corner, and the resonance.

    The gain is film voltage over the load that the load cell measures. Generator and sensor nodes have no common clock,
    so the phase is the lead over the first base film. The band of touch, up to 20 Hz, is marked.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.commands.procedures import measure, plan
    from palpate.procedures.measurements.frequency.procedure import FrequencySweep, parse_frequencies

    asked = FrequencySweep(parse_frequencies(frequencies), sample, parse(load, "N"), parse(dwell, "s"), extrapolate)
    (plan if dry_run else measure)(asked, choice, output, model)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep temperature\n\n  palpate sweep temperature --scene long_drift"
    "\n\n  palpate sweep temperature --temperatures '0 K, 5 K, 15 K, 10 K' --soak '10 min' --bench lab.toml"
)
@click.option(
    "--temperatures", default="0 K, 5 K, 15 K, 10 K", show_default=True, help="Relative to the start, in order."
)
@click.option("--soak", default="30 min", show_default=True, help="Wait before each change.")
@sample_option
@load_option
@dwell_option
@frequency_option
@MODEL
@extrapolate_option
@DRY_RUN
@bench_options
def temperature(
    temperatures: str,
    soak: str,
    sample: str,
    load: str,
    dwell: str,
    frequency: str,
    model: str | None,
    extrapolate: bool,
    dry_run: bool,
    choice: Choice,
    output: Output,
) -> None:
    """Measure what a change of temperature adds to the films' signals, and what a fitted trend leaves of it.

    A point is measured right after each change of the surroundings. The errors of a lock-in amplifier and of a
    voltmeter on the same record are shown next to the fit with a trend. The default scene is humid_body; only scenes
    with the effect pyroelectric have anything to show.
    """
    from palpate.instrument.quantity import parse, parse_list
    from palpate.procedures.commands.procedures import measure, plan
    from palpate.procedures.measurements.temperature.procedure import TemperatureSweep

    asked = TemperatureSweep(
        parse_list(temperatures, "K"),
        sample,
        parse(load, "N"),
        parse(dwell, "s"),
        parse(frequency, "Hz"),
        parse(soak, "s"),
        extrapolate,
    )
    (plan if dry_run else measure)(asked, choice.simulated_on("humid_body"), output, model)


@sweep.command(
    epilog="Examples:\n\n  palpate sweep position"
    "\n\n  palpate sweep position --positions '6 mm, 12 mm, 18 mm' --sample 6 --load '3 N'"
)
@click.option("--positions", default="0 mm:24 mm:2 mm", show_default=True, help="first:last:step or a list; along x.")
@sample_option
@load_option
@dwell_option
@frequency_option
@extrapolate_option
@DRY_RUN
@bench_options
def position(
    positions: str,
    sample: str,
    load: str,
    dwell: str,
    frequency: str,
    extrapolate: bool,
    dry_run: bool,
    choice: Choice,
    output: Output,
) -> None:
    """Move a point load along the base of two teeth, and find its place and size from the films.

    The default scene is thesis_common_base. The thesis' Table A2.7 is shown next to it, with its doubts.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.commands.procedures import measure, plan
    from palpate.procedures.measurements.position.procedure import PositionSweep
    from palpate.procedures.steps.checks import parse_steps

    asked = PositionSweep(
        parse_steps(positions, "m", "positions", "0 mm:24 mm:2 mm"),
        sample,
        parse(load, "N"),
        parse(dwell, "s"),
        parse(frequency, "Hz"),
        extrapolate,
    )
    (plan if dry_run else measure)(asked, choice.simulated_on("thesis_common_base"), output)
