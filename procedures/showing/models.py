"""Prints the answers of the sensor models, with their errors and computing times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from palpate.instrument.quantity import show
from palpate.procedures.showing import moduli
from palpate.procedures.showing.tables import cell_of
from palpate.procedures.showing.text import NO_VALUE, legend, new_table, number, print_all, short, stamped
from palpate.procedures.showing.validation import brief, lines

if TYPE_CHECKING:
    from palpate.instrument.models.price_list import PriceList
    from palpate.instrument.models.ratio import RatioAnswer
    from palpate.instrument.models.stored.surface import Surface
    from palpate.instrument.models.validation import Validation, ValidationLine


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
