"""palpate scene explain."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from instrument.errors import ConfigError
from procedures.cli.options import Output, output_options

if TYPE_CHECKING:
    from simulators.plan import Plan
    from simulators.scene import Scene


@click.command(
    epilog="Examples:\n\n  palpate scene explain thesis_single\n\n  palpate scene explain my_scene.toml --load '1.5 N'"
    " --tolerance 1e-3 --strict --json"
)
@click.argument("scene")
@click.option("--sample", default="2", show_default=True, help="Sample that is measured.")
@click.option("--load", default="3 N", show_default=True, help="Load, peak to peak.")
@click.option("--frequency", default="10 Hz", show_default=True, help="Frequency of the load.")
@click.option("--dwell", default="1 s", show_default=True, help="Time over which it is averaged.")
@click.option("--tolerance", default="1e-4", show_default=True, help="What may be left out without a mark.")
@click.option("--strict", is_flag=True, help="A warning is an error.")
@output_options
def explain(
    scene: str,
    sample: str,
    load: str,
    frequency: str,
    dwell: str,
    tolerance: str,
    strict: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """What a scene simulates and how, and what leaving the rest out can change."""
    from instrument.quantity import parse
    from simulators.plan import Question, plan
    from simulators.scene import read_scene

    chosen = read_scene(scene)
    limit = parse(tolerance, "")
    question = Question(sample, parse(load, "N"), parse(frequency, "Hz"), parse(dwell, "s"))
    answer = plan(chosen, question)
    if strict and answer.warnings:
        raise ConfigError(f"scene {scene!r}: {answer.warnings[0]}")
    output = Output(as_json, quiet)
    if output.as_json:
        output.json({"scene": chosen.name, "model": chosen.model, "tolerance": limit, **asdict(answer)})
    elif output.for_people:
        _print(chosen, answer, limit)


def _print(scene: Scene, answer: Plan, tolerance: float) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    console.print(f"Scene {scene.name}: {scene.purpose}", soft_wrap=True)
    console.print(f"path: {answer.path}: {answer.why}", soft_wrap=True)
    console.print(f"{answer.transitions:g} transitions a second, about {answer.seconds:.2g} s of computing")
    inside = Table(box=None, title="simulated", title_justify="left")
    for column in ("effect", "kind", "cancels in the ratio", "why"):
        inside.add_column(column)
    for included in answer.included:
        inside.add_row(included.name, included.kind, "yes" if included.cancels_in_ratio else "no", included.why)
    console.print(inside)
    outside = Table(box=None, title=f"left out, and the most that it could change (* above {tolerance:g})")
    outside.title_justify = "left"
    for column in ("effect", "kind", "force", "ratio"):
        outside.add_column(column)
    for omitted in answer.omitted:
        bounds = (omitted.force, omitted.ratio)
        outside.add_row(
            omitted.name, omitted.kind, *("no limit *" if b is None else _marked(b, tolerance) for b in bounds)
        )
    console.print(outside)
    for warning in answer.warnings:
        console.print(f"warning: {warning}", soft_wrap=True)


def _marked(bound: float, tolerance: float) -> str:
    return f"{bound:.1e}{' *' if bound > tolerance else ''}"
