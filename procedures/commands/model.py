"""The commands palpate model ratio, modulus, plot, shear, validation and surfaces."""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.instrument.arithmetic import arithmetic, own_kernels
from palpate.instrument.errors import PalpateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.material import PLEXIGLAS_PHYSICAL, PLEXIGLAS_THESIS
from palpate.procedures.commands import texts
from palpate.procedures.commands.options import (
    FILE_NAME,
    Output,
    StrictCommand,
    StrictGroup,
    option,
    output_options,
    picture_option,
)
from palpate.procedures.console.terminal import say
from palpate.procedures.lab.store import store

if TYPE_CHECKING:
    from palpate.instrument.models.response import RatioQuestion


# --- The command palpate model shear -------------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate model shear\n\n  palpate model shear --design different_base --sample 2 --json",
)
@option("--design", default="common_base", help="single, common_base or different_base.")
@option("--sample", default="1", help="Rubber sample on the sensor.")
@output_options
def shear(design: str, sample: str, as_json: bool, quiet: bool) -> None:
    """Compute the effect of a shear force on each film, and the off-centre load with the same effect.

    The force acts along the line of the teeth, once on the top of the first tooth and once on the object's upper side.
    The solid model computes it, with the object bonded. The change is the difference from the next coarser mesh.
    """
    from palpate.instrument.models import shear as model
    from palpate.instrument.notice import price
    from palpate.instrument.sensor.designs import get_design
    from palpate.instrument.sensor.sample import get_sample

    sensor, sensed, output = get_design(design), get_sample(sample), Output(as_json, quiet)
    meshes: list[dict[str, model.FilmShear]] = []
    with output.prices(), output.progress("solving") as progress:
        for refinement in model.MESHES:
            if meshes:  # the coarse one refuses what has no answer, and takes a tenth of the time
                price(f"solving the finer mesh of {sensor.name}", model.SECONDS)
            meshes.append(model.shear(sensor, sensed, refinement))
            progress(len(meshes), len(model.MESHES), f"mesh {refinement}")
    coarse, films = meshes
    if output.as_json:
        found = [{"film": name, **film.summary(coarse[name])} for name, film in films.items()]
        output.json({"design": design, "sample": sample, "films": found, "told": model.shear_pattern(films)})
    elif output.for_people:
        from palpate.procedures.showing.shear import print_shear

        print_shear(f"{design}, sample {sample}", films, coarse)


# --- The command palpate model validation -----------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate model validation\n\n  palpate model validation --design single --json",
)
@option("--design", help="single, common_base or different_base (default: all).")
@option("--store", is_flag=True, help="Solve the stored finite elements anew, and store them.")
@output_options
def validation(design: str | None, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the difference of each sensor model from the thesis' experiments, sample by sample.

    It is the model minus the measured mean, in percent of the measured mean, so positive values mean that the model is
    higher. No mesh makes it smaller. A model that was built from the measured means is "input": they cannot judge it.
    """
    from palpate.instrument.durable import put_whole
    from palpate.instrument.errors import UnknownName, UsageError
    from palpate.instrument.models import validation as kept
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.records.run import storing
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
            with storing(kept.STORED):
                put_whole(kept.STORED, text(kept.measure(progress)))
            kept.stored.cache_clear()
    compared = kept.validate_all(designs if design is None else [design])
    if output.as_json:
        output.json({"sign": kept.SIGN, "models": [each.record() for each in compared]})
    elif output.for_people:
        print_validation(compared)


# --- The command palpate model surfaces ---------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate model surfaces\n\n  palpate model surfaces --design single --store",
)
@option("--design", help="single_round, single, common_base, different_base, array or array_16 (default: all).")
@option("--store", is_flag=True, help='Find the curves anew, and store them for model "surface".')
@output_options
def surfaces(design: str | None, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the curves from which model "surface" answers, with their bounds. Finding all takes four minutes."""
    from palpate.instrument.errors import UnknownName
    from palpate.instrument.models import surface
    from palpate.instrument.models.curve import ratio_curve
    from palpate.instrument.models.parameters import get_parameter_set
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
                "model": curves.model,
                "meshes": len(curves.meshes),
                "poles": len(curves.poles.rates),
                "discretisation": error,
                "build_s": curves.seconds,
            }
            for (name, parameters), (curves, error) in found.items()
        ]
        output.json({"surfaces": rows})
    elif output.for_people:
        from palpate.procedures.showing.models import print_surfaces

        print_surfaces(found)


# --- model ratio, modulus and plot, and the group ------------------------------------------------------

# Settings that replace values of the parameter set, with their units and help.
_SETTINGS = {
    "sensed_thickness": ("m", "Thickness of the object."),
    "sensed_poisson": ("", "Poisson ratio of the object."),
    "compliant_modulus": ("Pa", "Young modulus of the ring."),
    "compliant_poisson": ("", "Poisson ratio of the ring."),
    "plate_modulus": (
        "Pa",
        f"Young modulus of the plates (default: {show(PLEXIGLAS_THESIS.modulus, 'Pa')}, {PLEXIGLAS_THESIS.name};"
        f" {PLEXIGLAS_PHYSICAL.name}, has {show(PLEXIGLAS_PHYSICAL.modulus, 'Pa')}).",
    ),
}


@click.group(cls=StrictGroup)
def model() -> None:
    """Ask the sensor models, without a bench."""


model.add_command(shear)
model.add_command(validation)
model.add_command(surfaces)


def takes_long(design: str, model: str) -> bool:
    """Whether a model of a design is computed by the processor's own kernels."""
    from palpate.instrument.sensor.design import MANY_TEETH
    from palpate.instrument.sensor.designs import get_design

    return model == "solid" and len(get_design(design).teeth) > MANY_TEETH


def choose_kernels(context: click.Context, parameter: click.Parameter, value: str) -> str:
    """Choose the kernels once design and model are read: before other options, whose units may load numpy."""
    given = {**context.params, str(parameter.name): value}
    with suppress(PalpateError):  # what is no design is told by the command, unless --help is asked for
        if {"design", "name"} <= given.keys() and takes_long(given["design"], given["name"]):
            own_kernels()
    return value


def question_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options for sensor, model and parameters; the command gets them as one `question`."""

    @functools.wraps(command)
    def asked(
        design: str, name: str, parameters: str, interface: str | None, tolerance: float | None, **given: object
    ) -> None:
        from palpate.instrument.models.response import RatioQuestion

        values = {setting: given.pop(setting) for setting in _SETTINGS}
        settings: dict[str, float | str] = {name: value for name, value in values.items() if isinstance(value, float)}
        if interface is not None:
            settings["interface"] = interface
        command(question=RatioQuestion(design, name, parameters, settings, tolerance), **given)
        if takes_long(design, name) and not given["as_json"] and not given["quiet"]:
            say(f"kernels        {arithmetic()['blas']}")

    described = [
        option(f"--{name.replace('_', '-')}", callback=texts.quantity(unit, positive=bool(unit)), help=text)
        for name, (unit, text) in _SETTINGS.items()
    ]
    for each in reversed(
        (
            option(
                "--design",
                default="single",
                is_eager=True,
                callback=choose_kernels,
                help="single, single_round, common_base, different_base or array.",
            ),
            option(
                "--model",
                "name",
                default="auto",
                is_eager=True,
                callback=choose_kernels,
                shell_complete=texts.complete_model,
                help=f"{', '.join(texts.MODELS)}; or auto: the fastest that meets the tolerance.",
            ),
            *described,
            option(
                "--interface", help="bonded, frictionless, or capped (frictionless, with the ring's top kept level)."
            ),
            option(
                "--parameters",
                default="physical",
                help="Set of all values that are not given above: thesis, physical, identified or capped.",
            ),
            option(
                "--tolerance",
                callback=texts.share,
                help="Greatest error of the force ratio, relative to it (default: 2 % auto, 0.01 % axisymmetric, 5 %"
                " solid).",
            ),
        )
    ):
        asked = each(asked)
    return asked


@model.command(
    epilog="Examples:\n\n  palpate model ratio --sensed-modulus '14.9 kPa, 100 kPa' --compliant-modulus '33 kPa'"
    "\n\n  palpate model ratio --design single_round --model axisymmetric --sensed-modulus '100 kPa' --tolerance 1e-6"
    "\n\n  palpate model ratio --design common_base --model solid --parameters identified"
    " --sensed-modulus '720 kPa' --json"
    "\n\n  palpate model ratio --design common_base --sensed-modulus '100 kPa' --at '6 mm, 6 mm'"
)
@option(
    "--sensed-modulus",
    callback=texts.quantities("Pa", positive=True),
    required=True,
    help="Young modulus of the object, or a list with commas.",
)
@option(
    "--at",
    callback=texts.place,
    metavar="X,Y",
    help="Point of the force, from the object's corner (default: spread over all).",
)
@question_options
@output_options
def ratio(
    sensed_modulus: tuple[float, ...],
    at: tuple[float, float] | None,
    question: RatioQuestion,
    as_json: bool,
    quiet: bool,
) -> None:
    """Compute the force ratio (tooth force over total force) for objects with given moduli.

    Model auto takes the fastest model whose error in the price list (palpate accuracy numerics) meets the tolerance,
    and names it; it never takes the experiment, which solves nothing. All errors are relative to the force ratio. The
    error estimate of a model that you name is that of its discretisation; models in closed form have none. The model
    error is the error of what the model leaves out, by the price list; the experiment, and cases that the price list
    lacks, have none. Against experiments a model is off by the rms difference from those of the thesis over their
    samples, with the parameter set alone, without your settings: see palpate model validation.
    The solid model takes seconds for a sensor, whatever the moduli. It is the only one that accepts a force in one
    point.
    The identified and capped parameters are fitted to the thesis' tables: effective values, not physical ones.
    """
    from palpate.instrument.models.response import ask
    from palpate.instrument.models.validation import validate

    output = Output(as_json, quiet)
    if at is not None:
        question = replace(question, at=at)
    with output.prices():
        answers = ask(question, sensed_modulus)
    models = dict.fromkeys(answer.response.model for answer in answers)
    compared = [validate(question.design, question.parameters, name) for name in models]
    if output.as_json:
        sensor = question.sensor()
        output.json(
            {
                "design": question.design,
                "parameters": question.parameters,
                "at_m": question.at,
                "arithmetic": arithmetic(),
                "validation": [found.record() for found in compared],
                "points": [answer.summary(sensor) for answer in answers],
            }
        )
    elif output.for_people:
        from palpate.procedures.showing.models import print_ratios

        print_ratios(question.design, answers, compared, question.changed)


@model.command(
    epilog="Examples:\n\n  palpate model modulus --force-ratio '0.31, 0.99' --model column"
    "\n\n  palpate model modulus --force-ratio 0.183 --uncertainty 0.005 --design single --json"
)
@option(
    "--force-ratio", callback=texts.quantities("", "0.3"), required=True, help="Force ratio, or a list with commas."
)
@option(
    "--uncertainty",
    callback=texts.quantity("", "0.005"),
    help="Standard uncertainty of the ratios (default: the design's repeatability, about 4 %).",
)
@option(
    "--calibration",
    type=FILE_NAME,
    metavar="FILE",
    help="Calibration of the model by references, of the sensor that measured the ratios: palpate calibrate model.",
)
@question_options
@output_options
def modulus(
    force_ratio: tuple[float, ...],
    uncertainty: float | None,
    calibration: Path | None,
    question: RatioQuestion,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find the Young modulus of the sensed object from the force ratio, with two uncertainties.

    Near the ratio of a very hard or a very soft object, and outside the model's range, the answer is only a bound.
    The uncertainty on the scale of the model includes that of the ratio, the model's error estimate and, if the price
    list has it, the model error. The absolute uncertainty includes the validation error, too: how far the model lies
    from experiments. It is not known where nobody has measured the sensor. References of your own replace what the
    thesis tells (--calibration); the model's ratios are then corrected by their constant. Intervals cover 95 %.
    A finite-element model that has not met this sensor before is set up first; how long that takes is told if it takes
    long. Its answers for all moduli are then kept on disk.
    """
    from palpate.instrument.findings import object_modulus as model_modulus
    from palpate.instrument.models.validation import validate

    output, references = Output(as_json, quiet), None
    if calibration is not None:
        from datetime import UTC, datetime

        from palpate.procedures.lab.calibrations import by_references

        references = by_references(calibration, datetime.now(UTC).date())
    with output.prices():
        points = model_modulus.estimate(question, force_ratio, uncertainty, references=references)
    models = dict.fromkeys(point["model"] for point in points)
    compared = [validate(question.design, question.parameters, name) for name in models]
    line = model_modulus.validation_of(question, points[0]["model"], references)
    if output.as_json:
        output.json(
            {
                "design": question.design,
                "parameters": question.parameters,
                "simulated": references is not None and references.calibration.simulated,
                "arithmetic": arithmetic(),
                "validation": [found.record() for found in compared],
                "validation_line": line.summary(),
                "coverage": model_modulus.COVERAGE,
                "points": points,
            }
        )
    elif output.for_people:
        from palpate.procedures.showing.models import print_moduli

        simulated = references is not None and references.calibration.simulated
        print_moduli(question.design, points, compared, question.changed, line, simulated)
        if calibration is None:
            of = f"model-*-{question.design}-{points[0]['model']}-{question.parameters}-*.toml"
            for file in sorted((store() / "calibrations").glob(of)):
                output.line(f"stored         {file}: give it by --calibration if its sensor measured these ratios")


@model.command(
    epilog="Examples:\n\n  palpate model plot --sensed-modulus '24 kPa, 100 kPa, 1 MPa' --out sensor.png"
    "\n\n  palpate model plot --design common_base --model solid --sensed-modulus '100 kPa'"
)
@option(
    "--sensed-modulus",
    callback=texts.quantities("Pa", positive=True),
    required=True,
    help="Young modulus of the object, or a list with commas.",
)
@picture_option("in runs/plots/")
@question_options
@output_options
def plot(
    sensed_modulus: tuple[float, ...], out: Path | None, question: RatioQuestion, as_json: bool, quiet: bool
) -> None:
    """Draw the deformed sensor, the pressure on its face, and the force ratio over the modulus of the object.

    The section is drawn for the first modulus and 1 N. Only the axisymmetric and the solid model compute a section; for
    other models only the force ratio is drawn.
    """
    from palpate.procedures.showing import model_picture
    from palpate.procedures.showing.figure import picture_file

    output = Output(as_json, quiet)
    file = picture_file(f"{question.design}-{question.model}", out, store())
    with output.prices():
        picture = model_picture.solve(question, sensed_modulus)
    model_picture.draw(picture, file)
    if output.as_json:
        output.json({"file": str(file), "arithmetic": arithmetic(), **picture.data()})
    output.line(str(file))
