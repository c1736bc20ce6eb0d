"""The command palpate accuracy and its subcommands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import (
    FILE_NAME,
    Output,
    StrictCommand,
    StrictGroup,
    dwell_option,
    make_folder,
    option,
    output_options,
)
from palpate.procedures.commands.scene import question_options
from palpate.procedures.commands.settings import SettingsCommand
from palpate.procedures.lab.store import store as usual

# --- The command palpate accuracy dwell ----------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy dwell\n\n  palpate accuracy dwell --scene noisy_lab --load '1.5 N'"
    "\n\n  palpate accuracy dwell --estimator 'least squares' --dwell '0.5 s, 5 s' --json",
)
@option("--scene", metavar="NAME|FILE", default="thesis_single", help="Scene to simulate.")
@question_options
@option(
    "--dwell",
    callback=texts.quantities("s"),
    help="Dwells, with commas (default: 0.1 s to 10 s, all of a cycle or more).",
)
@option("--estimator", multiple=True, help="Such as 'least squares'; repeat it for more (default: all).")
@option("--rate", callback=texts.quantity("Hz"), help="Sample rate, such as '250 Hz' (default: 25 samples in a cycle).")
@option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the scene.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot dwell.png (default: no plot).")
@output_options
def dwell_command(
    scene: str,
    sample: str,
    load: float,
    frequency: float,
    dwell: tuple[float, ...] | None,
    estimator: tuple[str, ...],
    rate: float | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Show uncertainty and bias of the force ratio against the dwell, for each estimator, with the Cramér–Rao bound.

    One long record of a settled load is cut into pieces. A longer dwell cannot reduce the scatter of the films' gains
    from one load set to the next, nor disturbances that move in step with the drive.
    """
    from palpate.instrument.errors import EstimateError
    from palpate.instrument.quantity import show
    from palpate.procedures.virtual.explained import Question
    from palpate.procedures.virtual.waveforms import SAMPLES_PER_CYCLE, price

    output = Output(as_json, quiet)
    sampled = SAMPLES_PER_CYCLE * frequency if rate is None else rate
    question = Question(sample, load, frequency)
    make_folder(out)
    prices = price(scene, seed, question, sampled, dwell, estimator)
    title = f"scene {scene}: force ratio of sample {sample} under {show(load, 'N')} at {show(frequency, 'Hz')}"
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.dwell import plot_dwell

        plot = plot_dwell(prices, title, out)
    if output.as_json:
        head = {"simulated": True, "scene": scene, "sample": sample, "load_N": load}
        rates = {"frequency_Hz": frequency, "sample_rate_Hz": sampled}
        output.json({**head, **rates, **prices.summary(), "plot": None if plot is None else str(plot)})
    elif output.for_people:
        from palpate.procedures.accuracy.dwell import print_dwell

        print_dwell(prices, title, plot)
    if prices.saturated:
        raise EstimateError(f"scene {scene}: a film is over-ranged, so no result is usable; take a smaller --load")


# --- The command palpate accuracy modulus --------------------------------------------------------------

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
    from palpate.procedures.commands.measure import object_to_touch
    from palpate.procedures.engine.settings import made
    from palpate.procedures.lab.calibrations import with_films
    from palpate.procedures.lab.chosen import choose
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


# --- The command palpate accuracy without a subcommand -------------------------------------------------


def page(out: Path | None, output: Output) -> None:
    """Collect the stored results, measure the others, and show all."""
    from palpate.procedures.virtual.page import collect

    make_folder(out)
    with output.progress("time integration") as progress:
        parts = collect(progress)
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.page import plot_page

        plot = plot_page(parts, out)
    if output.as_json:
        output.json({"parts": [part.summary() for part in parts], "plot": None if plot is None else str(plot)})
    elif output.for_people:
        from palpate.procedures.accuracy.page import print_page

        print_page(parts, plot)


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
    from palpate.instrument.errors import UsageError
    from palpate.procedures.accuracy.promises import print_promises, promises

    output, folder = Output(as_json, quiet), store or usual()
    if not folder.is_dir() and (store is not None or folder.exists()):
        raise UsageError(f"{folder} is no folder; name one that holds runs with --store")
    kept = promises(folder)
    found = {
        "store": str(folder),
        "procedures": [each.row() for each in kept.procedures],
        "runs": [each.row() for each in kept.runs],
        "without": kept.without,
        "unreadable": kept.unreadable,
    }
    output.result(lambda: found, lambda: print_promises(kept, folder))


# --- The command palpate accuracy scene ----------------------------------------------------------------


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


# --- The command palpate accuracy validation -----------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy validation\n\n  palpate accuracy validation --design single --json",
)
@option("--design", help="single, common_base or different_base (default: all).")
@option("--store", is_flag=True, help="Solve the stored finite elements anew, and store them.")
@output_options
def validation(design: str | None, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the difference of each sensor model from the thesis' experiments, sample by sample.

    It is the model minus the measured mean, in percent of the measured mean, so positive values mean that the model is
    higher. No mesh makes it smaller. A model that was built from the measured means is "input": they cannot judge it.
    """
    from palpate.instrument.errors import UnknownName, UsageError
    from palpate.instrument.models import validation as kept
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.accuracy.measure import keep
    from palpate.procedures.showing.validation import print_validation

    output = Output(as_json, quiet)
    designs = kept.measured_designs()
    if design is not None and design not in designs:
        raise UnknownName("design with experiments", design, designs)
    if design is not None and store:
        raise UsageError("--design: not with --store, which always takes one sensor and the pairs")
    if store:
        with output.prices(), output.progress("solving") as progress:
            price("solving the stored finite elements anew", kept.SECONDS)
            keep(text(kept.measure(progress)), kept.STORED)
            kept.stored.cache_clear()
    compared = kept.validate_all(designs if design is None else [design])
    if output.as_json:
        output.json({"sign": kept.SIGN, "models": [each.record() for each in compared]})
    elif output.for_people:
        print_validation(compared)


# --- The command palpate accuracy integrators ----------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy integrators\n\n  palpate accuracy integrators --out prices --json",
)
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot integrators.png (default: no plot).")
@output_options
def integrators(out: Path | None, as_json: bool, quiet: bool) -> None:
    """Measure error and time of methods that integrate a stiff chain in time; this takes about 5 s.

    The chain has nine states whose rates span six decades. It starts at rest, under a 10 Hz sine for 10 s. The error is
    the greatest error of the output over its greatest value, against a matrix exponential in extended precision. A
    second task is a Bouc-Wen operator, whose hysteresis is stiff under steps of x, over 3 cycles of the sine.
    """
    from palpate.instrument.notice import price
    from palpate.procedures.virtual.integrators import SECONDS, measure, plot_integrators, print_integrators, task

    output = Output(as_json, quiet)
    make_folder(out)
    with output.prices(), output.progress() as progress:
        price("following the chain by every method", SECONDS)
        rows = measure(progress)
    done = task()
    title = f"{done['states']} states, stiffness ratio {done['stiffness_ratio']:.0e}, {done['duration_s']:g} s record"
    plot = None if out is None else plot_integrators(rows, title, out)
    output.result(
        lambda: {**done, "methods": rows, "plot": None if plot is None else str(plot)},
        lambda: print_integrators(rows, title, plot),
    )


# --- accuracy models and surfaces, and the group -------------------------------------------------------


@click.group(
    cls=StrictGroup,
    invoke_without_command=True,
    epilog="Examples:\n\n  palpate accuracy\n\n  palpate accuracy --out prices --json\n\n  palpate accuracy dwell",
)
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot accuracy.png (default: no plot).")
@output_options
@click.pass_context
def accuracy(context: click.Context, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Show how much time accuracy costs. Without a command: all of it on one page, in about 20 s."""
    if context.invoked_subcommand is None:
        page(out, Output(as_json, quiet))
    elif out is not None or as_json or quiet:
        raise click.UsageError(f"give the options of {context.invoked_subcommand!r} after it, not before it")


accuracy.add_command(integrators)
accuracy.add_command(modulus_command, "modulus")
accuracy.add_command(dwell_command, "dwell")
accuracy.add_command(promises_command, "promises")
accuracy.add_command(scene_command, "scene")
accuracy.add_command(validation)


@accuracy.command(
    epilog="Examples:\n\n  palpate accuracy models\n\n  palpate accuracy models --design single --out prices --json"
    "\n\n  palpate accuracy models --store\n\n  palpate accuracy models --design single --store"
)
@option("--design", help="single_round, single, common_base, different_base, array or array_16 (default: all).")
@option("--measure", "anew", is_flag=True, help="Measure on this machine: five minutes for all designs.")
@option("--store", is_flag=True, help="Measure, and store the result in the list by which models are chosen.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot models.png (default: no plot).")
@output_options
def models(design: str | None, anew: bool, store: bool, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Show error and time of every sensor model at every refinement: the list by which model "auto" chooses.

    The stored list names the machine on which it was measured; times are processor time. The error is the greatest
    difference from a converged reference, with the reference's own uncertainty, for objects like the thesis' rubber
    samples. The validation error is the rms difference from the thesis' experiments over their samples, which no mesh
    makes smaller: see palpate accuracy validation.
    """
    from palpate.instrument.errors import UnknownName
    from palpate.instrument.models import price_list
    from palpate.instrument.models.validation import validate
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.accuracy.measure import DESIGNS, expected_seconds, keep, measure, this_machine
    from palpate.procedures.accuracy.meshes import MODULI
    from palpate.procedures.accuracy.page import MODELS_PLOT, plot_prices

    output = Output(as_json, quiet)
    if design is not None and design not in DESIGNS:
        raise UnknownName("design with prices", design, DESIGNS)
    asked = list(DESIGNS) if design is None else [design]
    if store and design is not None:
        price_list.stored().require_like(this_machine(), MODULI)  # before anything is measured
    make_folder(out)
    if anew or store:
        with output.prices(), output.progress() as progress:
            price("measuring the models", expected_seconds(asked))
            prices = measure(asked, progress)
        if store:
            kept = prices if design is None else price_list.stored().replaced(prices)
            keep(text(kept), price_list.STORED)
    else:
        prices = price_list.stored() if design is None else price_list.stored().of(asked)
    designs = list(dict.fromkeys(price.design for price in prices.prices))
    priced = dict.fromkeys((price.design, price.model) for price in prices.prices)
    compared = [validate(of, "physical", by) for of, by in priced]
    plot = None if out is None else out / MODELS_PLOT
    # The numbers come first, so that none is lost if the plot cannot be written.
    if output.as_json:
        output.json(
            {
                **asdict(prices),
                "validation": [each.record() for each in compared],
                "plot": None if plot is None else str(plot),
            }
        )
    elif output.for_people:
        from palpate.procedures.showing.models import print_prices

        print_prices(prices, designs, compared, plot)
    if plot is not None:
        plot_prices(prices, designs, plot)


@accuracy.command(
    epilog="Examples:\n\n  palpate accuracy surfaces\n\n  palpate accuracy surfaces --design single --store"
)
@option("--design", help="single_round, single, common_base, different_base, array or array_16 (default: all).")
@option("--store", is_flag=True, help='Find the curves anew, and store them for model "surface".')
@output_options
def surfaces(design: str | None, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the curves from which model "surface" answers, with their bounds. Finding all takes four minutes."""
    from palpate.instrument.errors import UnknownName
    from palpate.instrument.models.curve import ratio_curve
    from palpate.instrument.models.parameter_sets import get_parameter_set
    from palpate.instrument.models.stored import surface
    from palpate.instrument.notice import price
    from palpate.instrument.sensor.designs import get_design
    from palpate.procedures.accuracy.measure import DESIGNS, expected_curve_seconds, sensor_of, sets_of
    from palpate.procedures.records.run import storing

    output = Output(as_json, quiet)
    if design is not None and design not in DESIGNS:
        raise UnknownName("design with a surface", design, DESIGNS)
    asked = list(DESIGNS) if design is None else [design]
    if store:
        with output.prices(), output.progress() as progress:
            price("finding the curves", sum(map(expected_curve_seconds, asked)))
            for done, name in enumerate(asked):
                sensors = [sensor_of(name, parameters) for parameters in sets_of(name)]
                with storing(surface.STORED):
                    for path in surface.build(name, sensors):
                        progress(done, len(asked), path.name)
    found = {}
    for name, parameters in [(each, own) for each in asked for own in sets_of(each)]:
        chosen = get_parameter_set(parameters, "surface")
        sensor, load = chosen.design(get_design(name)), chosen.load(1e5)
        found[name, parameters] = surface.find(sensor, load), ratio_curve(sensor, load, "surface").error
    if output.as_json:
        rows = [
            {
                "design": name,
                "parameters": parameters,
                "model": known.model,
                "meshes": len(known.meshes),
                "poles": len(known.poles.rates),
                "discretisation": error,
                "build_s": known.seconds,
            }
            for (name, parameters), (known, error) in found.items()
        ]
        output.json({"surfaces": rows})
    elif output.for_people:
        from palpate.procedures.showing.models import print_surfaces

        print_surfaces(found)
