"""Shows and plots the calibration of a sensor model by references."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.model_calibration import REACH
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.quantity import counted, show
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.references.result import ReferencesResult
from palpate.procedures.showing import moduli
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, save
from palpate.procedures.showing.text import new_table, number, stamped


def show_references(result: ReferencesResult, films: FilmCalibration | None, outcome: Outcome) -> list[object]:
    """The references beside the model, the constant and its spread, and what another reference would buy."""
    c = result.calibration
    table = new_table(
        stamped(c.simulated, f"Calibration of model {c.model!r} ({c.parameters} set, {c.design})"),
        "reference", "modulus", "u %", "force\nratio", "u %", "by the\nmodel", "model over\nmeasured", "u %", "source",
    )  # fmt: skip
    for each in c.references:
        table.add_row(
            each.name, show(each.modulus_Pa, "Pa", 4), f"{100 * each.modulus_u:.2g}", number(each.force_ratio),
            f"{100 * math.hypot(each.force_ratio_u, each.films_u, each.pickup_u):.2g}", number(each.model_force_ratio),
            f"{math.exp(each.ln_error):z.4f}", f"{100 * each.ln_error_u:.2g}", each.source,
        )  # fmt: skip
    spread = "not known" if c.spread is None else f"{100 * c.spread:.2g} % of the ratio"
    freedom = "" if c.spread_degrees_of_freedom is None else f" ({moduli.degrees(c.spread_degrees_of_freedom)})"
    return [
        table,
        f"constant       {math.exp(c.constant):z.4f}, by which the model's ratios are divided",
        f"spread         {spread}{freedom}: {c.prior}",
        moduli.absolute_line(result.line),
        f"films          {_films_text(films)}",
        *_modulus_lines(result),
        f"stored in      {outcome['model_calibration_file']}, until {c.expires}",
    ]


def _films_text(films: FilmCalibration | None) -> str:
    if films is None:
        return "not calibrated; what their sensitivities are off by is the same for references and objects, and cancels"
    return f"calibration {films.source}; its error cancels for objects that are measured with it"


def _modulus_lines(result: ReferencesResult) -> list[str]:
    """What the calibration is worth for a modulus, and what another reference would change."""
    if not result.worth:
        return ["another        a second reference tells the spread; until then the absolute uncertainty is not known"]

    def told(u: float, half: float) -> str:
        return f"u {100 * u:.3g} %, 95 % within a factor of {math.exp(half):.3g}"

    now, another, any_number = result.worth
    count = counted(now.references or 0, "reference")
    return [
        f"modulus        by {count} {told(now.modulus_u, now.half_width)}",
        f"another        {told(another.modulus_u, another.half_width)}; any number: {100 * any_number.modulus_u:.3g} %",
    ]


def plot_references(result: ReferencesResult, curve: RatioCurve, folder: Path) -> Path:
    """Plot ratios over moduli with the model's curve, own and corrected, and the errors; returns the PNG file."""
    c = result.calibration
    figure, (left, right) = new_figure(c.simulated, 2, f"calibration of model {c.model}, design {c.design}")
    given = np.array([each.modulus_Pa for each in c.references])
    ratios = np.array([each.force_ratio for each in c.references])
    least, most = curve.moduli
    moduli_Pa = np.geomspace(max(given.min() / REACH, least), min(given.max() * REACH, most), 200)
    own = curve.force_ratio(np.clip(moduli_Pa, least, most))
    left.plot(1e-3 * moduli_Pa, own, "--", color="0.5", lw=1, label="model")
    corrected = own * math.exp(-c.constant)
    left.plot(1e-3 * moduli_Pa, corrected, "k-", lw=1, label="corrected")
    if result.line.u is not None:
        reach = math.exp(result.line.u)
        left.fill_between(1e-3 * moduli_Pa, corrected / reach, corrected * reach, color="0.85", label="one object, u")
    u = [math.hypot(each.force_ratio_u, each.films_u, each.pickup_u) * each.force_ratio for each in c.references]
    left.errorbar(
        1e-3 * given, ratios, u, 1e-3 * given * [each.modulus_u for each in c.references], "o", capsize=2,
        label="references, u",
    )  # fmt: skip
    left.set(xlabel="modulus (kPa)", ylabel="force ratio")
    logarithmic(left, 1e-3 * moduli_Pa[0], 1e-3 * moduli_Pa[-1])
    name_all(left, 2)
    places, errors = range(len(c.references)), [100 * each.ln_error for each in c.references]
    right.errorbar(places, errors, [100 * each.ln_error_u for each in c.references], fmt="o", capsize=2)
    right.axhline(100 * c.constant, color="k", lw=1)
    if c.spread is not None:
        right.axhspan(100 * (c.constant - c.spread), 100 * (c.constant + c.spread), color="0.85")
    right.set(xticks=places, xticklabels=[each.name for each in c.references])
    right.set(xlabel="reference (line: constant, band: spread)", ylabel="ln of model over measured (%; bars: u)")
    return save(figure, folder)
