"""The command palpate accuracy and its subcommands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import (
    FILE_NAME,
    Output,
    StrictCommand,
    StrictGroup,
    dwell_option,
    option,
    output_options,
    picture_option,
)
from palpate.procedures.commands.scene import question_options
from palpate.procedures.commands.settings import SettingsCommand
from palpate.procedures.commands.texts import SCENE
from palpate.procedures.lab.store import store as usual

if TYPE_CHECKING:
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus

# --- The command palpate accuracy --------------------------------------------------------------

TOLERANCE = 0.05


@click.command(
    cls=SettingsCommand,
    procedure="measure-modulus",
    without=("object", "time", "mountings"),
    epilog="Examples:\n\n  palpate accuracy front\n\n  palpate accuracy --modulus '48 kPa' --out prices.svg"
    "\n\n  palpate accuracy --sample 2 --mounting-scatter '1 %' --json"
    "\n\n  palpate accuracy --bench lab.toml --modulus '20 kPa' --model surface",
)
@option("--sample", help="Rubber sample (default: 4, if no modulus is given).")
@option("--modulus", callback=texts.quantity("Pa", positive=True), help="Young modulus that is expected of an object.")
@options.thickness_option
@option(
    "--scene",
    shell_complete=texts.complete_scene,
    metavar="NAME|FILE",
    help="Scene of a simulated bench (default: thesis_single).",
)
@option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench; nothing is sent to it.")
@option("--absolute", is_flag=True, help="Count the model's validation error, too, not its scale alone.")
@picture_option("no picture")
@output_options
def front_command(
    sample: str | None,
    modulus: float | None,
    thickness: float | None,
    scene: str | None,
    bench: Path | None,
    absolute: bool,
    settings: Mapping[str, object],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Show how well a modulus is known after which time, and what a tolerance costs.

    The quickest plans of `palpate measure modulus`, and for one tolerance (5 % by default) what it asks of each cause
    of uncertainty, and who pays: the bench, a person, or the processor. Nothing is measured. Exit status 1: no plan
    reaches the tolerance.
    """
    from palpate.instrument.errors import UsageError
    from palpate.instrument.sensor.sample import get_sample
    from palpate.procedures.accuracy.front import ModulusFront
    from palpate.procedures.commands.measure import object_to_touch
    from palpate.procedures.engine.settings import made
    from palpate.procedures.lab.calibrations import with_films
    from palpate.procedures.lab.chosen import choose
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus
    from palpate.procedures.records.run import check_new
    from palpate.procedures.showing.figure import FORMATS

    output = Output(as_json, quiet)
    if absolute and settings.get("relative_to_model"):
        raise UsageError("--absolute and --relative-to-model: they are each other's contrary; give one of them")
    check_new(out, FORMATS)
    target = with_films(choose(bench, scene).target)
    touched_name = "4" if sample is None and modulus is None else sample
    touched = None if touched_name is None else get_sample(touched_name)
    object_ = object_to_touch(target.design, touched, modulus, thickness, real=False)
    tolerance = settings.get("tolerance") or TOLERANCE
    asked = made(
        ObjectModulus, {"tolerance": tolerance, "relative_to_model": not absolute, **settings, "object": object_}
    )
    with output.prices():
        asked.check(target)
        command = _command(asked, touched_name, thickness, scene, bench)
        front = ModulusFront.of(asked.plans_on(target), object_.modulus, command)
    plot = None if out is None else str(out.absolute())
    if out is not None:
        from palpate.procedures.accuracy.front import plot_front

        plot = plot if plot_front(front, bench is None, out) else None

    def show() -> None:
        from palpate.procedures.accuracy.front import print_front

        print_front(front, bench is None, "" if out is None else plot or "none: no plan reaches ± 50 %")

    head = {"simulated": bench is None, "design": target.design.name, "sample": touched_name}
    output.result(lambda: {**head, **front.summary(), "plot": plot}, show)
    return 1 if front.asked is None else 0


def _command(
    asked: ObjectModulus, sample: str | None, thickness: float | None, scene: str | None, bench: Path | None
) -> list[str]:
    """The command that measures what was asked about, without a tolerance."""
    words = ["palpate", "measure", "modulus"]
    words += ["--modulus", f"{asked.object.modulus:.10g} Pa"] if sample is None else ["--sample", sample]
    given = {
        "--thickness": None if thickness is None else f"{thickness:.10g} m",
        "--scene": scene,
        "--bench": None if bench is None else str(bench),
        "--load": None if asked.load is None else f"{asked.load:.10g} N",
        "--frequency": f"{asked.frequency:.10g} Hz",
        "--model": asked.model,
        "--mounting-scatter": None if asked.mounting_scatter is None else f"{100 * asked.mounting_scatter:.10g} %",
        "--mounting-freedom": None if asked.mounting_freedom is None else f"{asked.mounting_freedom:.10g}",
    }
    usual = {"--frequency": "10 Hz", "--model": "auto"}
    options = {name: value for name, value in given.items() if value is not None and usual.get(name) != value}
    return words + [word for each in options.items() for word in each]


# --- The command palpate accuracy promises -------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy promises\n\n  palpate accuracy promises --store elsewhere --json",
)
@option("--store", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs (default: runs/).")
@output_options
def promises_command(store: Path | None, as_json: bool, quiet: bool) -> None:
    """Compare what runs were predicted to take and to give with what they took and gave.

    Of each procedure whose runs are in the store: bench time over the predicted one, and the share of runs that ended
    within the printed bound, where the plan has one; and of each result, its standard uncertainty over the predicted
    one.
    """
    from dataclasses import asdict

    from palpate.instrument.errors import UsageError
    from palpate.procedures.accuracy.promises import print_promises, promises

    output, folder = Output(as_json, quiet), store or usual()
    if not folder.is_dir() and (store is not None or folder.exists()):
        raise UsageError(f"{folder} is no folder; name one that holds runs with --store")
    kept = promises(folder)
    found = {
        "store": str(folder),
        "procedures": kept.procedures(),
        "runs": [asdict(each) for each in kept.runs],
        "without": kept.without,
        "unreadable": kept.unreadable,
    }
    output.result(lambda: found, lambda: print_promises(kept, folder))


# --- The command palpate accuracy scene ----------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy scene noisy_lab"
    "\n\n  palpate accuracy scene everything --sample 6 --load '4 N' --out prices.svg --json",
)
@SCENE
@question_options
@dwell_option
@picture_option("no picture")
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
    from palpate.procedures.records.run import check_new
    from palpate.procedures.showing.figure import FORMATS
    from palpate.procedures.virtual.explained import Question, SceneFront, plot_front, print_front

    output = Output(as_json, quiet)
    check_new(out, FORMATS)
    with output.prices(), output.progress("the whole scene") as progress:
        found = SceneFront.of(scene, Question(sample, load, frequency, dwell), progress)
    if out is not None:
        plot_front(found, out)
    plot = None if out is None else str(out.absolute())
    output.result(lambda: {**found.summary(), "plot": plot}, lambda: print_front(found, plot))


# --- The command palpate accuracy numerics, and the group ----------------------------------------------


class FrontFirst(StrictGroup):
    """A group that shows the front where no command is named."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args or (args[0].startswith("-") and args[0] not in ctx.help_option_names):
            args = ["front", *args]
        return super().parse_args(ctx, args)


@click.group(
    cls=FrontFirst,
    invoke_without_command=True,
    epilog="Examples:\n\n  palpate accuracy\n\n  palpate accuracy --modulus '48 kPa' --out prices.svg --json"
    "\n\n  palpate accuracy numerics",
)
def accuracy() -> None:
    """Show how much time accuracy costs. Without a command: as palpate accuracy front, with its options."""


accuracy.add_command(front_command, "front")
accuracy.add_command(promises_command, "promises")
accuracy.add_command(scene_command, "scene")


@accuracy.command(
    epilog="Examples:\n\n  palpate accuracy numerics\n\n  palpate accuracy numerics --design array --out prices.svg"
    " --json\n\n  palpate accuracy numerics --store\n\n  palpate accuracy numerics --design single --store"
)
@option("--design", help="single_round, single, common_base, different_base, array or array_16 (default: single).")
@option("--store", is_flag=True, help="First measure the models' prices anew, of all designs or of the named one.")
@picture_option("no picture")
@output_options
def numerics(design: str | None, store: bool, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Show error and time of every method that computes a number, in about 15 s.

    Of sensor models it is the stored price list, by which model auto chooses: bounds on the error of the force ratio,
    for objects like the thesis' rubber samples, and processor time on the machine that is named. Estimators read the
    ratio of two films from simulated records of some dwells; the Cramér–Rao bound is the least that noise allows.
    Integrators follow a stiff chain and a hysteresis; arithmetic keeps numbers in few bits. A star marks the methods
    of which no other is nearer and quicker. Measuring the models takes five minutes for all designs.
    """
    from dataclasses import asdict

    from palpate.instrument.durable import put_whole
    from palpate.instrument.errors import UnknownName
    from palpate.instrument.models import price_list
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.accuracy.measure import DESIGNS, expected_seconds, measure, this_machine
    from palpate.procedures.accuracy.meshes import MODULI
    from palpate.procedures.records.run import check_new, storing
    from palpate.procedures.showing.figure import FORMATS
    from palpate.procedures.virtual.numerics import SECONDS, collect

    output = Output(as_json, quiet)
    if design is not None and design not in DESIGNS:
        raise UnknownName("design with prices", design, DESIGNS)
    check_new(out, FORMATS)
    with output.prices(), output.progress("the stored prices") as progress:
        if store:
            if design is not None:
                price_list.stored().require_like(this_machine(), MODULI)  # before anything is measured
            asked = list(DESIGNS) if design is None else [design]
            price("measuring the models", expected_seconds(asked))
            fresh = measure(asked, progress)
            with storing(price_list.STORED):
                put_whole(price_list.STORED, text(fresh if design is None else price_list.stored().replaced(fresh)))
            price_list.stored.cache_clear()
        prices = price_list.stored()
        price("measuring estimators, integrators and arithmetic", SECONDS)
        tasks = collect(design or "single", progress)
    plot = None if out is None else str(out.absolute())
    if out is not None:
        from palpate.procedures.accuracy.numerics import plot_numerics

        plot_numerics(tasks, out)

    def show() -> None:
        from palpate.procedures.accuracy.numerics import print_numerics

        print_numerics(tasks, prices.machine.provenance(this_machine()), plot)

    document = {"machine": asdict(prices.machine), "tasks": [task.summary() for task in tasks]}
    output.result(lambda: {**document, "plot": plot}, show)
