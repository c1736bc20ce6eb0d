"""What a characterisation finds: points, figures of merit with their definitions, and how they are shown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts.own import RANGE_VOLTS
from palpate.instrument.errors import EstimateError
from palpate.instrument.quantity import counted, show, show_with_u
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.signals.noise import of_greatest
from palpate.instrument.uncertainty.budget import Budget, Component, Kind
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import new_table, stamped, taken, uncertainty_line
from palpate.procedures.steps.flags import reasons

if TYPE_CHECKING:
    from rich.table import Table


# --- Definitions of a sensor's figures of merit: the equation, and what the thesis says in chapter 2 ---
#
# V: peak-to-peak voltage of a film; F: load by the load cell, peak to peak; a + b F: least-squares line through the
# loads that increase; residual: what is left of the signal beside the sine, about a line through each cycle. The
# names of the two linearities are those of ISA-51.1.


@dataclass(frozen=True, slots=True)
class Definition:
    """Definition of a figure of merit.

    Attributes:
        unit: unit of the figure; "" for a ratio.
        equation: its equation.
        thesis: the thesis' section, and what it says if that differs or is no definition.
    """

    unit: str
    equation: str
    thesis: str


SNR, PEAK_SNR = "signal-to-noise ratio", "peak signal-to-noise ratio"
SENSITIVITY, RESOLUTION, SPATIAL_RESOLUTION = "force sensitivity", "resolution", "spatial resolution"
LINEARITY, ZERO_BASED_LINEARITY = "linearity", "zero-based linearity"
HYSTERESIS, DYNAMIC_RANGE, DRIFT = "hysteresis", "dynamic range", "drift"
SCALED = SENSITIVITY, RESOLUTION  # figures whose uncertainty is a share of them

DEFINITIONS = {
    SNR: Definition("dB", "20 lg(rms of the sine / rms of the residual)", "2.1.1, for random noise"),
    PEAK_SNR: Definition("dB", "20 lg(peak of the sine / greatest |residual|)", "2.1.1, peak over peak"),
    SENSITIVITY: Definition("V/N", "b = dV/dF", "2.1.2, 2.1.5"),
    RESOLUTION: Definition("N", "2 u(V) / b, u(V) by noise", "2.1.2 asks for 5 to 10 mN"),
    LINEARITY: Definition("", "max |V - a - b F| / (b (F_max - F_min))", "2.1.5, a straight line"),
    ZERO_BASED_LINEARITY: Definition(
        "", "max |V - c F| / (c F_max), c = sum(F V) / sum(F^2)", "2.1.5, proportional output"
    ),
    HYSTERESIS: Definition("", "max |(V - b F)_down - (V - b F)_up| / (b (F_max - F_min))", "2.1.6 asks for none"),
    DYNAMIC_RANGE: Definition("dB", "20 lg(greatest force / resolution)", "2.1, the name alone"),
    DRIFT: Definition("1/min", "slope of V / mean(V) over time, F held", "2.1.6, of temperature alone"),
    SPATIAL_RESOLUTION: Definition("m", "lesser side of the cell of one tooth", "2.1.3, size of a tactel"),
}

ELSEWHERE = (
    {"quantity": "frequency response", "thesis": "2.1.4", "command": "palpate sweep frequency"},
    {"quantity": "temperature variation", "thesis": "2.1.6", "command": "palpate sweep temperature"},
)
"""The properties of section 2.1 that other commands measure, under public names."""


# --- The points of a characterisation, and what those at one load tell together ------------------------

LEAST_LOADS = 3  # for a line with its scatter
LOADING, UNLOADING, HOLDING = "loading", "unloading", "holding"


@dataclass(frozen=True, slots=True)
class FilmsPoint:
    """All films under one load. Loads and voltages are peak to peak."""

    direction: Annotated[str, Column('"loading", "unloading" or "holding"')]
    time_s: Annotated[float, Column("time since the load is held; 0 before that", "s")]
    load_N: columns.AskedLoad
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    voltages_V: columns.Volts
    voltages_u: tuple[float, ...]
    noise_V: Annotated[tuple[float, ...], Column("rms of each film's noise", "V", u="noise_u")]
    noise_u: tuple[float, ...]
    noise_freedom: Annotated[float, Column("degrees of freedom of `noise_u`")]
    noise_peak_V: Annotated[tuple[float, ...], Column("greatest value of each film's noise", "V")]
    samples: Annotated[int, Column("number of samples in the record")]
    valid: columns.Valid
    flags: columns.Flags
    attempts: columns.Attempts = 1
    incidents: columns.Incidents = 0
    seconds: columns.LapSeconds = None


@dataclass(frozen=True, slots=True)
class Top:
    """A film in all records at the greatest load [V], and how uncertain that is, as `Sources` has it."""

    volts: float
    noise_V: float
    peak_V: float
    records: int
    samples: int
    amplitude: Component
    residual: Component
    greatest: Component


def at_top(points: Sequence[FilmsPoint], number: int) -> Top:
    """A film, by its number in the design, in all records at the greatest load."""
    volts, volts_u, noise, noise_u, peak = (
        np.array([getattr(p, name)[number] for p in points])
        for name in ("voltages_V", "voltages_u", "noise_V", "noise_u", "noise_peak_V")
    )
    count, samples = len(points), points[-1].samples
    amplitude_u = float(np.linalg.norm(volts_u) / volts.sum())
    residual_u = float(np.linalg.norm(noise * noise_u) / (noise @ noise))
    freedom = math.fsum(p.noise_freedom for p in points)
    return Top(
        volts=float(volts.mean()),
        noise_V=math.sqrt(float(np.mean(noise**2))),
        peak_V=float(peak.mean()),
        records=count,
        samples=samples,
        amplitude=Component("amplitude", amplitude_u, kind="A"),
        residual=Component("noise, as measured", residual_u, 1.0, freedom, "A"),
        greatest=Component("greatest of the noise", of_greatest(samples) / math.sqrt(count), kind="A"),
    )


def means(points: Sequence[FilmsPoint], number: int) -> dict[float, tuple[float, float]]:
    """Mean measured load [N] and mean voltage of a film [V], by the load that was asked for [N]."""
    found = {}
    for load in dict.fromkeys(p.load_N for p in points):
        at = [(p.load_measured_N, p.voltages_V[number]) for p in points if p.load_N == load]
        loads, volts = zip(*at, strict=True)
        found[load] = math.fsum(loads) / len(at), math.fsum(volts) / len(at)
    return found


# --- What makes each figure of merit of a film uncertain, whether it was measured or is expected -------

DECIBELS = 20 / math.log(10)  # of a relative change


@dataclass(frozen=True, slots=True)
class Sources:
    """What a film's figures of merit are uncertain by. Components are relative to what they are of, but for `scatter`.

    Attributes:
        line: the slope of the line through the loads.
        cell: the load cell's sensitivity.
        noise: noise of an amplitude, in the mean over the loads.
        amplitude, residual, greatest: amplitude at the greatest load, rms and greatest value of the residual there.
        scatter: voltage of one load set about the line.
        typical, top: root mean square of the voltages, and that at the greatest load, in the unit of `scatter`.
        span: rise of the line from the least to the greatest load, in the unit of `scatter`.
        rounds: how often each load was set on the way up; on the way down it is set once.
        drift: slope of the amplitude under a load that is held [1/min].
        by_converter: whether the converter ends the dynamic range. Then the slope is in both of its ends and cancels.
    """

    line: Component
    cell: Component
    noise: Component
    amplitude: Component
    residual: Component
    greatest: Component
    scatter: Component
    typical: float
    top: float
    span: float
    rounds: float
    drift: Component
    by_converter: bool = False


def components(of: Sources) -> dict[str, tuple[Component, ...]]:
    """The components of each figure of merit. `factor` makes them contributions in the figure's unit."""

    def part(name: str, sets: float, whole: float) -> Component:
        return replace(of.scatter, name=name, u=of.scatter.u * math.sqrt(sets) / whole)

    mean = 1 / of.rounds
    gain = part("gain of a load set", mean, of.typical)  # gains scatter by a share of the load
    slope = of.line, of.cell
    return {
        SNR: (of.amplitude, gain, of.residual),
        PEAK_SNR: (of.amplitude, gain, of.greatest),
        SENSITIVITY: slope,
        RESOLUTION: (*slope, of.noise),
        LINEARITY: (part("scatter of a load", mean, of.span),),
        ZERO_BASED_LINEARITY: (part("scatter of a load", mean, of.top),),
        HYSTERESIS: (part("scatter of two loads", mean + 1, of.span),),
        DYNAMIC_RANGE: (*(() if of.by_converter else slope), of.noise),
        DRIFT: (of.drift,),
    }


def factor(quantity: str, value: float) -> float:
    """What a component is multiplied with to be a contribution to a figure of some value."""
    if DEFINITIONS[quantity].unit == "dB":
        return DECIBELS
    return value if quantity in SCALED else 1.0


def cell_component(calibration: LoadCellCalibration) -> Component:
    """Relative uncertainty of a slope by the load cell's sensitivity."""
    freedom = float(calibration.degrees_of_freedom or math.inf)
    return Component("load cell", calibration.sensitivity_u / calibration.sensitivity_mV_per_N, 1.0, freedom)


def noise_component(scatter: float, records: int, samples: int) -> Component:
    """Noise of an amplitude, in the mean over several records.

    A film that still settles has more noise in one record than in another, and more than random noise would differ.

    Args:
        scatter: relative standard deviation of the noise of single records.
        records: number of records.
        samples: number of samples in all of them.
    """
    scattered, random = scatter / math.sqrt(records), 1 / math.sqrt(2 * samples)
    freedom = records - 1 if scattered > random else math.inf
    return Component("noise, as measured", max(scattered, random), 1.0, freedom, "A")


# --- the result ----------------------------------------------------------------------------------------

SEEN = 2.0  # standard uncertainties of the noise; a larger force counts as seen
LEAST_DRIFT_POINTS = 3


@dataclass(frozen=True, slots=True)
class Characteristic:
    """A figure of merit."""

    film: Annotated[str, Column('name of the film; "" for the whole sensor', head="film", cell="{0.owner}")]
    quantity: Annotated[str, Column("name of the figure", head="quantity")]
    value: Annotated[float, Column("its value", head="value", cell="{0.shown[0]}", u="u")]
    u: Annotated[float, Column(head="u", cell="{0.shown[1]}")]
    unit: Annotated[str, Column('their unit; "" for a ratio')]
    definition: Annotated[str, Column("its equation")]
    thesis: Annotated[str, Column("the thesis' section, and what that says", head="thesis")]
    how: Annotated[str, Column("what the definition leaves open: at which load, over how many points", head="how")]

    @property
    def owner(self) -> str:
        """What the figure is of, for a table."""
        return self.film or "sensor"

    @property
    def shown(self) -> tuple[str, str]:
        """The value and its uncertainty, for a table."""
        match self.unit:
            case "":
                return f"{100 * self.value:z.2f} %", f"{100 * self.u:z.2f} %"
            case "1/min":
                return f"{100 * self.value:+z.4f} %/min", f"{100 * self.u:z.4f} %/min"
            case "dB":
                return f"{self.value:z.1f} dB", f"{self.u:z.1f} dB"
        return show_with_u(self.value, self.u, self.unit)


@dataclass(frozen=True, slots=True)
class CharacteriseResult:
    """The result of a characterisation.

    Attributes:
        films: names of the films, in the design's order.
        points: the points.
        rows: the figures of merit, film by film, then of the sensor.
        budgets: uncertainty budget of each row.
        stopped: why a run that repeats its loads ended, for people; empty: it repeats none.
    """

    films: tuple[str, ...]
    points: list[FilmsPoint]
    rows: list[Characteristic]
    budgets: list[Budget]
    stopped: str = ""

    @property
    def achieved_u(self) -> float:
        """Greatest relative uncertainty of a force sensitivity, in a run that repeats its loads; else of a figure."""
        wanted = (SENSITIVITY,) if self.stopped else SCALED
        return max(row.u / abs(row.value) for row in self.rows if row.quantity in wanted)

    @property
    def sensitivities(self) -> list[tuple[str, float]]:
        """Each film and the half-width of the 95 % interval of its force sensitivity, relative."""
        each = zip(self.rows, self.budgets, strict=True)
        return [(row.film, of.expanded() / abs(of.value)) for row, of in each if row.quantity == SENSITIVITY]

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "films": list(self.films),
            **({"stopped": self.stopped} if self.stopped else {}),
            "rows": [asdict(row) for row in self.rows],
            "elsewhere": list(ELSEWHERE),
        }


Row = tuple[Characteristic, Budget]


def evaluate(
    points: Sequence[FilmsPoint],
    design: Design,
    calibration: LoadCellCalibration,
    dwell: float,
    force_limit: float,
    widest: float = max(RANGE_VOLTS),
    lines: Sequence[Component] = (),
) -> CharacteriseResult:
    """Find the figures of merit of every film and of the sensor.

    Args:
        points: the points, in the order in which they were measured.
        design: design of the sensor.
        calibration: calibration of the load cell.
        dwell: dwell of each point [s].
        force_limit: force limit of the bench [N].
        widest: widest input range of its sensor nodes [V].
        lines: relative uncertainty of each film's slope; empty: by the scatter about its line.

    Raises:
        EstimateError: too few points are valid for a line.
    """
    valid = [p for p in (*(p for p in points if p.direction != HOLDING), *_longest_hold(points)) if p.valid]
    going_up = {p.load_N for p in valid if p.direction == LOADING}
    held = sum(p.direction == HOLDING for p in valid)
    if len(going_up) < LEAST_LOADS or held < LEAST_DRIFT_POINTS:
        raise EstimateError(
            f"{counted(len(going_up), 'load')} up and {counted(held, 'point')} under the load that is held are valid,"
            f" and {LEAST_LOADS} and {LEAST_DRIFT_POINTS} are needed. {reasons(points)}"
        )
    found = [
        each
        for number, film in enumerate(design.films)
        for each in _film(film, number, valid, calibration, dwell, force_limit, widest, lines)
    ]
    pitch = min(design.cell)
    how = "by the design; palpate sweep position tells more"
    anywhere = Component("anywhere in the cell", pitch / math.sqrt(12))
    found.append(_characteristic("", SPATIAL_RESOLUTION, pitch, how, anywhere))
    rows, budgets = zip(*found, strict=True)
    return CharacteriseResult(tuple(film.name for film in design.films), list(points), list(rows), list(budgets))


def _longest_hold(points: Sequence[FilmsPoint]) -> list[FilmsPoint]:
    """The longest series of points at one load. After a failure the load was set anew, and another series begins."""
    stretches: list[list[FilmsPoint]] = [[]]
    for point in (p for p in points if p.direction == HOLDING):
        if point.incidents or point.attempts > 1:
            stretches.append([])
        stretches[-1].append(point)
    return max(stretches, key=len)


def _characteristic(film: str, quantity: str, value: float, how: str, *components: Component) -> Row:
    is_ = DEFINITIONS[quantity]
    budget = Budget(f"{quantity}, {film or 'sensor'}", float(value), is_.unit, components)
    return Characteristic(film, quantity, budget.value, budget.u, is_.unit, is_.equation, is_.thesis, how), budget


def _film(
    film: Film,
    number: int,
    points: Sequence[FilmsPoint],
    calibration: LoadCellCalibration,
    dwell: float,
    force_limit: float,
    widest: float,
    lines: Sequence[Component],
) -> list[Row]:
    ways = {way: [p for p in points if p.direction == way] for way in (LOADING, UNLOADING, HOLDING)}
    up, held = ways[LOADING], ways[HOLDING]
    going_up, going_down = means(up, number), means(ways[UNLOADING], number)
    loads, volts = (
        np.array(values) for values in zip(*((p.load_measured_N, p.voltages_V[number]) for p in up), strict=True)
    )
    noises = np.array([p.voltages_u[number] for p in up])
    noise_u = float(noises.mean())
    # The indicator's steps are in the loads, and over a short span they are most of what the slope may be off by.
    load_u = float(np.mean([p.load_measured_u for p in up]))
    reading_u = math.hypot(noise_u, load_u * float(volts.mean() / loads.mean()))
    line = interpolate(loads, volts, reading_u)
    slope = float(line.coefficients[1])
    proportional = float(loads @ volts / (loads @ loads))
    mean_loads, mean_volts = (np.array(values) for values in zip(*going_up.values(), strict=True))
    span, reach = slope * float(np.ptp(mean_loads)), proportional * float(mean_loads.max())
    resolution = SEEN * noise_u / slope
    converter = 2 * widest / slope
    largest, ends = (converter, "converter") if converter < force_limit else (force_limit, "bench's force limit")
    minutes = [p.time_s / 60 for p in held]
    amplitudes = np.array([p.voltages_V[number] for p in held])
    mean = float(amplitudes.mean())
    drift = interpolate(minutes, amplitudes / mean, held[0].voltages_u[number] / mean)
    by_scatter = Component("line", math.sqrt(line.covariance[1, 1]) / slope, 1.0, *_repeats(line))
    top = at_top([p for p in up if p.load_N == max(going_up)], number)

    of = components(Sources(
        line=lines[number] if lines else by_scatter,
        cell=cell_component(calibration),
        noise=noise_component(float(noises.std(ddof=1)) / noise_u, len(up), sum(p.samples for p in up)),
        amplitude=top.amplitude,
        residual=top.residual,
        greatest=top.greatest,
        scatter=Component("scatter", max(line.residual_sd, reading_u), 1.0, *_repeats(line)),
        typical=math.sqrt(float(np.mean(volts**2))),
        top=reach,
        span=span,
        rounds=len(up) / len(going_up),
        drift=Component("scatter about the line", math.sqrt(drift.covariance[1, 1]), 1.0, *_repeats(drift)),
        by_converter=largest == converter,
    ))  # fmt: skip

    def row(quantity: str, value: float, how: str) -> Row:
        parts = (replace(part, sensitivity=factor(quantity, value)) for part in of[quantity])
        return _characteristic(film.name, quantity, value, how, *parts)

    by_loads = f"{len(going_up)} loads, increasing{_rounds(len(up), len(going_up))}"
    where = f"at {max(going_up):g} N{_rounds(top.records, 1)}"
    bent, off = np.abs(mean_volts - line.reading(mean_loads)), np.abs(mean_volts - proportional * mean_loads)
    return [
        row(SNR, 20 * math.log10(top.volts / math.sqrt(8) / top.noise_V), where),
        row(PEAK_SNR, 20 * math.log10(top.volts / 2 / top.peak_V), f"{where}, of {top.samples} samples"),
        row(SENSITIVITY, slope, by_loads),
        row(RESOLUTION, resolution, f"in {dwell:g} s"),
        row(LINEARITY, float(bent.max()) / span, f"{by_loads}; gains scatter from load to load"),
        row(ZERO_BASED_LINEARITY, float(off.max()) / reach, "the same loads"),
        row(HYSTERESIS, _hysteresis(line, going_up, going_down) / span, "loads up, then down"),
        row(DYNAMIC_RANGE, 20 * math.log10(largest / resolution), f"to {show(largest, 'N', 3)}, the {ends}"),
        row(
            DRIFT, float(drift.coefficients[1]),
            f"over {held[-1].time_s - held[0].time_s:.0f} s at {held[-1].load_N:g} N",
        ),
    ]  # fmt: skip


def _rounds(sets: int, loads: int) -> str:
    return "" if sets <= loads else f", {sets} sets"


def _repeats(line: Interpolation) -> tuple[float, Kind]:
    """Degrees of freedom of a line's scatter, and the kind of that evaluation."""
    return (line.degrees_of_freedom if line.by_scatter else math.inf), "A"


def _hysteresis(
    line: Interpolation, up: Mapping[float, tuple[float, float]], down: Mapping[float, tuple[float, float]]
) -> float:
    """Greatest difference between loading and unloading at the same load [V]; 0 without a common load.

    The measured loads of both ways are not quite the same, so each voltage is taken relative to the line.
    """

    def beside(at: tuple[float, float]) -> float:
        return at[1] - float(line.reading(at[0]))

    return max((abs(beside(up[load]) - beside(down[load])) for load in up.keys() & down.keys()), default=0.0)


# --- what it shows -------------------------------------------------------------------------------------

MOST_NAMED = 6  # films that a legend has room for


def show_characteristics(result: CharacteriseResult, outcome: Outcome) -> list[object]:
    """Each figure of merit with its uncertainty and how it was measured, then the definitions."""
    table = table_of(
        stamped(outcome["simulated"], f"Sensor {outcome['design']}"), result.rows, columns_of(Characteristic)
    )
    for column in (0, 1, 4, 5):
        table.columns[column].justify = "left"
    table.columns[5].no_wrap = False
    below = []
    if result.stopped:
        sets = counted(sum(point.direction == LOADING for point in result.points), "load set")
        half = max(half for _, half in result.sensitivities)
        below = [
            uncertainty_line("a force sensitivity", half, result.achieved_u, outcome["predicted_u"]),
            f"stopped        {result.stopped}; {sets} up, {taken(outcome)}",
        ]
    return [table, _definitions(result), *below]


def _definitions(result: CharacteriseResult) -> Table:
    """A table with the equation of each quantity, or the command that measures it."""
    table = new_table(None, "quantity", "definition")
    table.caption = "V, F: voltage and load, peak to peak; a + b F: least-squares line; u(V): standard uncertainty"
    table.caption_justify = "left"
    for column in table.columns:
        column.justify = "left"
    for quantity, equation in {row.quantity: row.definition for row in result.rows}.items():
        table.add_row(quantity, equation)
    for each in ELSEWHERE:
        table.add_row(each["quantity"], f"thesis {each['thesis']}: {each['command']}")
    return table


def plot_characteristics(result: CharacteriseResult, simulated: bool, folder: Path) -> Path:
    """Plot voltages over the load, both ways, and over time under one load. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, "films under load, and while it is held")
    for number, film in enumerate(result.films):
        color = f"C{number}"
        for direction, marker in ((LOADING, "^"), (UNLOADING, "v")):
            points = [p for p in result.points if p.direction == direction]
            (load, load_u), (volts, u) = with_u(points, "load_measured_N"), with_u(points, "voltages_V", 1e3, number)
            left.errorbar(
                load, volts, u, load_u, fmt=marker, color=color, ms=4, lw=1, capsize=2, label=f"{film}, {direction}",
            )  # fmt: skip
        held = [p for p in result.points if p.direction == HOLDING]
        first = held[0].voltages_V[number]
        volts, u = with_u(held, "voltages_V", 100 / first, number)
        right.errorbar(
            [p.time_s for p in held], [value - 100 for value in volts], u, fmt=f"{MARKERS[number % len(MARKERS)]}-",
            color=color, ms=4, lw=1, capsize=2, label=film,
        )  # fmt: skip
    left.set(xlabel="load, peak to peak (N)", ylabel="voltage, peak to peak (mV; bars: u)", yscale="log")
    right.set(xlabel="time (s)", ylabel="change of the amplitude (%; bars: u)")
    if len(result.films) <= MOST_NAMED:
        name_all(left, 2)
        name_all(right)
    return save(figure, folder)
