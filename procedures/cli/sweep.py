"""palpate sweep."""

from __future__ import annotations

from dataclasses import asdict

import click

from procedures.cli.options import Choice, Output, bench_options


@click.group()
def sweep() -> None:
    """Sweep a quantity and record the sensor's answer."""


@sweep.command(
    epilog="Examples:\n\n  palpate sweep loads\n\n  palpate sweep loads --samples 1,3 --loads '2 N, 3 N' --dwell '2 s'"
    "\n\n  palpate sweep loads --model column --seed 7 --json\n\n  palpate sweep loads --bench lab.toml --out first-day"
)
@click.option("--samples", default="1-6", show_default=True, help="Rubber samples, in order.")
@click.option("--loads", default="1.5 N:4 N:0.5 N", show_default=True, help="first:last:step or a list; peak to peak.")
@click.option("--dwell", default="1 s", show_default=True, help="Time over which each point is averaged.")
@click.option("--frequency", default="10 Hz", show_default=True, help="Frequency of the load.")
@click.option("--model", metavar="NAME", help="Sensor model of the scene: of `palpate model ratio`, or auto.")
@bench_options
def loads(
    samples: str, loads: str, dwell: str, frequency: str, model: str | None, choice: Choice, output: Output
) -> None:
    """Load each sample with each load set and measure the force ratio.

    For every point: load, indicator reading, both film voltages, both forces and the force ratio with its
    standard uncertainty; then the mean ratio and the softness order beside the thesis' own.
    """
    from instrument.designs import get_design
    from instrument.quantity import parse
    from instrument.sample import parse_samples
    from procedures import load_sweep
    from procedures.cli.session import conduct
    from procedures.report.load_sweep import plot_sweep, print_sweep

    settings = load_sweep.SweepSettings(
        parse_samples(samples), load_sweep.parse_loads(loads), parse(dwell, "s"), parse(frequency, "Hz")
    )
    session, result, outcome = conduct(
        load_sweep.PROCEDURE,
        choice,
        output,
        asdict(settings),
        lambda bench: load_sweep.check(settings, get_design(bench.design), bench.force_limit, len(bench.can.nodes)),
        lambda session, progress: load_sweep.run(
            session.bench, session.design, session.calibration, settings, session.record, progress
        ),
        model=model,
    )
    plot = plot_sweep(result, session.design, session.bench.simulated, session.record.folder)
    if output.as_json:
        output.json({**outcome, "points": [asdict(p) for p in result.points], **result.summary(), "plot": str(plot)})
    elif output.for_people:
        print_sweep(result, session.design, outcome, plot)
