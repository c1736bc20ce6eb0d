"""The command palpate scene explain."""

from __future__ import annotations

import click

from palpate.procedures.commands import texts
from palpate.procedures.commands.options import F, Output, StrictCommand, dwell_option, option, output_options


def question_options(command: F) -> F:
    """Add the options --sample, --load and --frequency."""
    for each in (
        option("--frequency", callback=texts.quantity("Hz"), default="10 Hz", help="Frequency of the load."),
        option("--load", callback=texts.quantity("N"), default="3 N", help="Load, peak to peak, if nothing limits it."),
        option("--sample", default="2", help="Sample that is pressed."),
    ):
        command = each(command)
    return command


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate scene explain thesis_single\n\n  palpate scene explain my_scene.toml --load '1.5 N'"
    " --tolerance 1e-3 --strict --json\n\n  palpate scene explain everything --steady",
)
@click.argument("scene")
@question_options
@dwell_option
@option("--steady", is_flag=True, help="Explain and show the settled state instead of the waveforms.")
@option("--tolerance", callback=texts.share, default="1e-4", help="Change by omitted effects that gets no mark.")
@option("--strict", is_flag=True, help="Treat a warning as an error.")
@output_options
def explain(
    scene: str,
    sample: str,
    load: float,
    frequency: float,
    dwell: float,
    steady: bool,
    tolerance: float,
    strict: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Explain what a scene simulates and how, how much the omitted effects could change, and what each costs.

    Of each effect, in the scene or not, it is measured how much force and force ratio change without it, or with it,
    and the processor time that it adds to a second of bench.
    """
    from palpate.procedures.virtual.explained import Explained, Question, print_explained

    output = Output(as_json, quiet)
    with output.prices(), output.progress("the path") as progress:
        question = Question(sample, load, frequency, dwell, steady)
        found = Explained.of(scene, question, tolerance, strict=strict, progress=progress)
    output.result(found.summary, lambda: print_explained(found))
