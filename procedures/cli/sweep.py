"""palpate sweep."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from procedures.cli.options import Output, bench_options


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
    samples: str,
    loads: str,
    dwell: str,
    frequency: str,
    model: str | None,
    bench: Path | None,
    scene: str | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Load each sample with each load set and measure the force ratio.

    For every point: load, indicator reading, both film voltages, both forces and the force ratio with its
    standard uncertainty; then the mean ratio and the softness order beside the thesis' own.
    """
    from instrument.designs import get_design
    from instrument.quantity import parse
    from instrument.sample import parse_samples
    from procedures import load_sweep, report
    from procedures.cli.session import open_session

    output = Output(as_json, quiet)
    settings = load_sweep.SweepSettings(
        parse_samples(samples), load_sweep.parse_loads(loads), parse(dwell, "s"), parse(frequency, "Hz")
    )
    with (
        output.progress() as progress,
        open_session(
            load_sweep.PROCEDURE,
            bench=bench,
            scene=scene,
            seed=seed,
            model=model,
            out=out,
            settings=asdict(settings),
            check=lambda description: load_sweep.check(
                settings, get_design(description.design), description.force_limit
            ),
        ) as session,
    ):
        result = load_sweep.run(session.bench, session.design, session.calibration, settings, session.record, progress)
        outcome = session.outcome()
        session.record.finish("complete", {**result.summary(), "bench_seconds": outcome["bench_seconds"]})
    plot = report.plot_sweep(result, session.design, session.bench.simulated, session.record.folder)
    if output.as_json:
        output.json({**outcome, "points": [asdict(p) for p in result.points], **result.summary(), "plot": str(plot)})
    elif output.for_people:
        report.print_sweep(result, session.design, outcome, plot)
