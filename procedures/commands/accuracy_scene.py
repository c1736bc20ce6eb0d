"""The command palpate accuracy scene."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.explain import question_options
from palpate.procedures.commands.options import (
    FILE_NAME,
    Output,
    StrictCommand,
    dwell_option,
    make_folder,
    option,
    output_options,
)


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy scene noisy_lab"
    "\n\n  palpate accuracy scene everything --sample 6 --load '4 N' --out prices --json",
)
@click.argument("scene")
@question_options
@dwell_option
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot scene.png (default: no plot).")
@output_options
def scene_command(
    scene: str,
    sample: str,
    load: float,
    frequency: float,
    dwell: float,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show what a scene's effects are worth: with ever fewer of them, what changes and what time is saved.

    The effect that changes force and force ratio least is left out first. Each subset is measured together, against the
    whole scene with the same noise. Of all subsets only these are tried, as many as there are effects.
    """
    from palpate.procedures.virtual.explained import Question
    from palpate.procedures.virtual.scene_front import SceneFront, plot_front, print_front

    output = Output(as_json, quiet)
    make_folder(out)
    with output.prices(), output.progress("the whole scene") as progress:
        found = SceneFront.of(scene, Question(sample, load, frequency, dwell), progress)
    plot = None if out is None else plot_front(found, out)
    output.result(
        lambda: {**found.summary(), "plot": None if plot is None else str(plot)}, lambda: print_front(found, plot)
    )
