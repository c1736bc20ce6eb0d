"""The command palpate accuracy modulus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import FILE_NAME, Output, make_folder, option, output_options
from palpate.procedures.commands.settings import SettingsCommand

ANY_TIME = 1000.0  # s; each point of the front has a time of its own


@click.command(
    cls=SettingsCommand,
    procedure="measure-modulus",
    without=("object", "tolerance", "time", "relative_to_model", "mountings"),
    epilog="Examples:\n\n  palpate accuracy modulus\n\n  palpate accuracy modulus --modulus '48 kPa' --out prices"
    "\n\n  palpate accuracy modulus --sample 2 --mounting-scatter '1 %' --json"
    "\n\n  palpate accuracy modulus --bench lab.toml --modulus '20 kPa' --model surface",
)
@option("--sample", help="Rubber sample (default: 4, if no modulus is given).")
@option("--modulus", callback=texts.quantity("Pa", positive=True), help="Young modulus that is expected of an object.")
@options.thickness_option
@option("--scene", metavar="NAME|FILE", help="Scene of a simulated bench (default: thesis_single).")
@option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench; nothing is sent to it.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot modulus.png (default: no plot).")
@output_options
def modulus_command(
    sample: str | None,
    modulus: float | None,
    thickness: float | None,
    scene: str | None,
    bench: Path | None,
    settings: Mapping[str, object],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show how well a modulus is known after which bench time, and what its uncertainty consists of.

    The best plan of `palpate measure modulus` for each time, with the plans for 20, 10, 5, 2 and 1 %. On the model's
    scale the uncertainty is that of statistics, meshes and films; the absolute one holds the model's validation error,
    too. Nothing is measured.
    """
    from palpate.instrument.sensor.sample import get_sample
    from palpate.procedures.accuracy.modulus.front import ModulusFront, PlanningCase
    from palpate.procedures.commands.measure_modulus import object_to_touch
    from palpate.procedures.engine.settings import made
    from palpate.procedures.lab.chosen import choose
    from palpate.procedures.lab.probable import with_films
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus

    output = Output(as_json, quiet)
    make_folder(out)
    target = replace(
        with_films(choose(bench, scene).target), model=None
    )  # nothing is simulated: no model must answer for a truth
    known = "4" if sample is None and modulus is None else sample
    touched = None if known is None else get_sample(known)
    object_ = object_to_touch(target.design, touched, modulus, thickness, real=False)
    asked = made(ObjectModulus, {**settings, "object": object_, "time": ANY_TIME})
    with output.prices():
        asked.check(target)
        question, references = asked.model_question(target.design), asked.references_on(target)
        setting = PlanningCase(target.design, question, asked.loads_on(target), asked.wanted(target), references)
        front = ModulusFront.of(setting, object_.modulus)
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.modulus.report import plot_modulus_front

        plot = plot_modulus_front(front, bench is None, out)

    def show() -> None:
        from palpate.procedures.accuracy.modulus.report import print_modulus_front

        print_modulus_front(front, bench is None, plot)

    head = {"simulated": bench is None, "design": target.design.name, "sample": known}
    output.result(lambda: {**head, **front.summary(), "plot": None if plot is None else str(plot)}, show)
