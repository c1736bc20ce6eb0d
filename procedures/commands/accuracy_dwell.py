"""The command palpate accuracy dwell."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands import texts
from palpate.procedures.commands.explain import question_options
from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, make_folder, option, output_options


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy dwell\n\n  palpate accuracy dwell --scene noisy_lab --load '1.5 N'"
    "\n\n  palpate accuracy dwell --estimator 'least squares' --dwell '0.5 s, 5 s' --json",
)
@option("--scene", metavar="NAME|FILE", default="thesis_single", help="Scene to simulate.")
@question_options
@option(
    "--dwell",
    callback=texts.quantities("s"),
    help="Dwells, with commas (default: 0.1 s to 10 s, all of a cycle or more).",
)
@option("--estimator", multiple=True, help="Such as 'least squares'; repeat it for more (default: all).")
@option("--rate", callback=texts.quantity("Hz"), help="Sample rate, such as '250 Hz' (default: 25 samples in a cycle).")
@option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the scene.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot dwell.png (default: no plot).")
@output_options
def dwell_command(
    scene: str,
    sample: str,
    load: float,
    frequency: float,
    dwell: tuple[float, ...] | None,
    estimator: tuple[str, ...],
    rate: float | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show uncertainty and bias of the force ratio against the dwell, for each estimator, with the Cramér–Rao bound.

    One long record of a settled load is cut into pieces. A longer dwell cannot reduce the scatter of the films' gains
    from one load set to the next, nor disturbances that move in step with the drive.
    """
    from palpate.instrument.errors import EstimateError
    from palpate.instrument.quantity import show
    from palpate.procedures.virtual.dwell import SAMPLES_PER_CYCLE, price
    from palpate.procedures.virtual.explained import Question

    output = Output(as_json, quiet)
    sampled = SAMPLES_PER_CYCLE * frequency if rate is None else rate
    question = Question(sample, load, frequency)
    make_folder(out)
    prices = price(scene, seed, question, sampled, dwell, estimator)
    title = f"scene {scene}: force ratio of sample {sample} under {show(load, 'N')} at {show(frequency, 'Hz')}"
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.dwell_report import plot_dwell

        plot = plot_dwell(prices, title, out)
    if output.as_json:
        head = {"simulated": True, "scene": scene, "sample": sample, "load_N": load}
        rates = {"frequency_Hz": frequency, "sample_rate_Hz": sampled}
        output.json({**head, **rates, **prices.summary(), "plot": None if plot is None else str(plot)})
    elif output.for_people:
        from palpate.procedures.accuracy.dwell_report import print_dwell

        print_dwell(prices, title, plot)
    if prices.saturated:
        raise EstimateError(f"scene {scene}: a film is over-ranged, so no result is usable; take a smaller --load")
