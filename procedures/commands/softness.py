"""palpate softness."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

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
    from palpate.procedures.engine.unconverted import Procedure
    from palpate.procedures.lab.lab import Target
    from palpate.procedures.lab.session import Outcome, Session


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
    from palpate.procedures.commands.measure import chosen_by
    from palpate.procedures.engine.unconverted import conduct
    from palpate.procedures.measurements.softness import procedure
    from palpate.procedures.steps.checks import parse_loads

    target = chosen_by(choice).target
    settings = procedure.SoftnessSettings(
        _objects(target.design, samples, modulus, parse(thickness, "m"), real=choice.bench is not None),
        parse_loads(loads),
        parse(dwell, "s"),
        parse(frequency, "Hz"),
        model or procedure.default_model(target.design),
    )
    conduct(of_softness(), settings, choice, output)


def of_softness() -> Procedure[Any, Any]:
    from palpate.instrument.models.response import response
    from palpate.instrument.sensor.load import Load
    from palpate.procedures.commands.measure import tell_result
    from palpate.procedures.engine.unconverted import Procedure
    from palpate.procedures.measurements.softness import procedure
    from palpate.procedures.measurements.softness.report import plot_softness, print_softness
    from palpate.procedures.showing.marks import check_some_valid

    def tell(session: Session, result: procedure.SoftnessResult, outcome: Outcome, output: Output) -> None:
        plot = plot_softness(result, session.lab.bench.simulated, session.record.folder)
        points = [asdict(p) for p in result.points]
        found = {**outcome, "points": points, **result.summary(), "plot": str(plot)}
        tell_result(output, found, lambda: print_softness(result, outcome, plot), result.budgets)
        check_some_valid(result.points)

    def check(settings: procedure.SoftnessSettings, target: Target) -> None:
        procedure.check(settings, target.design, target.force_limit)
        if target.model is not None and target.model not in procedure.SLOW:
            for each in settings.objects:  # what the scene's model cannot answer for
                response(target.design, Load(1.0, each), target.model)

    return Procedure(
        procedure.PROCEDURE,
        procedure.SoftnessSettings,
        check,
        lambda session, settings, progress, _: procedure.run(
            session.lab.bench, session.lab.design, session.lab.calibration, settings, session.record, progress
        ),
        tell,
        loads=lambda settings: (settings.loads, False),
    )


def _objects(
    design: Design, samples: str | None, modulus: str | None, thickness: float, real: bool
) -> tuple[Sample, ...]:
    """What is to be mounted, in order.

    Raises:
        UsageError: both or neither are given, or a modulus for a real bench.
    """
    from palpate.instrument.errors import UsageError
    from palpate.instrument.quantity import parse, show
    from palpate.instrument.sensor.sample import Sample, get_sample, parse_samples

    if samples is not None and modulus is not None:
        raise UsageError("--samples and --modulus: name samples, or give moduli of unknown objects; not both")
    if samples is not None:
        return tuple(get_sample(name) for name in parse_samples(samples))
    if real and modulus is not None:
        raise UsageError("--modulus: on a real bench the object has its own; leave it out")
    if not real and modulus is None:
        raise UsageError("--samples or --modulus is missing: say what the simulated bench shall touch")
    # Of a real object the modulus is what is sought: the ring's stands where a number must.
    moduli = [design.ring.material.modulus] if modulus is None else [parse(text, "Pa") for text in modulus.split(",")]
    area, poisson = get_sample("1").area, get_sample("1").poisson
    return tuple(
        Sample(
            "unknown" if modulus is None else show(value, "Pa"), "unknown", value, thickness, area, poisson, "unknown"
        )
        for value in moduli
    )
