"""The commands palpate scene list, scene show, scene check and scene plot."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.explain import explain, question_options
from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, option, output_options


@click.group(cls=StrictGroup)
def scene() -> None:
    """Look at the scenes of simulated benches: shipped ones, or files of your own."""


scene.add_command(explain)


@scene.command("list", epilog="Examples:\n\n  palpate scene list")
@output_options
def list_(as_json: bool, quiet: bool) -> None:
    """List the scenes that come with palpate, with the purpose of each."""
    from palpate.procedures.virtual.parameters import all_shipped, print_list

    output = Output(as_json, quiet)
    scenes = all_shipped()
    output.result(lambda: {"scenes": scenes}, lambda: print_list(scenes))


@scene.command(epilog="Examples:\n\n  palpate scene show humid_body\n\n  palpate scene show my_scene.toml --json")
@click.argument("scene")
@output_options
def show(scene: str, as_json: bool, quiet: bool) -> None:
    """Show all parameters of a scene, also those with their default values."""
    from palpate.procedures.virtual.parameters import parameters, print_scene

    output = Output(as_json, quiet)
    shown = parameters(scene)
    output.result(lambda: shown, lambda: print_scene(shown))


@scene.command(epilog="Examples:\n\n  palpate scene check my_scene.toml")
@click.argument("scene")
@output_options
def check(scene: str, as_json: bool, quiet: bool) -> None:
    """Read a scene and run it for a moment, with sample 2 under 3 N: exit status 0 if it can be simulated."""
    from palpate.procedures.virtual.parameters import run_briefly

    output = Output(as_json, quiet)
    found = run_briefly(scene)
    if output.as_json:
        output.json(found)
    output.line(f"{found['scene']}: can be simulated")


@scene.command(
    epilog="Examples:\n\n  palpate scene plot overdriven\n\n  palpate scene plot my_scene.toml --load '4 N'"
    " --out chain.png"
)
@click.argument("scene")
@question_options
@option("--periods", default=3, type=click.IntRange(1, 100), help="Number of drawn periods.")
@option("--out", type=FILE_NAME, metavar="FILE.png", help="File of the picture (default: new in runs/plots/).")
@output_options
def plot(
    scene: str, sample: str, load: float, frequency: float, periods: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Draw the waveforms at each stage of a scene, from the shaker's coil to the samples of the sensor nodes."""
    from palpate.procedures.virtual.explained import Question
    from palpate.procedures.virtual.waveforms import plot as plot_waveforms

    output = Output(as_json, quiet)
    found = plot_waveforms(scene, Question(sample, load, frequency), periods, out)
    if output.as_json:
        output.json(found)
    output.line(found["file"])
