"""The command palpate softness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, cast

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import option
from palpate.procedures.commands.settings import SettingsCommand

if TYPE_CHECKING:
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.sensor.sample import Sample


@click.command(
    cls=SettingsCommand,
    procedure="softness",
    optional=("objects",),
    epilog="Examples:\n\n  palpate softness --samples 1-6\n\n  palpate softness --samples 1-6 --risk 5%"
    "\n\n  palpate softness --modulus '60 kPa' --json"
    "\n\n  palpate softness --bench lab.toml --thickness '3 mm'",
)
@option(
    "--modulus",
    callback=texts.quantities("Pa", positive=True),
    help="Young modulus of unknown objects on a simulated bench, or a list with commas.",
)
@options.thickness_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
def softness(
    modulus: tuple[float, ...] | None,
    thickness: float | None,
    settings: Mapping[str, object],
    dry_run: bool,
    choice: options.BenchChoice,
    output: options.Output,
) -> object:
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
    from palpate.procedures.engine.settings import made
    from palpate.procedures.measurements.softness.procedure import SoftnessTest, default_model

    design = chosen_by(choice).target.design
    samples = cast("tuple[Sample, ...] | None", settings.get("objects"))
    objects = _objects(design, samples, modulus, thickness, real=choice.bench is not None)
    if "sets" in settings and "risk" not in settings:
        raise UsageError("--sets is for --risk: without it each of --loads is one set; name a load twice for two")
    test = made(SoftnessTest, {"model": default_model(design), **settings, "objects": objects})
    return (plan if dry_run else measure)(test, choice, output)


def _objects(
    design: Design,
    samples: tuple[Sample, ...] | None,
    modulus: Sequence[float] | None,
    thickness: float | None,
    real: bool,
) -> tuple[Sample, ...]:
    """The objects to mount, in order.

    Raises:
        UsageError: samples and moduli are both given, neither is given for a simulated bench, a modulus is given for
            a real bench, or a thickness beside samples.
    """
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if samples is not None and modulus is not None:
        raise UsageError("--samples and --modulus: give either samples or moduli of unknown objects, not both")
    thick = options.unknown_thickness(thickness, samples)
    if samples is not None:
        return samples
    if real and modulus is not None:
        raise UsageError("--modulus: on a real bench the object has its own modulus; leave this option out")
    if modulus is not None:
        return tuple(unknown_object(design, thick, value) for value in modulus)
    if not real:
        raise UsageError("--samples or --modulus is missing: name the objects that the simulated bench touches")
    return (unknown_object(design, thick),)
