"""Calibration of a sensor model by references: each is mounted, and its force ratio is measured over load sets."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from palpate.drivers.roles import SensorNode
from palpate.instrument.calibration.model_calibration import expected_u
from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.models.curve import RatioCurve, ratio_curve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import validate
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import Plan
from palpate.procedures.engine.procedure import Finished, Procedure, Report
from palpate.procedures.engine.promise import Expected, predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import check_nameable, keep
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import CalibrationKeys
from palpate.procedures.measurements.load_cell.procedure import LONGEST_VALIDITY
from palpate.procedures.measurements.prospects import expected_mean
from palpate.procedures.measurements.references.result import (
    MODULUS,
    Reference,
    ReferencesResult,
    check_range,
    evaluate,
    read_reference,
)
from palpate.procedures.measurements.settings import DwellTime, Frequency, LoadSets, ValidDays, model_name
from palpate.procedures.measurements.softness.procedure import SLOW, SoftnessTest, Touching, TouchStep
from palpate.procedures.measurements.softness.result import SoftnessPoint
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.dwells import Dwells

# --- What references are expected to give: the uncertainty of a model's constant, as its budget has it -
#
# The ratios are those of the model for the references' moduli, which need not be true: the constant is unknown
# before. Objects are expected to spread about it as the thesis' samples do [M]; where that is not known, no spread is
# expected.


def expected_constant(
    design: Design,
    references: Sequence[Reference],
    question: RatioQuestion,
    curve: RatioCurve,
    loads: Sequence[float],
    dwell: float,
) -> list[Expected]:
    """Relative uncertainty of each reference's mean ratio, and that of the factor between curve and real ratios.

    Args:
        design: design of the sensor.
        references: the references.
        question: names the model and its parameter set.
        curve: the model's curve.
        loads: load of each load set, peak to peak [N].
        dwell: dwell of each [s].
    """
    means, ratios, own = [], [], []
    for each in references:
        ratio = float(curve.force_ratio(each.modulus))
        mean = expected_mean(f"force ratio of {each.name}", design, ratio, loads, [dwell] * len(loads))
        shared = ratio * math.hypot(calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio))
        means.append(Expected.of(mean))
        ratios.append(ratio)
        own.append(math.sqrt(mean.u**2 - shared**2) / ratio)
    spread = validate(question.design, question.parameters, curve.model).ln_spread or 0.0
    weights = [
        1 / (spread**2 + u**2 + (each.u / check_range(each, curve)) ** 2)
        for u, each in zip(own, references, strict=True)
    ]
    pickup = math.fsum(pickup_u(design) * math.hypot(1.0, 1 / ratio) for ratio in ratios) / len(ratios)
    constant = math.hypot(1 / math.sqrt(math.fsum(weights)), calibration_u(design), pickup)
    return [*means, Expected(f"constant of model {curve.model}", constant, "ln")]


# --- the procedure -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ReferenceSeries(Procedure[TouchStep, SoftnessPoint, ReferencesResult]):
    """Calibrate a sensor model by references: the constant between its curve and real force ratios, and its spread."""

    name = "calibrate-model"
    point = SoftnessPoint
    calibrates = True

    references: tuple[
        Annotated[
            Reference,
            Setting(
                help="Object of known modulus ± the half-width of its 95 % interval, or 'NAME: RUN' of palpate test"
                " modulus; repeatable.",
                read=read_reference,
                option="--reference",
                metavar="'NAME: MODULUS ± U'",
                repeated=True,
            ),
        ],
        ...,
    ]
    loads: LoadSets = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    model: Annotated[str, model_name("Sensor model that is calibrated.")] = "auto"
    parameters: Annotated[str, Setting(help="Its parameter set: thesis, physical, identified or capped.")] = "physical"
    thickness: Annotated[float, Setting("m", "Thickness of the references.")] = 3e-3
    valid_days: ValidDays = 365

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: there is no reference, one is given twice, has another thickness, is outside the range of the
                model, or comes from a simulated bench and this one is real, or the other way round; the validity is
                outside its limits; or what `SoftnessTest.check` refuses.
            UnknownName: there is no such model or parameter set.
        """
        if not self.references:
            raise RangeError("no reference is given; give at least one")
        for number, each in enumerate(self.references):
            for other in self.references[:number]:
                if each.name == other.name or (each.digest and each.digest == other.digest):
                    names = f"references {other.name!r} and {each.name!r}" if each.name != other.name else ""
                    raise RangeError(
                        f"{names or f'reference {each.name!r}'}: the same is given twice, which would count it double;"
                        " give each once"
                    )
            if target.model is not None and each.simulated is False:
                raise RangeError(
                    f"reference {each.name!r} was measured on hardware, and this bench is simulated; give one that a"
                    " simulated bench measured, or state its modulus"
                )
            if (own := each.object(self.thickness).thickness) != self.thickness:
                raise RangeError(
                    f"reference {each.name!r} is rubber sample {each.sample!r} of {show(own, 'm')}, not of"
                    f" {show(self.thickness, 'm')}; leave --thickness out, or give another object another name"
                )
        if not 1 <= self.valid_days <= LONGEST_VALIDITY:
            raise RangeError(f"validity of {self.valid_days} days is outside 1 to {LONGEST_VALIDITY}; give one inside")
        question = self._question(target.design)
        if self.model not in SLOW:
            curve = _curve(question)
            for each in self.references:
                check_range(each, curve)
        self._touches(target.design).check(target)

    def dwells(self) -> Dwells:
        objects = tuple(each.object(self.thickness) for each in self.references)
        return Dwells(objects, (min(self.loads), max(self.loads)), self.frequency, self.dwell)

    def plan(self, target: Target) -> Plan[TouchStep]:
        """All points: every load on every reference; predicted is the uncertainty of a modulus by the calibration."""
        steps = self._touches(target.design).plan(target).steps
        if self.model in SLOW:
            return Plan(self.name, steps)
        question = self._question(target.design)
        found = expected_constant(target.design, self.references, question, _curve(question), self.loads, self.dwell)
        u = self._predicted_u(target.design)
        moduli = [] if u is None else [Expected(MODULUS, u)]
        return Plan(self.name, steps, predicted(steps, [*found, *moduli], u))

    def _predicted_u(self, design: Design) -> float | None:
        """None: the thesis tells no spread, or the curve takes long."""
        if self.model in SLOW:
            return None
        question = self._question(design)
        curve = _curve(question)
        sensitivities = [check_range(each, curve) for each in self.references]
        moduli = [each.u / slope for each, slope in zip(self.references, sensitivities, strict=True)]
        known = validate(design.name, self.parameters, curve.model)
        ratio_u = expected_u(known, moduli, design.ratio_scatter / math.sqrt(len(self.loads)))
        return None if ratio_u is None else statistics.median(sensitivities) * ratio_u

    def begin(self, plan: Plan[TouchStep], lab: Lab, record: Recorder) -> Touching:
        check_nameable(lab.bench, "sensor_node")
        for each in self.references:
            if each.simulated is True and not lab.bench.simulated:
                raise ConfigError(
                    f"reference {each.name!r} was measured on a simulated bench, and this one is real; measure it here:"
                    " palpate test modulus"
                )
            if each.simulated and each.scene != lab.scene:
                raise ConfigError(
                    f"reference {each.name!r} was measured on the simulated bench of scene {each.scene or 'unknown'},"
                    f" and this one is of scene {lab.scene or 'unknown'}; measure it here: palpate"
                    " test modulus"
                )
        return Touching(lab, record, self._touches(lab.design))

    def evaluate(self, points: Sequence[SoftnessPoint], plan: Plan[TouchStep], lab: Lab) -> ReferencesResult:
        question = self._question(lab.design)
        origin = {
            "thickness_m": self.thickness,
            "film_calibration": lab.film_hash,
            **lab.origin(SensorNode, self.valid_days),
        }
        return evaluate(points, self.references, lab.design, question, _curve(question), origin)

    def save_calibration(self, done: Finished[ReferencesResult]) -> CalibrationKeys:
        path = keep(done.result.calibration, done.folder, done.replayed)
        return {"model_calibration_file": str(path)}

    def _question(self, design: Design) -> RatioQuestion:
        return RatioQuestion(design.name, self.model, self.parameters, {"sensed_thickness": self.thickness})

    def _touches(self, design: Design) -> SoftnessTest:
        """The softness test of the references, which is how they are measured."""
        objects = tuple(each.object(self.thickness) for each in self.references)
        return SoftnessTest(objects, self.loads, self.dwell, self.frequency, self.model)

    def report(self, result: ReferencesResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.references.report import plot_references, show_references

        curve = _curve(self._question(lab.design))
        return Report(partial(show_references, result, lab.films), partial(plot_references, result, curve))


def _curve(question: RatioQuestion) -> RatioCurve:
    sensor = question.sensor()
    return ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model)
