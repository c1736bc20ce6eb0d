"""The commands palpate accuracy, accuracy models and accuracy surfaces."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from palpate.procedures.commands.accuracy_dwell import dwell_command
from palpate.procedures.commands.accuracy_modulus import modulus_command
from palpate.procedures.commands.accuracy_page import page
from palpate.procedures.commands.accuracy_promises import promises_command
from palpate.procedures.commands.accuracy_scene import scene_command
from palpate.procedures.commands.integrators import integrators
from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, make_folder, option, output_options
from palpate.procedures.commands.validation import validation


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
    from palpate.procedures.accuracy.keep import keep
    from palpate.procedures.accuracy.machine import this_machine
    from palpate.procedures.accuracy.measure import DESIGNS, expected_seconds, measure
    from palpate.procedures.accuracy.meshes import MODULI
    from palpate.procedures.accuracy.plot import MODELS_PLOT, plot_prices

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
