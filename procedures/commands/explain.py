"""palpate scene explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import ConfigError
from palpate.procedures.commands.options import Command, F, Output, output_options

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.simulators.planning.plan import Plan, Question
    from palpate.simulators.scenes.scene import Scene


def question_options(command: F) -> F:
    """--sample, --load and --frequency."""
    for option in (
        click.option("--frequency", default="10 Hz", show_default=True, help="Frequency of the load."),
        click.option("--load", default="3 N", show_default=True, help="Load, peak to peak, if nothing limits it."),
        click.option("--sample", default="2", show_default=True, help="Sample that is pressed."),
    ):
        command = option(command)
    return command


def asked(sample: str, load: str, frequency: str, dwell: str = "1 s", *, steady: bool = False) -> Question:
    """What the options ask. Raises UsageError."""
    from palpate.instrument.quantity import parse
    from palpate.simulators.planning.plan import Question

    return Question(sample, parse(load, "N"), parse(frequency, "Hz"), parse(dwell, "s"), steady)


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate scene explain thesis_single\n\n  palpate scene explain my_scene.toml --load '1.5 N'"
    " --tolerance 1e-3 --strict --json\n\n  palpate scene explain everything --steady",
)
@click.argument("scene")
@question_options
@click.option("--dwell", default="1 s", show_default=True, help="Time over which it is averaged.")
@click.option("--steady", is_flag=True, help="Of the settled state, not of waveforms; and what it is.")
@click.option("--tolerance", default="1e-4", show_default=True, help="What may be left out without a mark.")
@click.option("--strict", is_flag=True, help="A warning is an error.")
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
    """What a scene simulates and how, and what leaving the rest out can change."""
    from palpate.instrument.quantity import parse_tolerance
    from palpate.simulators.planning.plan import plan
    from palpate.simulators.planning.settle import read_scene

    chosen = read_scene(scene)
    limit = parse_tolerance(tolerance)
    answer = plan(chosen, asked(sample, load, frequency, dwell, steady=steady))
    if strict and answer.warnings:
        raise ConfigError(f"scene {scene!r}: {answer.warnings[0]}")
    output = Output(as_json, quiet)
    if output.as_json:
        faults = chosen.file.fault or []
        output.json(
            {
                "scene": chosen.name,
                "model": chosen.model,
                "parameter_set": chosen.file.parameters,
                "tolerance": limit,
                **asdict(answer),
                "faults": faults,
            }
        )
    elif output.for_people:
        _print(chosen, answer, limit)


def _print(scene: Scene, answer: Plan, tolerance: float) -> None:
    from palpate.procedures.console.terminal import console

    out = console()
    out.print(f"Scene {scene.name}: {scene.purpose}", soft_wrap=True)
    out.print(f"path: {answer.path}: {answer.why}", soft_wrap=True)
    out.print(f"{answer.transitions:g} transitions a second, about {answer.seconds:.2g} s of computing")
    inside = [
        (e.name, e.kind, "yes" if e.cancels_in_ratio else "no", f"{1e3 * e.seconds:.2g}", e.why)
        for e in answer.included
    ]
    out.print(_table("simulated", ("effect", "kind", "cancels in the ratio", "cost (ms)", "why"), inside))
    outside = [
        (e.name, e.kind, *("no limit *" if b is None else _marked(b, tolerance) for b in (e.force, e.ratio)))
        for e in answer.omitted
    ]
    title = f"left out, and the most that it could change (* above {tolerance:g})"
    out.print(_table(title, ("effect", "kind", "force", "ratio"), outside))
    if answer.steady is not None:
        films = [
            (f.film, f"{1e3 * f.amplitude:.6g}", f"{f.phase:.4f}", "" if f.ratio is None else f"{f.ratio:.6g}")
            for f in answer.steady.films
        ]
        title = f"settled, at {answer.steady.force:.6g} N peak to peak on the load cell"
        out.print(_table(title, ("film", "amplitude (mV)", "phase (rad)", "force ratio"), films))
    for fault in scene.file.fault or []:
        out.print("fault: " + ", ".join(f"{key} {value}" for key, value in fault.items()), soft_wrap=True)
    for warning in answer.warnings:
        out.print(f"warning: {warning}", soft_wrap=True)


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich.table import Table

    table = Table(*columns, box=None, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    return table


def _marked(bound: float, tolerance: float) -> str:
    return f"{bound:.1e}{' *' if bound > tolerance else ''}"
