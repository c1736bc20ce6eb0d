"""Columns of the thesis' tables of experiments: our value of each from a point, and the scatter of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

import numpy as np

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.instrument.signals.oscilloscope import ScopeReading
from palpate.instrument.thesis import ThesisTable, read_table
from palpate.procedures.measurements.loads.result import LoadPoint
from palpate.procedures.reproduce.chapter5.traces import Traces

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


def load_told(table: ThesisTable, set_loads: Iterable[float]) -> float:
    """Load by the thesis' own base films over the set load, in the mean over a table."""
    bases = [column for column in table.columns if "total" in column and column.endswith("_N")]
    told = sum(table.values(column) for column in bases)
    return float(np.mean(told / np.array(list(set_loads))))


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
