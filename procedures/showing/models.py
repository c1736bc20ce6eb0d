"""Prints the answers of the sensor models, with their errors and computing times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from palpate.instrument.models.shear import ALIKE, DRAGGED, FilmShear, shear_pattern
from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.showing import moduli
from palpate.procedures.showing.tables import cell_of
from palpate.procedures.showing.text import NO_VALUE, legend, new_table, number, print_all, short, stamped

if TYPE_CHECKING:
    from palpate.instrument.models.price_list import PriceList
    from palpate.instrument.models.ratio import RatioAnswer
    from palpate.instrument.models.stored.surface import Surface
    from palpate.instrument.models.validation import ValidationLine


# --- Prints the effect of shear on the films -----------------------------------------------------------

TOLD = {
    "not": "No film responds to shear along the line of the teeth.",
    "off centre": "All films that respond to shear give the same place of a load: shear looks like a load off centre.",
    "apart": f"The films give places of a load that differ by more than {100 * ALIKE:g} %: together they can tell shear"
    " from a load off centre.",
}


def print_shear(what: str, films: Mapping[str, FilmShear], coarse: Mapping[str, FilmShear]) -> None:
    """Print a row for each film: its force for 1 N of shear, and the place of a normal load that adds as much.

    Args:
        what: title of the table.
        films: the forces on the films, by film name.
        coarse: the same forces on the next coarser mesh.
    """
    table = new_table(
        stamped(False, f"{what}: forces on films for 1 N, and the place of a load that adds as much"),
        "film", "pressed\nN", *(text for place in DRAGGED for text in (f"shear on\n{place}, N", "off centre\nmm N/N")),
        "change\nN",
    )  # fmt: skip
    table.columns[0].justify = "left"
    for name, film in films.items():
        cells = []
        for place in DRAGGED:
            off = film.off_centre(place)
            cells += [f"{film.cleaned(place):+z.5f}", "-" if off is None else f"{1e3 * off:+z.3f}"]
        table.add_row(name, f"{film.pressed:z.4f}", *cells, f"{film.change(coarse[name]):z.5f}")
    print_all(table, *legend(table, marks=NO_VALUE), TOLD[shear_pattern(films)])


# --- How far sensor models are from the experiments of the thesis --------------------------------------


def brief(found: Validation) -> str:
    """Text of a table's cell: the rms distance, or one word that says why there is none."""
    return found.kind if found.rms is None else f"{found.rms:z.0f} %"


def lines(found: Iterable[Validation], changed: Sequence[str] = ()) -> list[str]:
    """A sentence for each model on its distance from the experiments.

    Args:
        found: comparisons.
        changed: settings that differ from the parameter set's; only the set itself was compared.
    """
    told = []
    for each in found:
        said = f"validation of {each.model} ({each.parameters} set, {each.design}): "
        if each.mean is None or each.rms is None or each.worst is None:
            told.append(f"{said}{each.kind}: {each.why}")
            continue
        by_sample = ", ".join(f"{name}: {value:+z.0f}" for name, value in each.percent.items())
        told.append(
            f"{said}mean {each.mean:+z.1f} %, rms {each.rms:z.1f} %, worst {each.worst:+z.1f} % at sample"
            f" {each.worst_sample} ({SIGN}; by sample {by_sample})"
        )
    if changed:
        options = [f"--{name.replace('_', '-')}" for name in changed]
        told.append(f"the validation is that of the set as it stands, without {', '.join(options)}")
    return told


def print_validation(compared: Sequence[Validation]) -> None:
    """Print one table for each design, with one line for each model and parameter set."""
    for design in dict.fromkeys(each.design for each in compared):
        table = new_table(
            stamped(False, f"{design}: {SIGN}"), "model", "set", *(f"sample {name}" for name in SAMPLES), "mean",
            "rms", "worst",
        )  # fmt: skip
        table.columns[0].justify = table.columns[1].justify = "left"
        reasons = []
        for each in (found for found in compared if found.design == design):
            if each.kind == "compared":
                cells = [f"{each.percent[name]:+z.1f}" if name in each.percent else "-" for name in SAMPLES]
                table.add_row(
                    each.model, each.parameters, *cells, f"{each.mean:+z.1f}", f"{each.rms:z.1f}", f"{each.worst:+z.1f}"
                )
            else:
                table.add_row(each.model, each.parameters, *["-"] * len(SAMPLES), each.kind, "", "")
                reasons.append(f"{each.model}, {each.parameters}: {each.kind}: {each.why}")
        print_all(table, *reasons, "")


# -------------------------------------------------------------------------------------------------------


def print_ratios(
    design: str, answers: list[RatioAnswer], compared: Sequence[Validation], changed: Sequence[str] = ()
) -> None:
    """Print a row for each modulus.

    Args:
        design: name of the design.
        answers: the models' answers.
        compared: how far each of these models lies from the thesis' experiments.
        changed: options with which the models were asked, and which the comparison leaves out.
    """
    models = ", ".join(dict.fromkeys(a.response.model for a in answers))
    table = new_table(
        stamped(False, f"{design}, model {models}"),
        "sensed modulus", "force ratio", "error estimate", "model error", "validation", "seconds",
    )  # fmt: skip
    by_model = {found.model: brief(found) for found in compared}
    for a in answers:
        given = a.response
        errors = [*(short(error) for error in (given.error_estimate, a.model_error)), by_model[given.model]]
        table.add_row(show(a.sensed_modulus, "Pa", 6), f"{given.force_ratio:.7g}", *errors, f"{a.seconds:.2g}")
    why = dict.fromkeys(a.response.why for a in answers if a.response.why)
    print_all(table, *legend(table, marks=NO_VALUE), *why, *lines(compared, changed))


def print_moduli(
    design: str,
    points: list[dict[str, Any]],
    compared: Sequence[Validation],
    changed: Sequence[str],
    line: ValidationLine,
    simulated: bool = False,
) -> None:
    """Print a row for each force ratio with the modulus of the object, on the model's scale and absolute.

    Args:
        design: name of the design.
        points: the found moduli, as in JSON.
        compared: how far each of their models lies from the thesis' experiments.
        changed: options with which the models were asked, and which the comparison leaves out.
        line: validation error of the model.
        simulated: whether that comes from references on a simulated bench.
    """
    models = ", ".join(dict.fromkeys(p["model"] for p in points))
    table = new_table(
        stamped(simulated, f"{design}, model {models}: Young modulus"),
        "force ratio", "u", "model error", *(column.head for column in moduli.COLUMNS.values()), "dlnE/dlnR", "",
    )  # fmt: skip
    for p in points:
        row = SimpleNamespace(**p)
        table.add_row(
            f"{p['force_ratio']:g}", f"{p['force_ratio_u']:.2g}", short(p["model_error"]),
            *(cell_of(name, column, row) for name, column in moduli.COLUMNS.items()),
            number(p["sensitivity"]), p["note"],
        )  # fmt: skip
    print_all(
        table,
        *legend(table, marks=NO_VALUE),
        moduli.absolute_line(line),
        *moduli.bound_line(p["modulus_Pa"] is not None for p in points),
        *lines(compared, changed),
    )


def print_prices(prices: PriceList, designs: list[str], compared: Sequence[Validation], plot: Path | None) -> None:
    """Print a table for each design: error and time of every model at every refinement, and its validation."""
    validation = {(found.design, found.model): brief(found) for found in compared}
    low, high = (show(modulus, "Pa", 3) for modulus in prices.moduli_Pa[1:3])
    lowest, highest = (show(modulus, "Pa", 3) for modulus in (prices.moduli_Pa[0], prices.moduli_Pa[-1]))
    for design in designs:
        table = new_table(
            stamped(False, f"{design}: greatest error of the force ratio, and time of one answer in seconds"),
            "model", "refinement", f"{low} to\n{high}", f"{lowest} to\n{highest}", "validation", "build", "solve",
            "evaluate", "answer",
        )  # fmt: skip
        table.columns[1].justify = "left"
        failures = []
        for p in (price for price in prices.prices if price.design == design):
            everywhere = None if None in p.errors else max(error for error in p.errors if error is not None)
            times = [short(value) for value in (p.build_s, p.solve_s, p.evaluate_s, p.answer_s)]
            told = validation[design, p.model]
            table.add_row(p.model, p.refinement, short(p.errors[1]), short(everywhere), told, *times)
            if p.failure:
                failures.append(f"{p.model}, {p.refinement}: {p.failure}")
        how = [f"reference: {r.how}" for r in prices.references if r.design == design]
        print_all(table, *legend(table, marks=NO_VALUE), *how, *failures, "")
    print_all(
        "validation: rms difference from the thesis' experiments (palpate accuracy validation); input: the model was"
        " fitted to them; none: there are none to compare with",
        f"measured on {prices.machine.described}, {prices.machine.date}",
    )
    if plot is not None:
        print_all(f"plot           {plot}")


def print_surfaces(surfaces: Mapping[tuple[str, str], tuple[Surface, float]]) -> None:
    """Print a row for each sensor with shipped curves: these, and the bound on the errors of their ratios."""
    table = new_table(None, "design", "set", "of model", "meshes", "poles", "error of the model", "built in\ns")
    for (name, parameters), (s, error) in surfaces.items():
        table.add_row(
            name, parameters, s.model, str(len(s.meshes)), str(len(s.poles.rates)), f"{error:z.1e}", f"{s.seconds:z.1f}"
        )
    print_all(table)
