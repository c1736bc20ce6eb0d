"""Tables A2.9 to A2.20 and 5.5 to 5.7: the thesis' sweeps beside sweeps of the simulated bench."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from palpate.instrument.findings.film_forces import apart
from palpate.instrument.models.evidence import Evidence, EvidencePart, of_experiment
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, TableCell, ThesisTable, read_table
from palpate.procedures.measurements.loads.result import LoadPoint, SweepResult
from palpate.procedures.reproduce.chapter5.columns import (
    FORCES,
    LOAD_BETWEEN,
    LOAD_OFFSET,
    LOAD_WITHIN,
    METER,
    METER_U,
    RATIO,
    SCOPE,
    Quantity,
    between_samples,
    load_told,
    quantities,
)
from palpate.procedures.reproduce.chapter5.traces import Traces, traces_said
from palpate.procedures.reproduce.judging.rows import WITHIN, Row, RowCorrelation, RowTable

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


def compare(arrangement: Arrangement, swept: SweepResult, traces: Traces, ratio: EvidencePart) -> Iterator[RowTable]:
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
    said = traces_said(design, {key: traces[point.sample, point.load_N] for key, point in points.items()})
    yield replace(found, rows=(*found.rows, *means), sentences=(order, *found.sentences, said))


def _at(swept: SweepResult, sample: str, load: float) -> LoadPoint:
    return next(p for p in swept.points if p.sample == sample and p.load_N == load)


def _table(
    arrangement: Arrangement, number: str, points: Mapping[str, LoadPoint], traces: Traces, ratio: EvidencePart
) -> RowTable:
    """Cells of every row beside the point with that key."""
    table, design = read_table(number), get_design(arrangement.design)
    told = load_told(table, [point.load_N for point in points.values()])
    of_one_sample = number in arrangement.tables.values()
    rows = [
        _row(table, key, quantity, point, arrangement, ratio, told, of_one_sample)
        for key, point in points.items()
        for quantity in quantities(design, traces, arrangement.tables.values())
        if quantity.column in table.columns
    ]
    off = abs(told - 1) > WITHIN * math.hypot(LOAD_OFFSET, LOAD_BETWEEN)
    said = (
        f"the thesis' own base films tell of {told:.3f} times the set load in the mean, more than its loads scatter."
        " All its forces and voltages are off by that factor, its ratios are not; the test for a bias divides by it",
    )
    again = bool(arrangement.tables) and not of_one_sample
    return RowTable(number, table.title, table.doubt, tuple(rows), said if off else (), design.name, again=again)


def _row(
    table: ThesisTable,
    key: str,
    quantity: Quantity,
    point: LoadPoint,
    arrangement: Arrangement,
    ratio: EvidencePart,
    told: float,
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
        at_load = cell.value / told
        kind = SCOPE if quantity.column == SCOPE else FORCES
        group = RowCorrelation(kind, math.hypot(varies * at_load, own * ours), common * at_load, told)
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
