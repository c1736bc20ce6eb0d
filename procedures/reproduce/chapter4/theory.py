"""Table 5.8: the theories that its percent errors imply, rebuilt from the experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models import beam
from palpate.instrument.models.response import response
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import TableCell, ThesisTable, program_lines, read_table
from palpate.procedures.reproduce.curves import RING, CurveCase, Curves
from palpate.procedures.reproduce.judging.rows import ComparedColumn, Comparison, ModelSeries, fit_sentence

Array = NDArray[np.float64]

GOAL = 0.012  # as for Table A2.1
BEAMS = ("beam", "beam_printed")
# Each column has: design, models, table with the theory itself, whether the error is percent of the experiment.
COLUMNS: dict[str, tuple[str, tuple[str, ...], str | None, bool]] = {
    "single_vs_3D": ("single", ("axisymmetric", "solid"), "A2.1", False),
    "single_vs_2D": ("single", BEAMS, None, False),
    "common_base_vs_3D": ("common_base", ("solid",), "A2.3", True),
    "different_base_vs_3D": ("different_base", ("solid",), "A2.5", True),
}
OF_THEORY, OF_EXPERIMENT = "error_of_theory", "error_of_experiment"


def rebuilt(experiment: Array, percent: Array, of_experiment: bool) -> Array:
    """The theory's force ratio from the experiment's and the error in percent of the experiment or the theory."""
    return experiment * (1 - percent / 100) if of_experiment else experiment / (1 + percent / 100)


def implied(column: str) -> dict[str, Array]:
    """The theory rebuilt by each definition of the error, for each sample in the table's order."""
    table = read_table("5.8")
    samples = _samples(table)
    measured = get_design(COLUMNS[column][0]).thesis_force_ratio
    experiment = np.array([measured[sample] for sample in samples])
    percent = table.values(f"{column}_error_percent")[: len(samples)]
    return {OF_THEORY: rebuilt(experiment, percent, False), OF_EXPERIMENT: rebuilt(experiment, percent, True)}


def sample_moduli() -> Array:
    """Moduli of the samples in the table's order [Pa]."""
    return np.array([get_sample(sample).modulus for sample in _samples(read_table("5.8"))])


def beam_ratios(moduli: Array, ring: float = RING, model: str = "beam") -> Array:
    """Force ratios of the single sensor by a two-dimensional theory, at moduli of the object [Pa], with a ring [Pa]."""
    case = CurveCase("single", model, "physical", ring)
    sensor, load = case.sensor(), case.parameter_set.load
    return np.array([response(sensor, load(float(modulus)), model).force_ratio for modulus in moduli])


def compare(parameters: Sequence[str], curves: Curves) -> Comparison:
    """The table's four theories by both definitions of the error, beside the models at the samples' moduli."""
    table = read_table("5.8")
    samples, moduli = _samples(table), sample_moduli()
    columns, said = [], []
    for name, (design, theories_of_ours, source, of_experiment) in COLUMNS.items():
        errors = table.columns[f"{name}_error_percent"]
        ours = tuple(
            ModelSeries(each, model, ratios(curves, design, model, each, moduli))
            for model in theories_of_ours
            for each in parameters
            if model not in BEAMS or each == "physical"
        )
        theories, taken = implied(name), OF_EXPERIMENT if of_experiment else OF_THEORY
        for definition, values in theories.items():
            cells = tuple(TableCell(e.printed, float(v), e.reason) for e, v in zip(errors, values, strict=False))
            # A theory with a table of its own has its goal there.
            goal = GOAL if source is None and definition == taken else None
            columns.append(
                ComparedColumn(f"{name}_{definition}", cells, ours, goal, () if source is None else (source,))
            )
        said.append(_definition(name, theories, taken, source, moduli))
    shown = {column.quantity: column.cells for column in columns}
    samples_only = ThesisTable(
        table.number, table.title, table.key, samples, MappingProxyType(shown),
        "the theory is rebuilt from the printed error and the experiment: the averages printed below Tables A2.9 to"
        " A2.20, and Table 5.7 for different bases; `printed` is the error in percent; " + table.doubt,
    )  # fmt: skip
    comparison = Comparison(samples_only, tuple(columns), ())
    for name, (*_, of_experiment) in COLUMNS.items():
        quantity = f"{name}_{OF_EXPERIMENT if of_experiment else OF_THEORY}"
        if any(column.ours for column in columns if column.quantity == quantity):
            said.append(fit_sentence(comparison, quantity))
    if "physical" in parameters:
        said.append("single_vs_2D: the beam's thickness and length were chosen to meet this column: a fit")
        said.append(program_sentence(moduli))
    else:
        said.append("single_vs_2D: the beam has no identified set, so that nothing of ours stands beside it")
    return Comparison(samples_only, tuple(columns), tuple(said))


def program_sentence(moduli: Array) -> str:
    """Sentence on the ratios of the printed program of Appendix A2.1, at moduli of the object [Pa]."""
    single, hardest = get_design("single"), float(moduli.max())
    printed = [beam.printed_force_ratio(single, replace(get_sample("1"), modulus=float(m))) for m in moduli]
    frozen, renewed = (beam.printed_ratios(single, beam.SERIES, each) for each in (True, False))
    kinds = [each.kind for each in program_lines()]
    return (
        f"Appendix A2.1's program as printed has {min(printed):.2f} to {max(printed):.2f} at these moduli, up to"
        f" {hardest / 1e3:.0f} kPa: its line K = subs(K) keeps the stiffness of the loop's first modulus. Over its own"
        f" series that gives {frozen[0]:.2f} to {frozen[-1]:.2f}, rising; renewed, K would give {min(renewed):.1f} to"
        f" {max(renewed):.1f}. {kinds.count('scan')} of its lines are repaired where the scan is damaged, and"
        f" {kinds.count('slip')} slips are its own (instrument/thesis/program_A2_1.csv)"
    )


def _samples(table: ThesisTable) -> tuple[str, ...]:
    return tuple(row for row in table.rows if row != "average")


def ratios(curves: Curves, design: str, model: str, parameters: str, moduli: Array) -> Array:
    if model in BEAMS:
        return beam_ratios(moduli, model=model)
    return curves.of(CurveCase(design, model, parameters)).force_ratio(moduli)


def _definition(name: str, theories: dict[str, Array], taken: str, source: str | None, moduli: Array) -> str:
    """Sentence that tells which definition of the error fits, and to which theory."""
    other = OF_THEORY if taken == OF_EXPERIMENT else OF_EXPERIMENT
    words = {OF_THEORY: "percent of the theory", OF_EXPERIMENT: "percent of the experiment"}
    references = {"the corrected beam": beam_ratios(moduli)}
    if source is not None:
        references = {f"Table {source}": table_ratio(source, moduli)}
        if source == "A2.1":
            references["Table A2.1 as printed, its force column shifted,"] = table_ratio(source, moduli, printed=True)
    fits = "; ".join(
        f"{reference} is met to {_rms(theories[taken] - values):.4f} rms, and to {_rms(theories[other] - values):.4f}"
        f" as {words[other]}"
        for reference, values in references.items()
    )
    return f"{name}: taken as {words[taken]}: {fits}"


def table_ratio(number: str, moduli: Array, printed: bool = False) -> Array:
    """A table's force ratio between its moduli, linear in their logarithm."""
    table = read_table(number)
    column = "force_ratio" if "force_ratio" in table.columns else "force_rigid_N"
    ratio = np.array([float(cell.printed) if printed else cell.value for cell in table.columns[column]])
    between: Array = np.interp(np.log(moduli), np.log(table.keys()), abs(ratio))
    return between


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
