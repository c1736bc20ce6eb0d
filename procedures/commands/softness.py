"""The command palpate softness."""

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
@click.option("--modulus", help="Young modulus of unknown objects on a simulated bench, or a list with commas.")
@click.option("--thickness", default="3 mm", show_default=True, help="Thickness of an unknown object.")
@click.option("--loads", default="2 N:4 N:1 N", show_default=True, help="first:last:step or a list; peak to peak.")
@dwell_option
@frequency_option
@click.option("--model", metavar="NAME", help="Sensor model: experiment, auto, column, ... (default: experiment).")
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
    """Measure the softness of objects: the Young modulus with an interval, and their order.

    On a real bench, without --samples and --modulus, one unknown object is mounted. If the ratio says little about the
    modulus (above 0.97, or outside the model's range), the answer is only a bound. The result names the model that
    turns ratios into moduli, with its error and time; "experiment" interpolates the measurements on the six samples.
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
    """The objects to mount, in order.

    Raises:
        UsageError: samples and moduli are both given, neither is given for a simulated bench, or a modulus is given
            for a real bench.
    """
    from palpate.instrument.errors import UsageError
    from palpate.instrument.quantity import parse
    from palpate.instrument.sensor.sample import get_sample, parse_samples
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if samples is not None and modulus is not None:
        raise UsageError("--samples and --modulus: give either samples or moduli of unknown objects, not both")
    if samples is not None:
        return tuple(get_sample(name) for name in parse_samples(samples))
    if real and modulus is not None:
        raise UsageError("--modulus: on a real bench the object has its own modulus; leave this option out")
    if modulus is not None:
        return tuple(unknown_object(design, thickness, parse(text, "Pa")) for text in modulus.split(","))
    if not real:
        raise UsageError("--samples or --modulus is missing: name the objects that the simulated bench touches")
    return (unknown_object(design, thickness),)
