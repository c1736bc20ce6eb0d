"""Prints the answers of the sensor models, with their errors and computing times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from palpate.instrument.quantity import plus_minus, show
from palpate.procedures.showing import moduli
from palpate.procedures.showing.tables import NOTHING, cell_of
from palpate.procedures.showing.text import NO_VALUE, legend, new_table, number, print_all, stamped
from palpate.procedures.showing.validation import brief, lines

if TYPE_CHECKING:
    from palpate.instrument.models.response import RatioAnswer
    from palpate.instrument.models.surface import Surface
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
        "sensed modulus", "force ratio", "error estimate", "model error", "against\nexperiments", "seconds",
    )  # fmt: skip
    by_model = {found.model: brief(found) for found in compared}
    for a in answers:
        given = a.response
        errors = [*map(bound, (given.error_estimate, a.model_error)), by_model[given.model]]
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
            f"{p['force_ratio']:g}", f"{p['force_ratio_u']:.2g}", bound(p["model_error"], p["force_ratio"]),
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


def bound(error: float | None, value: float = 1.0) -> str:
    """A bound on the error of a value, relative to it, for a cell."""
    return NOTHING if error is None else plus_minus(error / value)


def print_surfaces(surfaces: Mapping[tuple[str, str], tuple[Surface, float]]) -> None:
    """Print a row for each sensor with shipped curves: these, and the bound on the errors of their ratios."""
    table = new_table(None, "design", "set", "of model", "meshes", "poles", "error of the model", "built in\ns")
    for (name, parameters), (s, error) in surfaces.items():
        table.add_row(
            name, parameters, s.model, str(len(s.meshes)), str(len(s.poles.rates)), f"{error:z.1e}", f"{s.seconds:z.1f}"
        )
    print_all(table)
