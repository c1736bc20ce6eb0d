"""palpate softness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from palpate.procedures.commands.options import (
    Choice,
    Command,
    Output,
    bench_options,
    budget_option,
    dwell_option,
    frequency_option,
)

if TYPE_CHECKING:
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.sensor.sample import Sample


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate softness --samples 1-6\n\n  palpate softness --modulus '60 kPa' --json"
    "\n\n  palpate softness --bench lab.toml --thickness '3 mm'",
)
@click.option("--samples", help="Rubber samples, in order.")
@click.option("--modulus", help="Young modulus of unknown objects, or a list with commas: of a simulated bench.")
@click.option("--thickness", default="3 mm", show_default=True, help="Of an unknown object.")
@click.option("--loads", default="2 N:4 N:1 N", show_default=True, help="first:last:step or a list; peak to peak.")
@dwell_option
@frequency_option
@click.option("--model", metavar="NAME", help="That answers: experiment, auto, column, ... (default: experiment).")
@bench_options
@budget_option
def softness(
    samples: str | None,
    modulus: str | None,
    thickness: str,
    loads: str,
    dwell: str,
    frequency: str,
    model: str | None,
    choice: Choice,
    output: Output,
) -> None:
    """Measure how hard objects are: Young modulus with an interval, and their order.

    Without --samples and --modulus one unknown object is mounted, on a real bench. Where the ratio says little of the
    modulus, above 0.97 or outside what the model gives, the answer is a bound. The model that turns ratios into moduli
    is named with its price; "experiment" interpolates what was measured on the six samples.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.commands.procedures import chosen_by, measure
    from palpate.procedures.measurements.softness.procedure import SoftnessTest, default_model
    from palpate.procedures.steps.checks import parse_loads

    design = chosen_by(choice).target.design
    test = SoftnessTest(
        _objects(design, samples, modulus, parse(thickness, "m"), real=choice.bench is not None),
        parse_loads(loads),
        parse(dwell, "s"),
        parse(frequency, "Hz"),
        model or default_model(design),
    )
    measure(test, choice, output)


def _objects(
    design: Design, samples: str | None, modulus: str | None, thickness: float, real: bool
) -> tuple[Sample, ...]:
    """What is to be mounted, in order.

    Raises:
        UsageError: both or neither are given, or a modulus for a real bench.
    """
    from palpate.instrument.errors import UsageError
    from palpate.instrument.quantity import parse
    from palpate.instrument.sensor.sample import get_sample, parse_samples
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if samples is not None and modulus is not None:
        raise UsageError("--samples and --modulus: name samples, or give moduli of unknown objects; not both")
    if samples is not None:
        return tuple(get_sample(name) for name in parse_samples(samples))
    if real and modulus is not None:
        raise UsageError("--modulus: on a real bench the object has its own; leave it out")
    if modulus is not None:
        return tuple(unknown_object(design, thickness, parse(text, "Pa")) for text in modulus.split(","))
    if not real:
        raise UsageError("--samples or --modulus is missing: say what the simulated bench shall touch")
    return (unknown_object(design, thickness),)
