"""The commands palpate scene list, show, check, plot and explain."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands import texts
from palpate.procedures.commands.options import (
    F,
    Output,
    StrictCommand,
    StrictGroup,
    dwell_option,
    option,
    output_options,
    picture_option,
)
from palpate.procedures.commands.texts import SCENE

# --- The command palpate scene explain -----------------------------------------------------------------


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
    " --mark 1e-3 --strict --json\n\n  palpate scene explain everything --steady",
)
@SCENE
@question_options
@dwell_option
@option("--steady", is_flag=True, help="Explain and show the settled state instead of the waveforms.")
@option("--mark", callback=texts.share, default="1e-4", help="Mark omitted effects that could change more.")
@option("--strict", is_flag=True, help="Treat a warning as an error.")
@option("--prices", is_flag=True, help="Measure what each effect costs, too, which may take a minute.")
@output_options
def explain(
    scene: str,
    sample: str,
    load: float,
    frequency: float,
    dwell: float,
    steady: bool,
    mark: float,
    strict: bool,
    prices: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Explain what a scene simulates and how, and how much the omitted effects could change.

    Of each effect, in the scene or not, it is measured how much force and force ratio change without it, or with it;
    with --prices also the processor time that those in the scene add, once and for each second of bench.
    """
    from palpate.procedures.virtual.explained import Explained, Question, print_explained

    output = Output(as_json, quiet)
    with output.prices(), output.progress("the path") as progress:
        question = Question(sample, load, frequency, dwell, steady)
        found = Explained.of(scene, question, mark, strict=strict, with_prices=prices, progress=progress)
    output.result(found.summary, lambda: print_explained(found))


# --- scene list, show, check and plot, and the group ---------------------------------------------------


@click.group(cls=StrictGroup)
def scene() -> None:
    """Look at the scenes of simulated benches: shipped ones, or files of your own."""


scene.add_command(explain)


@scene.command("list", epilog="Examples:\n\n  palpate scene list")
@output_options
def list_(as_json: bool, quiet: bool) -> None:
    """List the scenes that come with palpate, with the purpose of each."""
    from palpate.procedures.virtual.scene_list import all_shipped, print_list

    output = Output(as_json, quiet)
    scenes = all_shipped()
    output.result(lambda: {"scenes": scenes}, lambda: print_list(scenes))


@scene.command(epilog="Examples:\n\n  palpate scene show humid_body\n\n  palpate scene show my_scene.toml --json")
@SCENE
@output_options
def show(scene: str, as_json: bool, quiet: bool) -> None:
    """Show all parameters of a scene, also those with their default values."""
    from palpate.procedures.virtual.explained import parameters, print_scene

    output = Output(as_json, quiet)
    shown = parameters(scene)
    output.result(lambda: shown, lambda: print_scene(shown))


@scene.command(epilog="Examples:\n\n  palpate scene check my_scene.toml")
@SCENE
@output_options
def check(scene: str, as_json: bool, quiet: bool) -> None:
    """Read a scene and run it for a moment, with sample 2 under 3 N: exit status 0 if it can be simulated."""
    from palpate.procedures.virtual.explained import run_briefly

    output = Output(as_json, quiet)
    found = run_briefly(scene)
    if output.as_json:
        output.json(found)
    output.line(f"{found['scene']}: can be simulated")


@scene.command(
    epilog="Examples:\n\n  palpate scene plot overdriven\n\n  palpate scene plot my_scene.toml --load '4 N'"
    " --out chain.png"
)
@SCENE
@question_options
@option("--periods", default=3, type=click.IntRange(1, 100), help="Number of drawn periods.")
@picture_option("in runs/plots/")
@output_options
def plot(
    scene: str, sample: str, load: float, frequency: float, periods: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Draw the waveforms at each stage of a scene, from the shaker's coil to the samples of the sensor nodes."""
    from palpate.procedures.virtual.explained import Question
    from palpate.procedures.virtual.explained import plot as plot_waveforms

    output = Output(as_json, quiet)
    found = plot_waveforms(scene, Question(sample, load, frequency), periods, out)
    if output.as_json:
        output.json(found)
    output.line(found["file"])
