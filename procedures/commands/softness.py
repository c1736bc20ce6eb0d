"""The command palpate softness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import option

if TYPE_CHECKING:
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.sensor.sample import Sample


@click.command(
    cls=options.Command,
    epilog="Examples:\n\n  palpate softness --samples 1-6\n\n  palpate softness --samples 1-6 --risk 5%"
    "\n\n  palpate softness --modulus '60 kPa' --json"
    "\n\n  palpate softness --bench lab.toml --thickness '3 mm'",
)
@option("--samples", callback=texts.samples, help="Rubber samples, in order.")
@option(
    "--modulus",
    callback=texts.quantities("Pa", positive=True),
    help="Young modulus of unknown objects on a simulated bench, or a list with commas.",
)
@options.thickness_option
@options.loads_option("2 N:4 N:1 N")
@options.dwell_option
@options.frequency_option
@option("--model", metavar="NAME", help="Sensor model: experiment, auto, column, ... (default: experiment).")
@option(
    "--risk",
    callback=texts.share,
    help="Risk of a wrong pair in the order, such as 5%: the test ends as soon as the order is known.",
)
@option("--sets", type=int, help="With --risk: most load sets of each object (default: 5), which take --loads in turn.")
@options.DRY_RUN
@options.bench_options
@options.budget_option
def softness(
    samples: tuple[str, ...] | None,
    modulus: tuple[float, ...] | None,
    thickness: float | None,
    loads: tuple[float, ...],
    dwell: float,
    frequency: float,
    model: str | None,
    risk: float | None,
    sets: int | None,
    dry_run: bool,
    choice: options.Choice,
    output: options.Output,
) -> None:
    """Measure the softness of objects: the Young modulus with two uncertainties, and their order.

    On a real bench, without --samples and --modulus, one unknown object is mounted. If the ratio says little about the
    modulus (above 0.97, or outside the model's range), the answer is only a bound. The result names the model that
    turns ratios into moduli, and its error; "experiment" interpolates the measurements on the six samples. The
    uncertainty on the model's scale is for comparing objects; the absolute one holds the model's validation error, by
    references (palpate calibrate model) or by the thesis' experiments.

    With --risk the order is what counts: each object gets one to five load sets, as many as tell it from the others.
    The result says which pairs they did not tell, and what would.
    """
    from palpate.procedures.commands.procedures import chosen_by, measure, plan
    from palpate.procedures.measurements.softness.procedure import SoftnessTest, default_model
    from palpate.procedures.measurements.softness.ranking import MOST

    design = chosen_by(choice).target.design
    objects = _objects(design, samples, modulus, thickness, real=choice.bench is not None)
    if sets is not None and risk is None:
        raise UsageError("--sets is for --risk: without it each of --loads is one set; name a load twice for two")
    named = model or default_model(design)
    most = MOST if sets is None else sets
    test = SoftnessTest(objects, loads, dwell, frequency, named, risk, most)
    (plan if dry_run else measure)(test, choice, output)


def _objects(
    design: Design, samples: Sequence[str] | None, modulus: Sequence[float] | None, thickness: float | None, real: bool
) -> tuple[Sample, ...]:
    """The objects to mount, in order.

    Raises:
        UsageError: samples and moduli are both given, neither is given for a simulated bench, a modulus is given for
            a real bench, or a thickness beside samples.
    """
    from palpate.instrument.sensor.sample import get_sample
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if samples is not None and modulus is not None:
        raise UsageError("--samples and --modulus: give either samples or moduli of unknown objects, not both")
    thick = options.unknown_thickness(thickness, samples)
    if samples is not None:
        return tuple(get_sample(name) for name in samples)
    if real and modulus is not None:
        raise UsageError("--modulus: on a real bench the object has its own modulus; leave this option out")
    if modulus is not None:
        return tuple(unknown_object(design, thick, value) for value in modulus)
    if not real:
        raise UsageError("--samples or --modulus is missing: name the objects that the simulated bench touches")
    return (unknown_object(design, thick),)
