"""palpate model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from procedures.cli.options import Output, output_options

if TYPE_CHECKING:
    from instrument.design import Design
    from instrument.models.ratio import Answer


@click.group()
def model() -> None:
    """Ask the sensor models, without a bench."""


@model.command(
    epilog="Examples:\n\n  palpate model ratio --sensed-modulus '14.9 kPa, 100 kPa' --compliant-modulus '33 kPa'"
    "\n\n  palpate model ratio --design single_round --model axisymmetric --sensed-modulus '100 kPa' --tolerance 1e-6"
    "\n\n  palpate model ratio --design common_base --model solid --parameters identified"
    " --sensed-modulus '720 kPa' --json"
)
@click.option(
    "--design", default="single", show_default=True, help="single, single_round, common_base, different_base or array."
)
@click.option(
    "--model",
    "name",
    default="axisymmetric",
    show_default=True,
    help="column, beam, beam_printed, experiment, axisymmetric, solid, or auto.",
)
@click.option("--sensed-modulus", required=True, help="Young modulus of the object, or a list with commas.")
@click.option("--sensed-thickness", help="Thickness of the object.")
@click.option("--sensed-poisson", help="Poisson ratio of the object.")
@click.option("--compliant-modulus", help="Young modulus of the ring.")
@click.option("--compliant-poisson", help="Poisson ratio of the ring.")
@click.option("--plate-modulus", help="Young modulus of the plates.")
@click.option("--interface", help="bonded or frictionless.")
@click.option(
    "--parameters",
    default="physical",
    show_default=True,
    help="What is not given above: thesis, physical or identified.",
)
@click.option("--tolerance", help="Greatest error estimate (default: 1e-4 axisymmetric, 5e-3 solid).")
@output_options
def ratio(
    design: str,
    name: str,
    sensed_modulus: str,
    sensed_thickness: str | None,
    sensed_poisson: str | None,
    compliant_modulus: str | None,
    compliant_poisson: str | None,
    plate_modulus: str | None,
    interface: str | None,
    parameters: str,
    tolerance: str | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Force ratio, tooth force over total force, for objects of given moduli.

    The error estimate is that of the discretisation, not of what a model leaves out. Models in closed form have none.
    The solid model takes a minute and more a point; the extra "fast" (pypardiso) shortens it.
    The identified parameters are fitted to the thesis' tables: effective values, not physical ones.
    """
    from instrument.models.ratio import Question, ask
    from instrument.quantity import parse

    output = Output(as_json, quiet)
    quantities = {
        "sensed_thickness": (sensed_thickness, "m"),
        "sensed_poisson": (sensed_poisson, ""),
        "compliant_modulus": (compliant_modulus, "Pa"),
        "compliant_poisson": (compliant_poisson, ""),
        "plate_modulus": (plate_modulus, "Pa"),
    }
    settings: dict[str, float | str] = {
        setting: parse(text, unit) for setting, (text, unit) in quantities.items() if text is not None
    }
    if interface is not None:
        settings["interface"] = interface
    question = Question(design, name, parameters, settings, None if tolerance is None else parse(tolerance, ""))
    answers = ask(question, [parse(text, "Pa") for text in sensed_modulus.split(",")])
    if output.as_json:
        sensor = question.sensor()
        output.json({"design": design, "parameters": parameters, "points": [_point(sensor, a) for a in answers]})
    elif output.for_people:
        from procedures import report

        report.print_ratios(design, answers)


def _point(design: Design, answer: Answer) -> dict[str, Any]:
    from instrument.models.film import signals

    given = answer.response
    return {
        "sensed_modulus_Pa": answer.sensed_modulus,
        "force_ratio": given.force_ratio,
        "error_estimate": given.error_estimate,
        "model": given.model,
        "why": given.why,
        "seconds": answer.seconds,
        "films": {
            name: {"force_N": film.force, "charge_C": film.charge, "voltage_V": film.voltage}
            for name, film in signals(design, given).items()
        },
    }
