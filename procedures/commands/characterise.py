"""The command palpate characterise."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import (
    Choice,
    Command,
    Output,
    bench_options,
    budget_option,
    dwell_option,
    frequency_option,
)


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate characterise\n\n  palpate characterise --scene noisy_lab --drift-time '10 min'"
    "\n\n  palpate characterise --budget",
)
@click.option("--sample", default="1", show_default=True, help="Rubber sample under the probe.")
@click.option(
    "--loads", default="1.5 N:4.5 N:0.5 N", show_default=True, help="first:last:step or a list; peak to peak."
)
@dwell_option
@frequency_option
@click.option("--drift-time", default="5 min", show_default=True, help="How long one load is held to see drift.")
@bench_options
@budget_option
def characterise(
    sample: str, loads: str, dwell: str, frequency: str, drift_time: str, choice: Choice, output: Output
) -> None:
    """Measure the sensor's characteristics (thesis 2.1), each with its standard uncertainty.

    Signal-to-noise ratio, force sensitivity, resolution, linearity, hysteresis, dynamic range and drift of every film,
    and the sensor's spatial resolution. The loads go up, then down; then the middle one is held.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.commands.procedures import measure
    from palpate.procedures.measurements.characterise.procedure import Characterisation
    from palpate.procedures.steps.checks import parse_loads

    asked = Characterisation(
        sample, parse_loads(loads), parse(dwell, "s"), parse(frequency, "Hz"), parse(drift_time, "s")
    )
    measure(asked, choice, output)
