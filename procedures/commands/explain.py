"""The command palpate scene explain."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import Command, F, Output, output_options


def question_options(command: F) -> F:
    """Add the options --sample, --load and --frequency."""
    for option in (
        click.option("--frequency", default="10 Hz", show_default=True, help="Frequency of the load."),
        click.option("--load", default="3 N", show_default=True, help="Load, peak to peak, if nothing limits it."),
        click.option("--sample", default="2", show_default=True, help="Sample that is pressed."),
    ):
        command = option(command)
    return command


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate scene explain thesis_single\n\n  palpate scene explain my_scene.toml --load '1.5 N'"
    " --tolerance 1e-3 --strict --json\n\n  palpate scene explain everything --steady",
)
@click.argument("scene")
@question_options
@click.option("--dwell", default="1 s", show_default=True, help="Time over which the signals are averaged.")
@click.option("--steady", is_flag=True, help="Explain and show the settled state instead of the waveforms.")
@click.option("--tolerance", default="1e-4", show_default=True, help="Change by omitted effects that gets no mark.")
@click.option("--strict", is_flag=True, help="Treat a warning as an error.")
@output_options
def explain(
    scene: str,
    sample: str,
    load: str,
    frequency: str,
    dwell: str,
    steady: bool,
    tolerance: str,
    strict: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Explain what a scene simulates and how, and how much the omitted effects could change."""
    from palpate.instrument.quantity import parse_tolerance
    from palpate.procedures.virtual.explained import Explained, asked, print_explained

    output = Output(as_json, quiet)
    question = asked(sample, load, frequency, dwell, steady=steady)
    found = Explained.of(scene, question, parse_tolerance(tolerance), strict=strict)
    if output.as_json:
        output.json(found.summary())
    elif output.for_people:
        print_explained(found)
