"""palpate scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.procedures.commands.explain import asked, explain, question_options
from palpate.procedures.commands.options import FILE_NAME, Group, Output, output_options
from palpate.procedures.lab.store import store

if TYPE_CHECKING:
    from palpate.simulators.scenes.scene import Scene


@click.group(cls=Group)
def scene() -> None:
    """Look at what a simulated bench simulates: shipped scenes, or files of your own."""


scene.add_command(explain)


@scene.command("list", epilog="Examples:\n\n  palpate scene list")
@output_options
def list_(as_json: bool, quiet: bool) -> None:
    """Scenes that come with palpate, and what each is for."""
    from palpate.simulators.planning.settle import read_scene
    from palpate.simulators.scenes.scene import shipped

    output = Output(as_json, quiet)
    scenes = [read_scene(name) for name in shipped()]
    if output.as_json:
        output.json({"scenes": [_head(each) for each in scenes]})
    elif output.for_people:
        from palpate.procedures.showing import scene_report

        scene_report.print_list([_head(each) for each in scenes])


@scene.command(epilog="Examples:\n\n  palpate scene show humid_body\n\n  palpate scene show my_scene.toml --json")
@click.argument("scene")
@output_options
def show(scene: str, as_json: bool, quiet: bool) -> None:
    """Every parameter of a scene, those included that its file leaves to their defaults."""
    from palpate.simulators.planning.settle import read_scene

    output = Output(as_json, quiet)
    chosen = read_scene(scene)
    shown = {
        **_head(chosen),
        "rig": chosen.rig.model_dump(mode="json"),
        "parameters": {name: effect.model_dump(mode="json") for name, effect in chosen.effects.items()},
    }
    if output.as_json:
        output.json(shown)
    elif output.for_people:
        from palpate.procedures.showing import scene_report

        scene_report.print_scene(shown)


@scene.command(epilog="Examples:\n\n  palpate scene check my_scene.toml")
@click.argument("scene")
@output_options
def check(scene: str, as_json: bool, quiet: bool) -> None:
    """Read a scene and run it for a moment, with sample 2 under 3 N: exit status 0 if it can be simulated."""
    from palpate.simulators.planning.plan import Question
    from palpate.simulators.planning.settle import read_scene
    from palpate.simulators.planning.waveforms import waveforms

    output = Output(as_json, quiet)
    chosen = read_scene(scene)
    waveforms(chosen, Question(), periods=1)
    if output.as_json:
        output.json(_head(chosen))
    output.line(f"{chosen.name}: can be simulated")


@scene.command(
    epilog="Examples:\n\n  palpate scene plot overdriven\n\n  palpate scene plot my_scene.toml --load '4 N'"
    " --out chain.png"
)
@click.argument("scene")
@question_options
@click.option("--periods", default=3, show_default=True, type=click.IntRange(1, 100), help="How many are drawn.")
@click.option("--out", type=FILE_NAME, metavar="FILE.png", help="Where the picture goes (default: new in runs/plots/).")
@output_options
def plot(
    scene: str, sample: str, load: str, frequency: str, periods: int, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Draw the waveforms at each stage of the chain, from the shaker's coil to what the sensor nodes send."""
    from palpate.procedures.showing import model_plot, scene_plot
    from palpate.simulators.planning.settle import read_scene
    from palpate.simulators.planning.waveforms import waveforms

    output = Output(as_json, quiet)
    chosen = read_scene(scene)
    question = asked(sample, load, frequency)
    file = model_plot.place("".join(c if c.isalnum() or c in "-_" else "-" for c in chosen.name), out, store())
    seen = waveforms(chosen, question, periods)
    title = f"scene {chosen.name}: sample {sample}, {load} peak to peak at {frequency}"
    scene_plot.draw(chosen.design, seen, title, file)
    if output.as_json:
        output.json({"scene": chosen.name, "sample": sample, "load_N": question.load, "file": str(file)})
    output.line(str(file))


def _head(scene: Scene) -> dict[str, Any]:
    return {
        "scene": scene.name,
        "purpose": scene.purpose,
        "design": scene.design.name,
        "model": scene.model,
        "parameter_set": scene.file.parameters,
        "seed": scene.seed,
        "nodes": scene.nodes,
        "effects": list(scene.effects),
    }
