"""Chapter 4 of the thesis and its Appendix II beside our models, and the theories that Table 5.8 implies."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models import beam
from palpate.instrument.models.evidence import OTHER_RING, REPEATS, Evidence
from palpate.instrument.models.parameters import SolidParameters, get_parameter_set, solid_parameters
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import TableCell, ThesisTable, program_lines, read_table
from palpate.procedures.reproduce.criterion import odds_sentence
from palpate.procedures.reproduce.curves import (
    BASE,
    COARSE_MESH,
    RING,
    TOOTH,
    CurveCase,
    Curves,
    film_voltages,
    ring_of,
)
from palpate.procedures.reproduce.rows import ComparedColumn, Comparison, ModelSeries, column_of, fit_sentence

Array = NDArray[np.float64]

G33 = 0.15  # V m/N, Table 3.2, as a magnitude


def voltage_sentence(
    table: ThesisTable, column: str, force: Array, sensor: Design, film: str, ours: dict[str, Array]
) -> str:
    """Sentence that compares voltage over force of the thesis, of g33 t / A, and of our models.

    Args:
        table: table of the thesis.
        column: name of its column of voltages [V].
        force: the thesis' force on the film in each row [N].
        sensor: the design.
        film: "tooth" or "base".
        ours: voltage over force in each row [V/N], by the name of the model.
    """
    thesis = np.abs(table.values(column)) / force
    kind = "rigid" if film == TOOTH else "total"
    area = sensor.film_area(next(f for f in sensor.films if f.kind == kind))
    expected = G33 * sensor.film_sheet.thickness / area
    models = ", ".join(f"{_range(values)} V/N by the {name}" for name, values in ours.items())
    return (
        f"{column}: {_range(1e3 * thesis)} mV/N at every modulus, linear in the force. Open-circuit g33 t / A is"
        f" {expected:.3g} V/N, {expected / np.median(thesis):.0f} times more: the thesis does not say why, and"
        f" the voltages' scale is not comparable. The coupled film model gives {models}"
    )


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{high:.3g}" if high - low < 1e-3 * high else f"{low:.4g} to {high:.4g}"


# --- Predictions for one ring by a parameter set that was fitted to the other ring, and how far off they are


NEWTONS_PER_VOLT = 1000.0  # force over voltage of the tooth's film in Tables A2.1 and A2.2, within 0.2 %


def prediction_sentences(comparison: Comparison, quantity: str, film: str | None = None) -> Iterator[str]:
    """Sentences on each fitted set and model for which the table is a prediction; none where it is not.

    Args:
        comparison: the table.
        quantity: column of the force ratio, or of the tooth's force under 1 N.
        film: column of the tooth film's voltages, which also tell the force; None: there is none.
    """
    table, moduli = comparison.table, comparison.table.keys()
    columns = {column.quantity: column for column in comparison.columns}
    column, ring = columns[quantity], ring_of(table)
    if ring == RING:
        return
    for series in column.ours:
        chosen = get_parameter_set(series.parameters, series.model)
        if chosen.fitted_to and column.evidence(series, table) is Evidence.PREDICTED:
            head = (
                f"{series.parameters} set by {series.model}: fitted on the ring of {RING / 1e3:g} kPa and predicted"
                f" here, off by {_softer_and_harder(column.difference(series), moduli, ring)}"
            )
            yield head + (_by_film(columns[film], series.values, moduli, ring) if film is not None else "")
    yield _scaled(column, REPEATS.get(table.number, table.number), moduli, ring)


def _softer_and_harder(difference: Array, moduli: Array, ring: float) -> str:
    """Text of the greatest difference for objects softer than the ring, and for the others."""
    parts = []
    for which, here in (("softer than the ring", moduli < ring), ("harder", moduli >= ring)):
        worst = int(np.argmax(np.where(here, np.abs(difference), -1.0)))
        parts.append(f"at most {abs(difference[worst]):.4f} where the object is {which} (at {moduli[worst]:g} Pa)")
    return ", ".join(parts)


def _by_film(column: ComparedColumn, ratio: Array, moduli: Array, ring: float) -> str:
    """Text of the same against printed voltages, with each repaired one that is farther off than all others."""
    difference = ratio - NEWTONS_PER_VOLT * np.array([abs(float(cell.printed)) for cell in column.cells])
    sound = np.array([not cell.reason for cell in column.cells])
    most = np.abs(difference[sound & (moduli >= ring)]).max()
    doubtful = [
        f"{off:+.4f} at {modulus:g} Pa"
        for off, modulus in zip(difference[~sound], moduli[~sound], strict=True)
        if abs(off) > most
    ]
    return (
        f"; by the printed voltages of its film at {NEWTONS_PER_VOLT:g} N/V"
        f" {_softer_and_harder(difference[sound], moduli[sound], ring)}"
        + (f"; beside cells that are doubtful: {', '.join(doubtful)}" if doubtful else "")
    )


def _scaled(column: ComparedColumn, number: str, moduli: Array, ring: float) -> str:
    """Text that tells how well the thesis' own table of the other ring predicts this one."""
    other = read_table(OTHER_RING[number])
    name = "force_ratio" if "force_ratio" in other.columns else "force_rigid_N"
    ratio, softer = abs(other.values(name)), moduli * RING / ring
    inside = softer >= other.keys()[0]
    odds = np.interp(softer[inside], other.keys(), ratio / (1 - ratio))  # the odds are a straight line in the modulus
    off = float(np.abs(odds / (1 + odds) - column.thesis[inside]).max())
    return (
        f"Table {other.number} at the same ratio of moduli has this column within {off:.4f}: both rings lie on one"
        " curve, so on a rigid support a set that meets one meets the other, and is tested anew only for objects below"
        f" {moduli[inside][0] / 1e3:g} kPa"
    )


# --- Tables 4.1, 4.2, A2.1 and A2.2: one sensor under objects of rising modulus, on both rings ---------

SINGLE_MODELS = ("axisymmetric", "solid")
SINGLE_GOAL = 0.012  # for the set that was identified from A2.1 and A2.3 together


def single_cases(parameters: Sequence[str], ring: float) -> dict[tuple[str, str], CurveCase]:
    """Cases that the tables for a ring [Pa] need, by parameter set and model."""
    return {(name, model): CurveCase("single", model, name, ring) for name in parameters for model in SINGLE_MODELS}


def compare_single(number: str, parameters: Sequence[str], curves: Curves) -> Comparison:
    """One of the four tables. Under 1 N the tooth's force equals the force ratio."""
    table = read_table(number)
    moduli = table.keys()
    by = {key: curves.of(case) for key, case in single_cases(parameters, ring_of(table)).items()}
    ratio = {key: curve.force_ratio(moduli) for key, curve in by.items()}
    tooth = {key: curve.voltage(TOOTH, moduli) for key, curve in by.items()}
    base = {key: curve.voltage(BASE, moduli) for key, curve in by.items()}
    columns = [column_of(table, "force_rigid_N", ratio, SINGLE_GOAL)]
    sensor = next(iter(by.values())).sensor
    if "stress_rigid_Pa" in table.columns:
        stress = {key: values / sensor.tooth.area for key, values in ratio.items()}
        columns.append(column_of(table, "stress_rigid_Pa", stress))
    columns += [column_of(table, "voltage_pvdf2_V", tooth), column_of(table, "voltage_pvdf1_V", base)]
    comparison = Comparison(table, tuple(columns), ())
    force = abs(table.values("force_rigid_N"))
    over_tooth = {f"{name} set ({model})": tooth[name, model] / ratio[name, model] for name, model in ratio}
    over_base = {f"{name} set ({model})": values for (name, model), values in base.items()}
    sentences = [
        fit_sentence(comparison, "force_rigid_N"),
        odds_sentence(table, "single"),
        *prediction_sentences(comparison, "force_rigid_N", film="voltage_pvdf2_V"),
        voltage_sentence(table, "voltage_pvdf2_V", force, sensor, TOOTH, over_tooth),
        voltage_sentence(table, "voltage_pvdf1_V", abs(table.values("force_total_N")), sensor, BASE, over_base),
    ]
    return Comparison(table, comparison.columns, tuple(sentences))


# --- Tables 4.3 to 4.6 and A2.3 to A2.6: two sensors, on a common base or on different ones, on both rings

PAIR_GOAL = 0.015
# Design of each table, and the table of the same layout on a common base.
TWINS = {"4.3": "4.5", "4.4": "4.6", "A2.5": "A2.3", "A2.6": "A2.4"}
DESIGNS = {
    **dict.fromkeys(TWINS, "different_base"),
    **dict.fromkeys(TWINS.values(), "common_base"),
}


def pair_cases(parameters: Sequence[str], design: str, ring: float) -> dict[tuple[str, str], CurveCase]:
    """Cases that a table for a ring [Pa] needs, by parameter set and model."""
    return {(name, "solid"): CurveCase(design, "solid", name, ring) for name in parameters}


def compare_pair(number: str, parameters: Sequence[str], curves: Curves) -> Comparison:
    """One of the eight tables. Each tooth film takes half of the teeth's force."""
    table, design = read_table(number), DESIGNS[number]
    moduli, ring = table.keys(), ring_of(table)
    by = {key: curves.of(case) for key, case in pair_cases(parameters, design, ring).items()}
    ratio = {key: curve.force_ratio(moduli) for key, curve in by.items()}
    half = {key: values / 2 for key, values in ratio.items()}
    voltage = {key: curve.voltage(TOOTH, moduli) for key, curve in by.items()}
    ours = {"force_ratio": (ratio, PAIR_GOAL), "force_pvdf": (half, None), "voltage": (voltage, None)}
    columns = tuple(
        column_of(table, name, *given)
        for kind, given in ours.items()
        for name in sorted(table.columns)
        if name.startswith(kind)
    )
    comparison = Comparison(table, columns, ())
    sensor = next(iter(by.values())).sensor
    over = {f"{name} set ({model})": voltage[name, model] / half[name, model] for name, model in half}
    sentences = [
        fit_sentence(comparison, "force_ratio"),
        odds_sentence(table, design),
        *prediction_sentences(comparison, "force_ratio"),
        voltage_sentence(
            table, "voltage_pvdf1_V", abs(table.values("force_pvdf1_N")), sensor, TOOTH, over
        ),
    ]  # fmt: skip
    if number in TWINS:
        sentences.append(twin_sentence(table, read_table(TWINS[number])))
        apart = [
            f"{float(np.abs(ratio[key] - curves.of(other).force_ratio(moduli)).max()):.1g} by the {key[0]} set"
            for key, other in pair_cases(parameters, "common_base", ring).items()
        ]
        sentences.append(
            "the model's ratio on different bases differs from that on a common one by at most " + ", ".join(apart)
        )
    return Comparison(table, columns, tuple(sentences))


def twin_sentence(table: ThesisTable, twin: ThesisTable) -> str:
    """Sentence that tells how many cells of a different-base table equal those of the common-base one."""
    pairs = [
        (float(table.values(name)[row]), float(twin.values(other)[row]))
        for name, other in (
            ("voltage_pvdf1_V", "voltage_pvdf1_V"), ("voltage_pvdf3_V", "voltage_pvdf2_V"),
            ("force_pvdf1_N", "force_pvdf1_N"), ("force_pvdf3_N", "force_pvdf2_N"), ("force_ratio", "force_ratio"),
        )
        for row in range(len(table.rows))
    ]  # fmt: skip
    same = sum(ours == theirs for ours, theirs in pairs)
    verdict = "it is a copy, not an independent result" if same == len(pairs) else "the two are not independent"
    return f"{same} of {len(pairs)} cells, repaired, are those of Table {twin.number}: {verdict}"


# --- Table 5.8: the theories that its percent errors imply, rebuilt from the experiments ---------------


BEAMS = ("beam", "beam_printed")
# Each column has: design, models, table with the theory itself, whether the error is percent of the experiment.
THEORIES: dict[str, tuple[str, tuple[str, ...], str | None, bool]] = {
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
    measured = get_design(THEORIES[column][0]).thesis_force_ratio
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


def compare_theories(parameters: Sequence[str], curves: Curves) -> Comparison:
    """The table's four theories by both definitions of the error, beside the models at the samples' moduli."""
    table = read_table("5.8")
    samples, moduli = _samples(table), sample_moduli()
    columns, sentences = [], []
    for name, (design, theories_of_ours, source, of_experiment) in THEORIES.items():
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
            goal = SINGLE_GOAL if source is None and definition == taken else None
            columns.append(
                ComparedColumn(f"{name}_{definition}", cells, ours, goal, () if source is None else (source,))
            )
        sentences.append(_definition(name, theories, taken, source, moduli))
    shown = {column.quantity: column.cells for column in columns}
    samples_only = ThesisTable(
        table.number, table.title, table.key, samples, MappingProxyType(shown),
        "the theory is rebuilt from the printed error and the experiment: the averages printed below Tables A2.9 to"
        " A2.20, and Table 5.7 for different bases; `printed` is the error in percent; " + table.doubt,
    )  # fmt: skip
    comparison = Comparison(samples_only, tuple(columns), ())
    for name, (*_, of_experiment) in THEORIES.items():
        quantity = f"{name}_{OF_EXPERIMENT if of_experiment else OF_THEORY}"
        if any(column.ours for column in columns if column.quantity == quantity):
            sentences.append(fit_sentence(comparison, quantity))
    if "physical" in parameters:
        sentences.append("single_vs_2D: the beam's thickness and length were chosen to meet this column: a fit")
        sentences.append(program_sentence(moduli))
    else:
        sentences.append("single_vs_2D: the beam has no identified set, so that nothing of ours stands beside it")
    return Comparison(samples_only, tuple(columns), tuple(sentences))


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


# --- Table A2.7: a point load moves along the length of the common base --------------------------------

POINT_MODEL = "solid"
# Modulus of the object, which the table does not tell: with it Table A2.3 has the ratio that A2.7 has beside the teeth.
POINT_MODULUS = 430e3
# Modulus of set `capped`, fitted with the rest of the set: 4.5 times the ring's.
CAPPED, CAPPED_MODULUS = "capped", 4.5 * RING
POINT_GOAL = 0.04  # N of 1 N: the fit of the cap reaches it; all sets are compared with it


def position_sets(parameters: Sequence[str]) -> tuple[str, ...]:
    """Parameter sets of this table: with "identified" also `capped`, which was fitted to this table alone."""
    return (*parameters, CAPPED) if "identified" in parameters else tuple(parameters)


def compare_position(parameters: Sequence[str], curves: Curves) -> Comparison:
    """Table A2.7 on the coarsest mesh, which is within 4e-3 N of the next finer one (set `capped`: 0.02 N)."""
    table = read_table("A2.7")
    x = 1e-3 * table.keys()
    forces = {}
    for name in position_sets(parameters):
        chosen = get_parameter_set(name, POINT_MODEL)
        sensor = chosen.design(get_design("common_base"))
        places = [(float(place), sensor.cell[1] / 2) for place in x]
        asked = solid_parameters(sensor, chosen.load(CAPPED_MODULUS if name == CAPPED else POINT_MODULUS))
        solved = curves.solutions.of(
            asked,
            f"mesh {COARSE_MESH}, point loads at {places}",
            functools.partial(_solve, asked, places),
        )
        forces[name, POINT_MODEL] = np.reshape(solved, (len(places), len(sensor.teeth)))
        curves.step(f"common_base under a point load, {name}")
    left, right = ({key: teeth[:, tooth] for key, teeth in forces.items()} for tooth in (0, 1))
    none = np.zeros(len(x))

    def volts(film: str, force: np.ndarray) -> np.ndarray:
        return film_voltages(get_design("common_base"), film, force, none, none)

    columns = (
        column_of(table, "force_pvdf3_N", left, POINT_GOAL),
        column_of(table, "force_pvdf1_N", right, POINT_GOAL),
        column_of(table, "force_ratio", {key: teeth.sum(axis=1) for key, teeth in forces.items()}, POINT_GOAL),
        column_of(table, "voltage_pvdf3_V", {key: volts(TOOTH, force) for key, force in left.items()}),
        column_of(table, "voltage_pvdf1_V", {key: volts(TOOTH, force) for key, force in right.items()}),
        column_of(table, "voltage_pvdf2_V", {key: volts(BASE, none + 1) for key in left}),
    )
    comparison = Comparison(table, columns, ())
    thesis = table.values("force_pvdf3_N")
    middle, above, edge = len(x) // 2, int(np.argmax(thesis)), 0
    sentences = [
        f"the object's modulus is not printed: {POINT_MODULUS / 1e3:g} kPa is taken, at which Table A2.3 has the force"
        f" ratio {_at_modulus():.4f}; A2.7 has {table.values('force_ratio')[middle]:.4f} between the teeth",
        *(fit_sentence(comparison, quantity) for quantity in ("force_pvdf3_N", "force_pvdf1_N", "force_ratio")),
    ]
    for (name, _), force in left.items():
        sentences.append(
            f"left tooth, {name} set: between the teeth {force[middle]:.3f} N (thesis {thesis[middle]:.3f}), above the"
            f" tooth {force[above]:.3f} N (thesis {thesis[above]:.3f}), at the edge {force[edge]:.3f} N (thesis"
            f" {thesis[edge]:.3f}), least {force.min():.3f} N (thesis {thesis.min():.5f})"
        )
    over = ", ".join(f"{name} set {_span(force)}" for (name, _), force in left.items())
    sentences.append(
        f"the thesis' force hardly depends on the place of a load beside a tooth ({_span(thesis)} over 3 mm; {over}),"
        " as where the ring's top stays level. Below zero, our model holds the contact where it would lift off"
    )
    if CAPPED in position_sets(parameters):
        sentences.append(
            "the capped set is a fit to this table: a rigid cap that keeps each ring's top level, Poisson ratios 0.3,"
            f" an object of 0.8 mm and {CAPPED_MODULUS / 1e3:g} kPa. At that modulus Table A2.3 has the force ratio"
            f" {table_ratio('A2.3', np.array([CAPPED_MODULUS]))[0]:.3f}: the two tables are not of one object"
        )
    return Comparison(table, columns, tuple(sentences))


def _span(forces: np.ndarray) -> str:
    """Least and greatest force under loads beside the left tooth and its gap."""
    beside = forces[[0, 1, 3]]
    return f"{beside.min():.4f} to {beside.max():.4f} N"


def _solve(asked: SolidParameters, places: list[tuple[float, float]]) -> list[float]:
    from palpate.instrument.models.solid.model import point_loads

    return list(point_loads(asked, places, COARSE_MESH).ravel())


def _at_modulus() -> float:
    table = read_table("A2.3")
    return float(abs(table.values("force_ratio"))[table.keys() == POINT_MODULUS][0])
