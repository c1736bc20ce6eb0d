"""What a softness test finds: Young moduli, the objects from hard to soft, and how they are shown."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.findings.mean_ratio import CALIBRATION, apart, mean_ratio
from palpate.instrument.findings.object_modulus import COVERAGE, ByReferences, answering, estimate, validation_of
from palpate.instrument.models.price_list import stored
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import LAST, Column, columns_of
from palpate.procedures.showing import moduli
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, plot_over_loads, save
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import MARKS, legend, stamped
from palpate.procedures.steps.flags import CLIPPED

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# --- The points and the result of a softness test: Young moduli, and the objects from hard to soft -----

MOST_SETS = 100  # of an object
OBJECT = Column("name of the object", head="object")


@dataclass(frozen=True, slots=True)
class SoftnessPoint:
    """One load on one object. Loads are peak to peak."""

    object: Annotated[str, OBJECT]
    load_N: columns.AskedLoad
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    noise_u: columns.NoiseU
    valid: columns.Valid
    flags: columns.Flags
    calibration_u: columns.CalibrationU = 0.0
    pickup_u: columns.PickupU = 0.0
    degrees_of_freedom: Annotated[float | None, columns.FREEDOM] = None


@dataclass(frozen=True, slots=True)
class Softness:
    """What is found of one object. Without a valid point it has neither ratio nor modulus."""

    object: Annotated[str, OBJECT]
    valid_points: Annotated[int, Column("number of valid points", head="valid", after=LAST)]
    saturated: Annotated[bool, Column("whether a film was saturated at one of the loads")]
    force_ratio: Annotated[
        float | None, Column("mean over the valid points", "", "force ratio", "z.4g", u="force_ratio_u")
    ] = None
    force_ratio_u: Annotated[float | None, Column(head="u", cell="z.4g")] = None
    modulus_Pa: Annotated[float | None, Column("Young modulus by the model; null: only a bound is known", "Pa")] = None
    scale_u: Annotated[
        float | None, Column("its relative standard uncertainty on the model's curve; null: only a bound is known")
    ] = None
    scale_low_Pa: Annotated[float | None, Column("low end of that coverage interval; null: there is none", "Pa")] = None
    scale_high_Pa: Annotated[float | None, Column("high end of it; null: there is none", "Pa")] = None
    absolute_u: Annotated[float | None, Column("the same as `scale_u`, with the model's validation error")] = None
    absolute_low_Pa: Annotated[float | None, Column("the same as `scale_low_Pa`, with it", "Pa")] = None
    absolute_high_Pa: Annotated[float | None, Column("the same as `scale_high_Pa`, with it", "Pa")] = None
    absolute_kind: Annotated[
        str | None,
        Column("what the absolute ends say, as `kind`; null: the validation error is not known, so neither are they"),
    ] = None
    sensitivity: Annotated[float | None, Column("relative change of the modulus over that of the ratio")] = None
    kind: Annotated[
        str | None, Column('"interval", "at least", "at most" or "any": what the ends on the scale say')
    ] = None
    note: Annotated[str, Column("why there is only a bound")] = ""
    model_error: Annotated[float | None, Column("the model's error, as a ratio; null: it is not known")] = None
    curve_error: Annotated[
        float,
        Column(
            "what the intervals allow for the error of the model's curve, as a ratio: its discretisation, and"
            " `model_error` where it is known"
        ),
    ] = 0.0


@dataclass(frozen=True, slots=True)
class NotTold:
    """Two objects whose order is not known to the risk.

    `sets` and `seconds` tell them apart with 95 % probability, in a run of these two; null: no number of sets does.
    """

    objects: Annotated[tuple[str, str], Column("their names, the one with the larger ratio first")]
    sets: Annotated[int | None, Column("load sets of each")]
    seconds: Annotated[float | None, Column("bench time", "s")]


@dataclass(frozen=True, slots=True)
class Ranked:
    """What a run told of the order.

    Attributes:
        risk: greatest risk of a wrong pair in the order that was asked for.
        achieved_risk: risk to which all pairs are known that are not in `not_told`; None: no pair is.
        sets: number of valid load sets of each object.
        not_told: the other pairs.
        scatter: relative standard deviation of the ratio from set to set, by what was known before and by this run.
    """

    risk: float
    achieved_risk: float | None
    sets: Mapping[str, int]
    not_told: tuple[NotTold, ...]
    scatter: float

    def summary(self) -> dict[str, Any]:
        """The values under the names of JSON."""
        left = [{"objects": list(each.objects), "sets": each.sets, "seconds": each.seconds} for each in self.not_told]
        return {
            "risk": self.risk,
            "achieved_risk": self.achieved_risk,
            "sets": dict(self.sets),
            "not_told": left,
            "set_scatter": self.scatter,
        }


@dataclass(frozen=True, slots=True)
class SoftnessResult:
    """The result of a softness test.

    Attributes:
        points: the points.
        objects: what is found of each object.
        softness_order: names of the objects with a valid point, from hard to soft.
        alike: neighbours in this order that may be exchanged: their ratios do not differ with 95 % confidence.
        model: name of the model that turned ratios into moduli.
        price: what is known of the model's own error, in a sentence.
        validation: the model's validation error.
        budgets: uncertainty budget of each mean ratio and of each modulus that is known, on the model's scale and,
            where the validation error is known, absolute. A modulus has a linear budget; its intervals are found
            without that approximation.
        ranked: what the sets told of the order to a risk of error, and `alike` are then the pairs that they did not
            tell; None: none was asked for.
    """

    points: list[SoftnessPoint]
    objects: list[Softness]
    softness_order: list[str]
    alike: list[tuple[str, str]]
    model: str
    price: str
    validation: ValidationLine
    budgets: list[Budget]
    ranked: Ranked | None = None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "objects": [asdict(each) for each in self.objects],
            "softness_order": self.softness_order,
            "alike": [list(pair) for pair in self.alike],
            **({} if self.ranked is None else self.ranked.summary()),
            "coverage": COVERAGE,
            "answered_by": self.model,
            "price": self.price,
            "validation_line": self.validation.summary(),
        }


def evaluate(
    points: Sequence[SoftnessPoint],
    design: Design,
    question: RatioQuestion,
    calibration: ModelCalibration | None = None,
    same_films: bool = False,
) -> SoftnessResult:
    """Find moduli from the mean ratios over the valid points, and the order of the objects.

    Args:
        points: the points.
        design: the sensor.
        question: names the model that turns a ratio into a modulus, and the thickness of the objects.
        calibration: the model's calibration by references; None: there is none.
        same_films: whether the references were measured with the films' calibration of the points.
    """
    means: dict[str, Budget] = {}
    found: dict[str, Softness] = {}
    for name in dict.fromkeys(point.object for point in points):
        own = [point for point in points if point.object == name]
        valid = [point for point in own if point.valid]
        found[name] = Softness(name, len(valid), any(CLIPPED in point.flags for point in own))
        if valid:
            means[name] = mean_ratio(f"force ratio of {name}", valid, design.film_freedom)
    model, references = answering(question), None
    if means:
        if calibration is not None:
            shared = [_films(mean) if same_films else 0.0 for mean in means.values()]
            references = ByReferences(calibration, same_films, shared)
        ratios, uncertainties, freedom = zip(
            *((mean.value, mean.u, mean.degrees_of_freedom) for mean in means.values()), strict=True
        )
        rows = estimate(question, ratios, uncertainties, freedom, references)
        for name, row in zip(means, rows, strict=True):
            del row["model"]
            found[name] = Softness(name, found[name].valid_points, found[name].saturated, **row)
    order = sorted(means, key=lambda name: means[name].value, reverse=True)
    alike = [pair for pair in itertools.pairwise(order) if not apart(means[pair[0]], means[pair[1]])]
    line = validation_of(question, model, references)
    cancelled = CALIBRATION if calibration is not None and same_films else ""
    budgets = [budget for name, mean in means.items() for budget in _budgets(found[name], mean, line, cancelled)]
    price = price_of(design, model)
    return SoftnessResult(list(points), list(found.values()), order, alike, model, price, line, budgets)


def _films(mean: Budget) -> float:
    """Part of a mean ratio's uncertainty by the films' calibration."""
    return math.fsum(part.u for part in mean.components if part.name == CALIBRATION)


def _budgets(each: Softness, mean: Budget, line: ValidationLine, cancelled: str = "") -> Iterator[Budget]:
    """The budget of the mean ratio, and those of the modulus if it is known. The latter contain the model's error.

    `cancelled` names the component that object and references share, which the absolute budget leaves out.
    """
    yield mean
    if each.modulus_Pa is None or each.sensitivity is None:
        return
    slope = each.sensitivity * each.modulus_Pa / mean.value
    # The error of the curve is a bound: a rectangle of that half width.
    model = Component("model", each.curve_error / math.sqrt(3), slope)
    parts = tuple(replace(part, sensitivity=slope) for part in mean.components)
    yield Budget(f"modulus of {each.object}, scale", each.modulus_Pa, "Pa", (*parts, model))
    if line.u is not None:
        error = Component("validation", line.u, each.sensitivity * each.modulus_Pa, line.degrees_of_freedom)
        own = [part for part in parts if part.name != cancelled]
        yield Budget(f"modulus of {each.object}, absolute", each.modulus_Pa, "Pa", (*own, model, error))


def price_of(design: Design, model: str) -> str:
    """A sentence with the model's error for this design, from the price list."""
    known = [
        (max(bounds), price)
        for price in stored().prices
        if price.design == design.name and price.model == model and (bounds := price.bounds(slice(None)))
    ]
    if not known:
        return f"model {model!r} has no price for design {design.name!r}: its own error is not known"
    error, price = min(known, key=lambda each: each[0])
    return f"model {model!r} ({price.refinement}): error of the ratio at most {error:.1e} by the price list"


# --- what it shows -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Look:
    """Colour and width of an interval's bar."""

    color: str
    width: float


ABSOLUTE, SCALE = Look("0.75", 7.0), Look("C0", 1.5)


def show_softness(result: SoftnessResult, outcome: Outcome) -> list[object]:
    """Ratio and modulus of each object, on the model's scale and absolute, their order, and the model's error."""
    note = Column(head="note", cell=partial(_note, result.points), after=LAST)
    columns = columns_of(Softness) | moduli.COLUMNS | {"note": note}
    table = table_of(stamped(outcome["simulated"], f"Softness, by model {result.model!r}"), result.objects, columns)
    alike = ", ".join(f"{one} and {other}" for one, other in result.alike)
    return [
        table,
        *legend(table, marks={**MARKS, "any": "every modulus agrees with the ratio"}),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}",
        *([f"cannot be told apart at 95 %: {alike}"] if alike and result.ranked is None else []),
        *([] if result.ranked is None else [*ranked_lines(result.ranked), _seconds(outcome)]),
        moduli.absolute_line(result.validation),
        *moduli.bound_line(each.modulus_Pa is not None for each in result.objects if each.valid_points),
        f"price          {result.price}",
    ]


def _note(points: Sequence[SoftnessPoint], each: Softness) -> str:
    """What to know about what is found of an object."""
    flags = dict.fromkeys(f for p in points if p.object == each.object and not p.valid for f in p.flags)
    notes = [
        *([f"not used: {' '.join(flags)}"] if flags else []),
        *(["a film is saturated: take a smaller load"] if each.saturated else []),
        *([each.note] * bool(each.note)),
    ]
    return "; ".join(notes)


def ranked_lines(ranked: Ranked) -> list[str]:
    """What a run told of the order, for people."""
    asked = f"{100 * ranked.risk:.3g} %"
    sets = ", ".join(f"{name}: {number}" for name, number in ranked.sets.items())
    reached = None if ranked.achieved_risk is None else f"{100 * ranked.achieved_risk:.2g} %"
    known = "the order is" if not ranked.not_told else "the other pairs are"
    told = "no pair is known to that risk" if reached is None else f"{known} known to a risk of {reached}"
    lines = [
        f"risk           {asked} of a wrong pair was asked for; {told}",
        f"sets           {sets}; from set to set the ratio scatters by {100 * ranked.scatter:.2g} %",
    ]
    for each in ranked.not_told:
        told = " and ".join(each.objects)
        if each.sets is None or each.seconds is None or each.sets > MOST_SETS:
            lines.append(f"not told       {told}: no {MOST_SETS} sets would tell them apart")
        else:
            names = ",".join(each.objects)
            lines.append(
                f"not told       {told}: {counted(each.sets, 'set')} of each would, in {duration(each.seconds)}: the"
                f" same command for {names} with --sets {each.sets}"
            )
    return [
        *lines,
        "note           each object is mounted once; what mountings scatter is not known and counts as none",
    ]


def _seconds(outcome: Outcome) -> str:
    """A line with the bench time that was predicted and taken."""
    predicted, achieved = outcome["predicted_seconds"], outcome["achieved_seconds"]
    times = [("predicted", predicted), ("taken", achieved)]
    return "bench time     " + ", ".join(f"{s:z.0f} s {name}" for name, s in times if s is not None)


def plot_softness(result: SoftnessResult, simulated: bool, folder: Path) -> Path:
    """Plot ratios over loads, and the moduli with their intervals. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"softness by model {result.model}")
    for place, each in enumerate(result.objects):
        points = [p for p in result.points if p.object == each.object]
        plot_over_loads(left, place, each.object, points)
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)")
    name_all(left, 6, title="object")
    known = [each for each in result.objects if each.scale_low_Pa or each.scale_high_Pa]
    for place, each in enumerate(known):
        if each.absolute_low_Pa or each.absolute_high_Pa:
            _bar(right, place, each.absolute_low_Pa, each.modulus_Pa, each.absolute_high_Pa, ABSOLUTE)
        _bar(right, place, each.scale_low_Pa, each.modulus_Pa, each.scale_high_Pa, SCALE)
    told = "thick absolute, thin scale" if result.validation.u is not None else "scale; absolute not known"
    right.set(xlabel=f"modulus (kPa; 95 %: {told}; arrows: bounds)", ylabel="object")
    right.set(yticks=range(len(known)), yticklabels=[e.object for e in known])
    right.set_xscale("log")
    logarithmic(right, *right.get_xlim())
    return save(figure, folder)


def _bar(axes: Axes, place: int, low: float | None, middle: float | None, high: float | None, look: Look) -> None:
    """Draw an interval of moduli [Pa] in kPa; an arrow at its end says that there is no bound on the other side."""
    ends = [1e-3 * end for end in (low, middle, high) if end]
    axes.plot(ends, [place] * len(ends), "-", color=look.color, lw=look.width, solid_capstyle="butt")
    for end, marker in ((low, "|" if high else ">"), (middle, "o"), (high, "|" if low else "<")):
        if end:
            axes.plot(1e-3 * end, place, marker, color=look.color)
