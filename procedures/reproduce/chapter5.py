"""The thesis' experiments of chapter 5 beside experiments on the simulated bench."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.compression import LOADING
from palpate.instrument.findings.film_forces import apart
from palpate.instrument.models.evidence import GIVEN, Evidence, EvidencePart, of_experiment, ratio_by
from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.signals.oscilloscope import Distortion, Oscilloscope, ScopeReading, distortion
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, TableCell, ThesisTable, read_table
from palpate.procedures.measurements.load_cell.report import LoadCellResult
from palpate.procedures.measurements.loads import LoadPoint, SweepResult
from palpate.procedures.measurements.modulus import ModulusResult
from palpate.procedures.records.run import Run
from palpate.procedures.reproduce.chapter4 import (
    OF_EXPERIMENT,
    OF_THEORY,
    THEORIES,
    beam_ratios,
    implied,
    sample_moduli,
    table_ratio,
)
from palpate.procedures.reproduce.rows import WITHIN, Comparison, Row, RowCorrelation, RowTable
from palpate.procedures.steps.film_point import FALSE_ALARMS

DIGIT_U = math.sqrt(2 / 3)  # mV: both readings are known to ±1 digit
WENT_IN = GIVEN.evidence(())  # load cell and rubbers are simulated by the thesis' own line and moduli


def calibration_rows(found: LoadCellResult) -> RowTable:
    """Table 5.1: readings under dead weights, and the line through them."""
    table = read_table("5.1")
    ours = {(p.direction, round(p.load_gf)): p.reading_mV for p in found.points}
    rows = [
        Row(row, column, table.columns[column][index], ours[direction, round(float(row))], DIGIT_U, WENT_IN)
        for index, row in enumerate(table.rows)
        for direction, column in (("loading", "reading_loading_mV"), ("unloading", "reading_unloading_mV"))
    ]
    line, thesis = found.calibration, THESIS_LOAD_CELL
    for name, value, u in (
        ("sensitivity_mV_per_N", line.sensitivity_mV_per_N, line.sensitivity_u),
        ("zero_mV", line.zero_mV, line.zero_u),
    ):
        cell = TableCell("", float(getattr(thesis, name)), "not printed: the line through the readings")
        rows.append(Row("line", name, cell, value, u, WENT_IN))
    sentences = (
        f"sensitivity {thesis.sensitivity_mV_per_N:.3f} mV/N by the line; the printed 0.1053 mV/N is mV per gram-force,"
        f" {0.1053 / 9.80665e-3:.2f} mV/N, and takes no zero into account",
    )
    return RowTable("5.1", table.title, table.doubt, tuple(rows), sentences)


def compression_rows(number: str, sample: str, found: ModulusResult) -> RowTable:
    """Tables 5.2 and 5.3: stress and secant modulus at the thesis' strains, ours along the loading line."""
    table, c = read_table(number), found.compression
    printed = table.values("modulus_Pa")
    spread = float(printed.std(ddof=1))
    points = [p for p in c.points if p.direction == LOADING]
    tangent, tangent_u = c.tangent.value, c.tangent.u
    rows = []
    u = math.hypot(spread, tangent_u)
    for index, row in enumerate(table.rows):
        strain = table.columns["strain"][index].value
        for name, ours, scale in (("stress_Pa", tangent * strain, strain), ("modulus_Pa", tangent, 1.0)):
            group = RowCorrelation(name, u * scale, tangent_u * scale)  # one line of ours gives all rows
            rows.append(Row(row, name, table.columns[name][index], ours, u * scale, WENT_IN, group=group))
    mean = float(printed.mean())
    group = RowCorrelation("mean modulus", tangent_u, 0.0)
    rows.append(Row("mean", "modulus_Pa", TableCell(f"{mean:.1f}", mean), tangent, tangent_u, WENT_IN, group=group))
    sentences = (
        f"sample {sample}: ours up to a strain of {max(p.strain for p in points):.2f}, by the face of 1 cm2 and the"
        " calibration of Table 5.1; the scatter stated is that of the thesis' moduli, and our standard uncertainty",
        "the readings themselves are not compared: at the printed moduli they would be 9.5 times smaller",
    )
    return RowTable(number, table.title, table.doubt, tuple(rows), sentences)


def catalogue_rows(tested: Mapping[str, ModulusResult]) -> RowTable:
    """Table 5.4: whether the modulus of each rubber, tested or else stored, lies in its range."""
    table = read_table("5.4")
    low, high = table.values("compression_deflection_min_Pa"), table.values("compression_deflection_max_Pa")
    rows = []
    for index, row in enumerate(table.rows):
        ours = tested[row].compression.tangent.value if row in tested else SAMPLES[row].modulus
        cell = TableCell(f"{low[index]:g} to {high[index]:g}", float(np.mean([low[index], high[index]])))
        # Half the range is two standard uncertainties, so that a modulus inside the range is within.
        rows.append(Row(row, "modulus_Pa", cell, ours, float(high[index] - low[index]) / 4, WENT_IN))
    sentences = ("thesis: the middle of the catalogue's range; half the range counts as two standard uncertainties",)
    return RowTable("5.4", table.title, table.doubt, tuple(rows), sentences)


# --- What the waveforms of a simulated sweep show, as they were recorded: the oscilloscope's reading, and distortion

SCOPE_SHOWN = Oscilloscope()


@dataclass(frozen=True, slots=True)
class PointTraces:
    """What the waveforms of one point show.

    Attributes:
        load_mV: the oscilloscope's reading of the load in mV of the load cell. The thesis' scenes sample no waveform of
            that; it is the sum of the base films' forces, by the line of Table 5.1 without its zero, since it is AC.
        distortions: of each film.
    """

    load_mV: ScopeReading
    distortions: tuple[Distortion, ...]


Traces = Mapping[tuple[str, float], PointTraces]  # by sample and load [N]


def read_traces(folder: Path, design: Design, frequency: float) -> Traces:
    """What the waveforms of a recorded load sweep show. Raises RecordError, EstimateError."""
    run, found = Run.open(folder), {}
    by_point = itertools.groupby(run.waveforms(), key=lambda waveform: waveform.point_id)
    for point, (_, waveforms) in zip(run.points(), by_point, strict=True):
        several = {waveform.name: waveform for waveform in waveforms}
        rate = several[design.films[0].name].rate
        volts = np.array([several[film.name].samples for film in design.films], dtype=np.float64)
        bases = [number for number, film in enumerate(design.films) if film.kind == FILM_KINDS[1]]
        force = sum(volts[number] / design.films[number].sensitivity for number in bases)
        fit = fit_sine(np.arange(volts.shape[1]) / rate, volts, frequency)
        found[point["sample"], point["load_N"]] = PointTraces(
            SCOPE_SHOWN.read(rate, THESIS_LOAD_CELL.sensitivity_mV_per_N * force, frequency),
            tuple(distortion(fit, number, each) for number, each in enumerate(volts)),
        )
    return found


def distortion_sentence(design: Design, points: Mapping[str, PointTraces]) -> str:
    """Sentence on what the oscilloscope shows, and on the distortion of every film by sample (thesis 5.4.1)."""
    listed = "; ".join(
        f"{film.name} " + ", ".join(_distortion_text(key, traces.distortions[number]) for key, traces in points.items())
        for number, film in enumerate(design.films)
    )
    why = (
        "* more than noise explains" if "*" in listed else "noise explains all of it: no effect of this scene distorts"
    )
    return (
        "our oscilloscope shows the base films' force in mV of the load cell, one sweep on 8 bits. Total harmonic"
        f" distortion in percent (u), by film and sample: {listed} ({why}; the thesis saw it under samples 2 and 5)"
    )


def _distortion_text(sample: str, seen: Distortion) -> str:
    return f"{sample}: {100 * seen.value:.3f} ({100 * seen.u:.3f}){'*' * (seen.by_noise < FALSE_ALARMS)}"


# --- Columns of the thesis' tables of experiments: our value of each from a point, and the scatter of both

# True over set force in the thesis: 1.029, with a scatter of 2.0 % between samples and 2.4 % within a sample.
LOAD_OFFSET, LOAD_BETWEEN, LOAD_WITHIN = 0.029, 0.020, 0.024
METER_U = 1.0  # mV: the lower limit factor of ASTM E74 of Table 5.1, 0.096 N
FORCES, RATIO, METER, SCOPE = "forces and voltages", "force_ratio", "meter_reading_mV", "oscilloscope_mV"

Value = Callable[[LoadPoint], float]
Expected = Callable[[float, float], float]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A column of a table.

    Attributes:
        value: function that reads our value from a point.
        expected: function of a load [N] and the thesis' mean ratio of the sample that gives the value without scatter.
        scatter: relative scatter of a cell of the thesis, and of one of ours without the scatter of its load; 0 for the
            meter, whose scatter is not relative.
        film: names of the columns of voltage and force of the film from which the value is read; None: there is not one
            film alone.
        ours: relative scatter of one of ours, where it is not the thesis'.
    """

    column: str
    value: Value
    expected: Expected
    scatter: float
    film: tuple[str, str] | None = None
    ours: Value | None = None

    def own(self, point: LoadPoint) -> float:
        """Relative scatter of our value: a load is set as exactly as the load cell tells it."""
        scatter = self.ours(point) if self.ours else self.scatter
        return math.hypot(scatter, point.load_measured_u / point.load_N) if self.film else scatter

    def theirs(self, *load: float) -> float:
        """Relative scatter of a cell of the thesis, whose load has these relative scatters."""
        return math.hypot(self.scatter, *load) if self.film else self.scatter


def quantities(design: Design, traces: Traces, numbers: Collection[str]) -> list[Quantity]:
    """Columns of the design's tables, of which `numbers` are those of all loads."""
    teeth = [film for film in design.films if film.kind == FILM_KINDS[0]]
    bases = [film for film in design.films if film.kind == FILM_KINDS[1]]

    def on_teeth(load: float, ratio: float) -> float:
        return ratio * load / len(teeth)

    def on_bases(load: float, _ratio: float) -> float:
        return load / len(bases)

    found = [
        Quantity(RATIO, lambda p: p.force_ratio, lambda _, ratio: ratio, design.ratio_scatter),
        Quantity(METER, lambda p: p.indicator_mV, lambda *_: math.nan, 0.0),
    ]
    if len(teeth) == 1:
        names = ("pvdf2_rigid_mV", "force_rigid_N")
        found += _read(teeth[0], names, lambda p: p.voltage_rigid_V, lambda p: p.force_rigid_N, on_teeth)
    else:
        for n, film in enumerate(teeth):
            number = (1 + n) if len(bases) == 1 else (1 + 2 * n)
            names = (f"pvdf{number}_mV", f"force{number}_N")
            found += _read(film, names, _tooth(n, "voltage_V"), _tooth(n, "force_N"), on_teeth)
    if len(bases) == 1:
        names = ("pvdf1_total_mV" if len(teeth) == 1 else "pvdf3_total_mV", "force_total_N")
        found += _read(bases[0], names, lambda p: p.voltage_total_V, lambda p: p.force_total_N, on_bases)
    else:
        for n, (film, base) in enumerate(zip(bases, ("2_total_left", "4_total_right"), strict=True)):
            names = (f"pvdf{base}_mV", f"force{base}_N")
            found += _read(film, names, _tooth(n, "base_voltage_V"), _tooth(n, "base_force_N"), on_bases)
    if numbers:
        found.append(_scope(bases[0], traces, numbers))
    return found


def _scope(base: Film, traces: Traces, numbers: Collection[str]) -> Quantity:
    """The column of the oscilloscope, which shows the load cell's signal; ours comes from the film under the base."""
    names = (SCOPE, "force_total_N")
    gains = np.concatenate([table.values(names[0]) / table.values(names[1]) for table in map(read_table, numbers)])

    def read(point: LoadPoint) -> ScopeReading:
        return traces[point.sample, point.load_N].load_mV

    return Quantity(
        SCOPE,
        lambda point: read(point).peak_to_peak,
        lambda load, _ratio: THESIS_LOAD_CELL.sensitivity_mV_per_N * load,
        float(gains.std(ddof=1) / gains.mean()),
        names,
        lambda point: math.hypot(base.scatter, read(point).u / read(point).peak_to_peak),
    )


def between_samples(numbers: Iterable[str], film: tuple[str, str]) -> float:
    """Relative standard deviation of a film's gain from one sample's table to the next; 0: there is one table."""
    gains = [float(np.mean(table.values(film[0]) / table.values(film[1]))) for table in map(read_table, numbers)]
    return float(np.std(gains, ddof=1) / np.mean(gains)) if len(gains) > 1 else 0.0


def mean_sum(table: ThesisTable, set_loads: Iterable[float]) -> float:
    """Load by the thesis' own base films over the set load, in the mean over a table."""
    bases = [column for column in table.columns if "total" in column and column.endswith("_N")]
    total = sum(table.values(column) for column in bases)
    return float(np.mean(total / np.array(list(set_loads))))


def _read(film: Film, names: tuple[str, str], voltage: Value, force: Value, expected: Expected) -> list[Quantity]:
    """The two columns of a film: voltage and force."""
    mV_per_N = 1e3 * film.sensitivity
    return [
        Quantity(
            names[0], lambda p: 1e3 * voltage(p), lambda load, ratio: mV_per_N * expected(load, ratio), film.scatter,
            names,
        ),
        Quantity(names[1], force, expected, film.scatter, names),
    ]  # fmt: skip


def _tooth(number: int, name: str) -> Value:
    return lambda point: float(getattr(point.teeth[number], name))


# --- Tables A2.9 to A2.20 and 5.5 to 5.7: the thesis' sweeps beside sweeps of the simulated bench ------

AT_3_N = 3.0
THESIS, OURS = "the thesis' cell", "our cell"


@dataclass(frozen=True, slots=True)
class Arrangement:
    """One sensor of chapter 5.

    Attributes:
        scene: name of the scene that simulates it.
        loads: loads, peak to peak [N].
        tables: table of all loads for each sample; the different bases have none.
        summary: table of the rows at 3 N, with one row for each sample.
    """

    scene: str
    design: str
    loads: tuple[float, ...]
    tables: Mapping[str, str]
    summary: str

    @property
    def averaged(self) -> int:
        """Number of load sets over which a printed mean is taken; one for the different bases."""
        return len(self.loads) if self.tables else 1


ARRANGEMENTS = (
    Arrangement("thesis_single", "single", get_design("single").thesis_loads, SINGLE_TABLES, "5.5"),
    Arrangement("thesis_common_base", "common_base", get_design("common_base").thesis_loads, COMMON_BASE_TABLES, "5.6"),
    # [A] The loads of the other pair: of different bases the thesis has one load.
    Arrangement("thesis_different_base", "different_base", get_design("common_base").thesis_loads, {}, "5.7"),
)


def order_by_modulus() -> list[str]:
    """Samples from hard to soft, as Figure 5.2 has them."""
    return sorted(SAMPLES, key=lambda name: SAMPLES[name].modulus, reverse=True)


def reversed_pairs(swept: SweepResult, design: Design) -> dict[tuple[str, str], str]:
    """Pairs of samples that we order the other way round than the thesis' figure of this sensor, with the reason or "".

    The figures are for 3 N. In Figure 5.4 sample 5 is above sample 3, although the mean of 3 over all loads is greater.
    """
    means = dict(zip([s.sample for s in swept.samples if s.force_ratio is not None], swept.budgets, strict=True))
    place = {name: number for number, name in enumerate(swept.softness_order)}
    pairs = {}
    for harder, softer in itertools.combinations(design.thesis_softness_order, 2):
        if place[harder] > place[softer]:
            by_mean = design.thesis_force_ratio[softer] > design.thesis_force_ratio[harder]
            alike = "" if apart(means[harder], means[softer]) else "ours does not tell them apart"
            pairs[harder, softer] = "the thesis' means have it so" if by_mean else alike
    return pairs


def order_is_right(swept: SweepResult, design: Design) -> bool:
    """Whether every reversed pair of samples has a reason."""
    return all(reversed_pairs(swept, design).values())


def _order(swept: SweepResult, design: Design) -> str:
    pairs = reversed_pairs(swept, design)
    figure = f"the thesis' figure has {' > '.join(design.thesis_softness_order)}"
    if not all(pairs.values()):
        return f"WRONG: {figure}"
    reasons = [f"{harder} and {softer}: {why}" for (harder, softer), why in pairs.items()]
    return f"right; {figure} ({'; '.join(reasons)})" if reasons else "right"


def compare_experiment(
    arrangement: Arrangement, swept: SweepResult, traces: Traces, ratio: EvidencePart
) -> Iterator[RowTable]:
    """Every table of an arrangement. `ratio` is the part from which our force ratios come."""
    design = get_design(arrangement.design)
    for sample, number in arrangement.tables.items():
        points = {key: _at(swept, sample, float(key)) for key in read_table(number).rows}
        found = _table(arrangement, number, points, traces, ratio)
        yield replace(found, rows=(*found.rows, _average(design, swept, sample, ratio, number)))
    number = arrangement.summary
    points = {key: _at(swept, key, AT_3_N) for key in read_table(number).rows}
    found = _table(arrangement, number, points, traces, ratio)
    means = [] if arrangement.tables else [_average(design, swept, key, ratio, number) for key in SAMPLES]
    order = f"softness order of ours, hard to soft: {' > '.join(swept.softness_order)}: {_order(swept, design)}"
    distortions = distortion_sentence(
        design, {key: traces[point.sample, point.load_N] for key, point in points.items()}
    )
    yield replace(found, rows=(*found.rows, *means), sentences=(order, *found.sentences, distortions))


def _at(swept: SweepResult, sample: str, load: float) -> LoadPoint:
    return next(p for p in swept.points if p.sample == sample and p.load_N == load)


def _table(
    arrangement: Arrangement, number: str, points: Mapping[str, LoadPoint], traces: Traces, ratio: EvidencePart
) -> RowTable:
    """Cells of every row beside the point with that key."""
    table, design = read_table(number), get_design(arrangement.design)
    load_factor = mean_sum(table, [point.load_N for point in points.values()])
    of_one_sample = number in arrangement.tables.values()
    rows = [
        _row(table, key, quantity, point, arrangement, ratio, load_factor, of_one_sample)
        for key, point in points.items()
        for quantity in quantities(design, traces, arrangement.tables.values())
        if quantity.column in table.columns
    ]
    off = abs(load_factor - 1) > WITHIN * math.hypot(LOAD_OFFSET, LOAD_BETWEEN)
    sentences = (
        f"the thesis' own base films tell of {load_factor:.3f} times the set load in the mean, more than its loads"
        " scatter. All its forces and voltages are off by that factor, its ratios are not; the test for a bias"
        " divides by it",
    )
    again = bool(arrangement.tables) and not of_one_sample
    return RowTable(number, table.title, table.doubt, tuple(rows), sentences if off else (), design.name, again=again)


def _row(
    table: ThesisTable,
    key: str,
    quantity: Quantity,
    point: LoadPoint,
    arrangement: Arrangement,
    ratio: EvidencePart,
    load_factor: float,
    of_one_sample: bool,
) -> Row:
    design, cell = get_design(arrangement.design), table.columns[quantity.column][table.rows.index(key)]
    ours, evidence = quantity.value(point), of_experiment(quantity.column, ratio, table.number)
    own, theirs, group = quantity.own(point), quantity.theirs(LOAD_OFFSET, LOAD_BETWEEN, LOAD_WITHIN), None
    if quantity.column == RATIO and evidence is Evidence.INPUT and not arrangement.tables:
        theirs = 0.0  # our number is this very cell, so the cell does not scatter about it
    u = math.hypot(theirs * cell.value, own * ours) or METER_U
    if quantity.film is not None:
        varies = quantity.theirs(*(() if of_one_sample else (LOAD_BETWEEN,)), LOAD_WITHIN)
        common = between_samples(arrangement.tables.values(), quantity.film) if of_one_sample else 0.0
        at_load = cell.value / load_factor
        kind = SCOPE if quantity.column == SCOPE else FORCES
        group = RowCorrelation(kind, math.hypot(varies * at_load, own * ours), common * at_load, load_factor)
    elif quantity.column == METER:
        group = RowCorrelation(METER, u, u)  # one line of the load cell holds for all
    found = Row(key, quantity.column, cell, ours, u, evidence, group=group)
    if found.within is False and quantity.column != METER:
        expected = quantity.expected(point.load_N, design.thesis_force_ratio[point.sample])
        return replace(found, because=_because(cell.value, ours, expected, theirs, own))
    return found


def _because(thesis: float, ours: float, expected: float, theirs: float, own: float) -> str:
    """Text that tells whose scatter a difference is, by the value that load and the thesis' mean ratio give."""
    far = {OURS: (ours / expected - 1) / own}
    if theirs:
        far[THESIS] = (thesis / expected - 1) / theirs
    whose = [name for name, distance in far.items() if abs(distance) > WITHIN]
    return (
        f"{' and '.join(whose) or 'both scatter apart'}: without scatter {expected:.3g}; the thesis"
        f" {100 * (thesis / expected - 1):+.0f} % ({far.get(THESIS, 0.0):+.1f} of its scatter), ours"
        f" {100 * (ours / expected - 1):+.0f} % ({far[OURS]:+.1f})"
    )


def _average(design: Design, swept: SweepResult, sample: str, ratio: EvidencePart, table: str) -> Row:
    """Row of the mean ratio. The printed mean is over all load sets, that of the different bases over one."""
    mean = next(mean for mean in swept.samples if mean.sample == sample)
    thesis, evidence = design.thesis_force_ratio[sample], of_experiment(RATIO, ratio, table)
    sets = 1 if design.separate_bases else len(design.thesis_loads)
    ours, u = mean.force_ratio or math.nan, mean.force_ratio_u or math.nan
    if evidence is not Evidence.INPUT:  # otherwise our number is this very mean, which does not scatter about itself
        u = math.hypot(design.ratio_scatter * thesis / math.sqrt(sets), u)
    row = "average" if sets > 1 else f"{sample} (ours: mean over loads)"
    # There is one mean for each sample; among cells that are no means it is a kind of its own.
    found = Row(
        row,
        RATIO,
        TableCell(f"{thesis:g}", thesis),
        ours,
        u,
        evidence,
        group=RowCorrelation("mean force ratio", u, 0.0),
    )
    return replace(found, because="our mean: its own scatter") if found.within is False else found


# --- Blind runs: the whole bench with force ratios by models that know nothing of the thesis' experiments
#
# The thesis' scenes normally give the measured means. Here the same scenes give force ratios by finite elements, with
# the materials as the thesis tells them ("physical"), and with the set that was fitted to the thesis' finite elements
# ("identified"). The means of these sweeps are compared with the measured means. All differences are model less
# measured mean, in percent of the measured mean.

BLIND_MODEL = "surface"  # of the solid model, because it answers at once
BLIND_SETS = ("physical", "identified")
OTHER_SIGN = "the columns of percent below keep the sign of Table 5.8, which is the other one: experiment less theory"
# Column of Table 5.8 with the thesis' own finite elements, for each design.
OWN_THEORY = {
    design: name for name, (design, _, source, _) in THEORIES.items() if source is not None
}  # fmt: skip


def loads_of(arrangement: Arrangement) -> tuple[float, ...]:
    """Three of an arrangement's loads [N]. Models are linear in the load, and each load takes a second."""
    return arrangement.loads[0], AT_3_N, arrangement.loads[-1]


def compare_blind(arrangement: Arrangement, parameters: str, swept: SweepResult) -> tuple[RowTable, Validation]:
    """Means of a sweep by a parameter set beside the measured means, for each sample."""
    design = get_design(arrangement.design)
    ratio = ratio_by(BLIND_MODEL, parameters)
    tables = tuple(arrangement.tables.values()) or (arrangement.summary,)  # these print the means
    means = {mean.sample: mean for mean in swept.samples}
    rows, percent = [], {}
    for sample in SAMPLES:
        measured, mean = design.thesis_force_ratio[sample], means[sample]
        ours, ours_u = mean.force_ratio or math.nan, mean.force_ratio_u or math.nan
        u = math.hypot(design.ratio_scatter * measured / math.sqrt(arrangement.averaged), ours_u)
        evidence = of_experiment(RATIO, ratio, *tables)
        rows.append(
            Row(
                sample,
                RATIO,
                TableCell(f"{measured:g}", measured),
                ours,
                u,
                evidence,
                by=f"{BLIND_MODEL}, {parameters}",
            )
        )
        percent[sample] = 100 * (ours / measured - 1)
    found = Validation(design.name, parameters, BLIND_MODEL, "compared", percent=percent)
    title = f"blind run of {design.name}, which knows nothing of the means beside it"
    sentences = (distance_sentence(found), _own_theory(design.name), OTHER_SIGN)
    number = f"{' to '.join(dict.fromkeys((tables[0], tables[-1])))}, {parameters} set"
    name = f"blind_{design.name}_{parameters}"
    return RowTable(number, title, "", tuple(rows), sentences, name=name), found


def distance_sentence(found: Validation) -> str:
    """Sentence on the distance from the measured means."""
    by_sample = ", ".join(f"{sample} {value:+.0f} %" for sample, value in found.percent.items())
    return (
        f"{found.design}, {found.parameters} set by model {found.model!r}: mean {found.mean:+.1f} %,"
        f" rms {found.rms:.1f} %, worst {found.worst:+.1f} % ({SIGN}); by sample: {by_sample}"
    )


def _own_theory(design: str) -> str:
    """Sentence on the thesis' own finite elements with the same sign, rebuilt from the errors of Table 5.8."""
    column = OWN_THEORY[design]
    *_, of_experiment_ = THEORIES[column]
    rebuilt = implied(column)[OF_EXPERIMENT if of_experiment_ else OF_THEORY]
    samples = [sample for sample in read_table("5.8").rows if sample != "average"]
    measured = np.array([get_design(design).thesis_force_ratio[sample] for sample in samples])
    percent = 100 * (rebuilt / measured - 1)
    by_sample = ", ".join(f"{sample} {value:+.0f} %" for sample, value in zip(samples, percent, strict=True))
    return (
        f"{design}, the thesis' own three-dimensional finite elements, rebuilt from Table 5.8: mean"
        f" {percent.mean():+.1f} % by the same sign; by sample: {by_sample}"
    )


# --- Table 5.8: percent errors of our bench's experiments against our models, beside the thesis' -------
#
# All errors are the experiment less the theory, so that an experiment above the theory has a positive error. They are
# percent of the theory for the single sensor and percent of the experiment for the two others, because with that the
# thesis' own numbers give its percentages.

Array = NDArray[np.float64]

AVERAGE = "average"
GOAL = 0.012  # for a theory's force ratio, as in Tables A2.1 and A2.3
SLIPPED = 0.5  # percent points; a slip in the thesis' own theory that changes less does not count


def percent_definitions() -> RowTable:
    """Each printed percentage beside the two that follow from the thesis' own numbers, else from the beam.

    No scatter is known for a percentage, so nothing is judged. The sentences say which definition fits.
    """
    table = read_table("5.8")
    rows, sentences = [], []
    for name in THEORIES:
        cells = table.columns[f"{name}_error_percent"]
        by, evidence = "the thesis", Evidence.INPUT
        if THEORIES[name][2] is None:  # there are no printed numbers; the beam that was fitted to this table gives them
            by, evidence = "the thesis against beam", Evidence.FITTED
        misfit = {}
        for definition in ("theory", "experiment"):
            percent = _by_the_thesis(name, definition == "experiment")
            misfit[definition] = _rms(percent, cells)
            rows += [
                Row(row, f"{name}_percent_of_{definition}", cell, float(ours), None, evidence, by=by)
                for row, cell, ours in zip(table.rows, cells, percent, strict=True)
            ]
        best = min(misfit, key=lambda definition: misfit[definition])
        sentences.append(
            f"{name}, {by}: percent of the {best} fits best, {misfit[best]:.1f} points rms; of the other"
            f" {max(misfit.values()):.1f}"
        )
    title = "the thesis' own numbers, in percent of the theory and of the experiment: which it means"
    return RowTable(
        "5.8 (definitions)", title, table.doubt, tuple(rows), tuple(sentences), name="5_8_definitions", again=True
    )


def percent_of_bench(theories: Comparison, swept: Mapping[str, SweepResult]) -> RowTable:
    """Our experiments against our models, by the thesis' definitions.

    The scatter holds that of our mean ratios, half the goal of a theory, and the distance of the thesis' percentages
    from those that its own numbers give. Experiments and theories are judged and counted in tables of their own.

    Args:
        theories: Table 5.8 by the models: force ratios at the samples' moduli.
        swept: sweeps of the bench, by design.
    """
    table, rows, averages = read_table("5.8"), [], []
    for name, (design, _, source, to_experiment) in THEORIES.items():
        means = {mean.sample: mean for mean in swept[design].samples}
        measured = [means[sample] for sample in table.rows if sample != AVERAGE]
        experiment, u = (
            np.array([np.nan if value is None else value for value in values])
            for values in ([m.force_ratio for m in measured], [m.force_ratio_u for m in measured])
        )
        column = next(c for c in theories.columns if c.quantity.startswith(name))
        cells = _repaired(table, name, source, to_experiment)
        misfit = 0.0 if source is None else _rms(_by_the_thesis(name, to_experiment), cells)
        for series in column.ours:
            theory = series.values
            ours = percent_errors(experiment, theory, to_experiment)
            base = experiment if to_experiment else theory
            # Scatter of the error by experiment and by theory. For the average the theory's errors are fully
            # correlated.
            by_experiment = 100 * u * (theory / experiment if to_experiment else 1.0) / base
            by_theory = 100 * (GOAL / WITHIN) * (1.0 if to_experiment else experiment / theory) / base
            each = np.sqrt(by_experiment**2 + by_theory**2 + misfit**2)
            of_mean = np.sqrt((np.sum(by_experiment**2) + len(u) * misfit**2) / len(u) ** 2 + np.mean(by_theory) ** 2)
            evidence, by = column.evidence(series, table), f"{series.model}, {series.parameters}"
            averages.append(
                f"{name}, average: {ours[-1]:+.1f} % by {by} ({evidence.value}), the thesis {cells[-1].printed} %"
                + (f", without its slip {cells[-1].value:.1f} %" if cells[-1].reason else "")
            )
            rows += [
                Row(
                    row, f"{name}_percent", cell, float(found), float(spread), evidence, False,
                    by=f"bench against {by}",
                    # The theory is one curve, so all rows share its part.
                    group=RowCorrelation(f"{name}_percent", float(spread), float(np.mean(by_theory))),
                )
                for row, cell, found, spread in zip(table.rows, cells, ours, [*each, of_mean], strict=True)
            ]  # fmt: skip
    sentences = (
        "sign: the experiment less the theory, positive where the experiment lies above; percent of the theory for the"
        " single sensor, of the experiment for common and different bases, as the thesis has it",
        "the experiments are the bench's mean ratios, into which the thesis' own means went; fitted or predicted"
        " is the theory, and the error with it",
        *averages,
    )
    title = "percent errors of our bench's experiments against our models"
    return RowTable("5.8", title, table.doubt, tuple(rows), sentences, name="5_8_percent", again=True)


def percent_errors(experiment: Array, theory: Array, to_experiment: bool) -> Array:
    """The experiment less the theory in percent of either, for each sample, and their average."""
    percent = 100 * (experiment - theory) / (experiment if to_experiment else theory)
    return np.append(percent, percent.mean())


def _by_the_thesis(name: str, to_experiment: bool, printed: bool = False) -> Array:
    """Percentages of a column by the thesis' own means and its own theory, as printed or as repaired."""
    design, _, source, _ = THEORIES[name]
    measured, moduli = get_design(design).thesis_force_ratio, sample_moduli()
    experiment = np.array([measured[row] for row in read_table("5.8").rows if row != AVERAGE])
    theory = beam_ratios(moduli) if source is None else table_ratio(source, moduli, printed)
    return percent_errors(experiment, theory, to_experiment)


def _rms(percent: Array, cells: Sequence[TableCell]) -> float:
    """Root mean square of the samples' differences, without the average."""
    return float(np.sqrt(np.mean((percent - [cell.value for cell in cells])[:-1] ** 2)))


def _repaired(table: ThesisTable, name: str, source: str | None, to_experiment: bool) -> list[TableCell]:
    """The printed percentages; where they follow from a slip in the theory's own table, those of the repaired table."""
    cells = list(table.columns[f"{name}_error_percent"])
    if source is None:
        return cells
    right, slipped = (_by_the_thesis(name, to_experiment, printed) for printed in (False, True))
    reason = f"thesis slip: its theory is the shifted column of Table {source}"
    return [
        TableCell(cell.printed, float(without), reason)
        if abs(without - with_it) > SLIPPED and abs(cell.value - with_it) < abs(cell.value - without)
        else cell
        for cell, without, with_it in zip(cells, right, slipped, strict=True)
    ]
