"""References are measured, calibrate a model, and later runs of the same sensor use and name the calibration."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
import scipy

from palpate import (
    EstimateError,
    RangeError,
    Reference,
    ReferenceSeries,
    Run,
    SoftnessTest,
    UsageError,
    get_design,
    get_sample,
    read_calibration,
    read_reference,
)
from palpate.extend import ModelCalibration, Target, read_scene
from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.errors import QuantityError
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.response import RatioQuestion
from palpate.procedures.lab.calibrations import path_of, probable_references
from palpate.procedures.measurements import softness
from palpate.procedures.measurements.references import MODULUS, ReferencesResult, evaluate
from palpate.procedures.measurements.softness import SoftnessPoint
from tests.procedures.conftest import Palpate

QUICK = ("--loads", "2 N, 3 N", "--dwell", "0.2 s")
CALIBRATE = ("calibrate", "model", "--reference", "A: 30 kPa ± 2 %", "--reference", "B: 90 kPa +- 3 kPa", *QUICK)
SOFTNESS = ("softness", "--samples", "1", "--model", "auto", *QUICK, "--json")
REAL = Target(get_design("single"), 10.0, nodes=1)


@pytest.mark.slow
def test_a_softness_test_uses_and_names_the_calibration_of_its_model(palpate: Palpate) -> None:
    made = palpate(*CALIBRATE, "--json", "--budget").object
    path = Path(made["model_calibration_file"])
    found = read_calibration(path, ModelCalibration)
    assert (found.simulated, found.model, found.scene) == (True, "surface", read_scene("thesis_single").identity)
    assert [(each.name, each.modulus_Pa, each.source) for each in found.references] == [
        ("A", 30e3, "stated"), ("B", 90e3, "stated"),
    ]  # fmt: skip
    assert found.references[1].modulus_u == pytest.approx(1 / 30 / 1.959964)
    assert [each["references"] for each in made["worth"]] == [2, 3, None]
    assert made["worth"][0]["modulus_u"] > made["worth"][1]["modulus_u"] > made["worth"][2]["modulus_u"]
    assert made["achieved_u"] == made["worth"][0]["modulus_u"] == pytest.approx(made["predicted_u"], rel=0.4)
    assert made["achieved_results"][-1] == {"name": MODULUS, "u": made["achieved_u"], "unit": "relative"}
    constant = made["budgets"][-1]
    assert constant["value"] == made["constant"] == pytest.approx(0.24, abs=0.1)

    foreseen = palpate(*SOFTNESS, "--dry-run").object
    after = palpate(*SOFTNESS).object
    assert foreseen["predicted_results"] == after["predicted_results"]
    (each,) = after["objects"]
    line = after["validation_line"]
    assert (line["constant"], line["u"]) == (found.constant, found.line(same_films=True).u)
    assert found.source in line["source"]
    assert each["absolute_low_Pa"] < 112.6e3 < each["absolute_high_Pa"]
    assert each["scale_u"] < each["absolute_u"] < 0.3
    assert after["calibration_files"]["model"] == found.about()
    header = Run.open(Path(after["run"])).header
    assert header["model_calibration"] == json.loads(found.model_dump_json())

    (asked,) = palpate(
        "model", "modulus", "--force-ratio", "0.31", "--calibration", str(path), "--json"
    ).object["points"]  # fmt: skip
    assert asked["absolute_low_Pa"] < 112.6e3 < asked["absolute_high_Pa"]

    write_calibration(path, found.model_copy(update={"expires": "2024-02-29"}))
    said = palpate(*SOFTNESS)
    assert said.status == 2
    assert (
        f"{path}: was made on a simulated bench with device 20260101 (single, surface, physical, 3 mm)"
        in said.complaint
    )
    assert "expired on 2024-02-29; run palpate calibrate model, or delete it" in said.complaint


@pytest.mark.slow
def test_a_run_that_tested_the_modulus_is_a_reference(palpate: Palpate) -> None:
    tested = palpate("test", "modulus", "--sample", "4", "--json").object
    name = Path(tested["run"]).name
    found = read_reference(f"A: runs/{name}")
    assert (found.modulus, found.sample, found.simulated) == (tested["tangent_modulus_Pa"], "4", True)
    assert found.u >= tested["tangent_modulus_u"] / tested["tangent_modulus_Pa"]
    made = palpate("calibrate", "model", "--reference", f"A: {name}", *QUICK, "--json").object
    assert made["references"][0]["source"] == f"{name}, digest {Run.open(Path(tested['run'])).digest()[:12]}"
    shutil.copytree(tested["run"], "copy")
    twice = ("--reference", f"A: {name}", "--reference", "B: copy")
    assert "references 'A' and 'B': the same is given twice" in palpate("calibrate", "model", *twice).complaint
    with pytest.raises(UsageError, match="is a run of calibrate-model, which tells no modulus"):
        read_reference(f"A: {made['run']}")


@pytest.mark.slow
def test_people_are_told_what_the_calibration_is_worth(palpate: Palpate) -> None:
    said = palpate("calibrate", "model", "--reference", "A: 48 kPa ± 2 %", *QUICK).out
    assert [
        text
        for text in (
            "SIMULATED Calibration of model 'surface' (physical set, single)",
            "spread         5.3 % of the ratio (5 degrees of freedom): spread of the thesis' 5.3 %",
            "modulus        by 1 reference u ",
            "another        u ",
            "films          not calibrated; what their sensitivities are off by is the same",
        )
        if text not in said
    ] == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("A",), "'A' is no reference; write for example 'A: 48 kPa ± 4 %', or 'A: runs/NAME'"),
        ((": 48 kPa ± 2 %",), "is no reference"),
        (("A: 48 kPa",), "'A: 48 kPa' lacks the unit or the uncertainty of the modulus"),
        (("A: 48",), "'A: 48' lacks the unit or the uncertainty of the modulus"),
        (("A: 48 ± 2 %",), "'48' has no unit where Pa belongs; write for example '48 kPa'"),
        (("A: 48 mm ± 2 %",), "is in mm where Pa belongs"),
        (("A: 48 kPa ± 2",), "'2' has no unit where Pa belongs"),
        (("A: 48 kPa ± nan %",), "'nan %' is not a quantity; write for example '4 %'"),
        (("A: -48 kPa ± 2 %",), "modulus -48 kPa of reference 'A' is not above 0"),
        (("A: 48 kPa ± 60 %",), "± 60 % of reference 'A' is not above 0 and at most 50 %"),
        (("A: 48 kPa ± 30 kPa",), "± 62.5 % of reference 'A'"),
        (("A: 48 kPa ± 0 %",), "± 0 % of reference 'A' is not above 0"),
        (("A\x1b[31m: 48 kPa ± 2 %",), "of a reference: give letters, digits"),
        (("A: runs/nothing",), "unknown run 'runs/nothing'"),
        (("A: 48 kPa ± 2 %", "A: 90 kPa ± 2 %"), "reference 'A': the same is given twice"),
        (("A: 48 GPa ± 2 %",), "1 % of the ratio of model 'surface' is more than 30 % of the modulus, so that"),
    ],
)
def test_what_is_no_reference_is_refused_before_anything_moves(
    palpate: Palpate, given: tuple[str, ...], message: str
) -> None:
    said = palpate("calibrate", "model", *(word for each in given for word in ("--reference", each)), *QUICK)
    assert said.status == 2
    assert message in said.complaint
    assert "\x1b" not in said.complaint
    assert not list(Path("runs").glob("*"))


@pytest.mark.parametrize(
    ("series", "message"),
    [
        (
            ReferenceSeries((Reference("A", 200e3, 0.02),), model="experiment"),
            "outside the 24.13 kPa to 112.6 kPa that",
        ),
        (ReferenceSeries(()), "no reference is given"),
        (ReferenceSeries((Reference("A", 48e3, 0.02),), valid_days=0), "validity of 0 days"),
        (
            ReferenceSeries((Reference("B", 48e3, 0.02, sample="4"),), thickness=5e-3),
            "reference 'B' is rubber sample '4' of 3 mm, not of 5 mm; leave --thickness out",
        ),
    ],
)
def test_settings_that_calibrate_nothing_are_refused(series: ReferenceSeries, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        series.check(REAL)


def test_a_reference_of_hardware_is_none_of_a_simulated_bench() -> None:
    series = ReferenceSeries((Reference("A", 48e3, 0.02, "run", "ab", "4", simulated=False),))
    series.check(REAL)
    simulated = Target(get_design("single"), 10.0, nodes=1, model="experiment")
    with pytest.raises(RangeError, match="was measured on hardware, and this bench is simulated"):
        series.check(simulated)


ORIGIN = {
    "thickness_m": 3e-3, "film_calibration": None, "device": "N1", "scene": None, "simulated": False, "source": "run",
    "created": "now", "expires": "2999-01-01",
}  # fmt: skip


THREE = (Reference("A", 30e3, 0.02), Reference("B", 60e3, 0.03), Reference("C", 110e3, 0.03))
QUESTION = RatioQuestion("single", "column", settings={"sensed_thickness": 3e-3})
SENSOR = QUESTION.sensor()
CURVE = ratio_curve(SENSOR, QUESTION.load(SENSOR.ring.material.modulus), "column")


def measured() -> ReferencesResult:
    """Three references by two valid points each, whose ratios are 0.8 times those of the column."""
    points = []
    for each in THREE:
        ratio = 0.8 * float(CURVE.force_ratio(each.modulus))
        scatter, noise, films, pickup = (share * ratio for share in (0.04, 0.003, 0.006, 0.002))
        u = math.hypot(scatter, noise, films, pickup)
        point = SoftnessPoint(each.name, 3.0, 3.0, 0.03, ratio, u, noise, True, (), films, pickup, 20.0)
        points += [point, point, replace(point, force_ratio=0.9, valid=False)]
    return evaluate(points, THREE, SENSOR, QUESTION, CURVE, ORIGIN)


def test_the_calibration_has_each_line_of_the_measured_ratios_and_its_worth_is_that_of_a_modulus() -> None:
    found = measured()
    c = found.calibration
    assert (c.model, c.parameters, c.design) == ("column", "physical", "single")
    for each, kept in zip(THREE, c.references, strict=True):
        own = math.hypot(0.04, 0.003) / math.sqrt(2)  # of two valid points
        assert (kept.force_ratio_u, kept.films_u, kept.pickup_u) == pytest.approx((own, 0.006, 0.002))
        at, step = math.log(each.modulus), 1e-4
        low, high = CURVE.force_ratio([math.exp(at - step), math.exp(at + step)])
        assert (kept.sensitivity, kept.model_force_ratio) == (
            pytest.approx(2 * step / math.log(high / low), rel=1e-5),
            pytest.approx(float(CURVE.force_ratio(each.modulus))),
        )
    assert (c.constant, found.summary()["factor"]) == (pytest.approx(math.log(1 / 0.8)), pytest.approx(1 / 0.8))
    _, sensitivity, _ = sorted(each.sensitivity for each in c.references)
    now, another, any_number = found.accuracies
    assert (now.references, another.references, any_number.references) == (3, 4, None)
    line, more = c.line(same_films=True), c.with_more(4)
    assert line.u is not None and more is not None and more.u is not None
    assert (another.modulus_u, now.modulus_u, now.half_width) == (
        pytest.approx(sensitivity * more.u),
        pytest.approx(sensitivity * line.u),
        pytest.approx(now.modulus_u * scipy.stats.t.ppf(0.975, line.degrees_of_freedom)),
    )
    constant, spread = found.budgets[-1], c.spread
    assert spread is not None and c.weight == pytest.approx(1 / 3, rel=0.05)
    assert (constant.value, constant.u) == (
        c.constant,
        pytest.approx(math.hypot(spread * math.sqrt(c.weight), c.constant_u, 0.006, 0.002)),
    )
    assert [part.degrees_of_freedom for part in constant.components] == [c.spread_degrees_of_freedom, *[math.inf] * 3]
    assert found.unbudgeted == {MODULUS: (1.0, now.modulus_u)}


def test_what_references_and_object_share_cancels_in_both_uncertainties_of_a_softness_test() -> None:
    calibration = measured().calibration.model_copy(update={"film_calibration": "ab"})
    ratio, own, films = 0.2, 0.004, 0.006
    point = SoftnessPoint("it", 3.0, 3.0, 0.03, ratio, math.hypot(own, films), 0.0, True, (), films, 0.0, 20.0)
    for same in (True, False):
        found = softness.evaluate([point], SENSOR, QUESTION, calibration, same_films=same)
        (each,), line, absolute = found.objects, calibration.line(same), found.budgets[-1]
        assert found.validation == line
        assert line.u is not None and each.absolute_u is not None
        apart = math.hypot(own, each.curve_error / math.sqrt(3), 0.0 if same else films)
        assert (each.absolute_u, absolute.u / absolute.value) == (
            pytest.approx((each.sensitivity or 0.0) * math.hypot(apart / ratio, line.u)),
            pytest.approx(each.absolute_u),
        )
        assert ("films' calibration" in [part.name for part in absolute.components]) is not same


def test_a_reference_none_of_whose_points_is_valid_is_named() -> None:
    point = SoftnessPoint("A", 3.0, 3.0, 0.03, 0.2, 0.01, 0.001, False, ("clipped",))
    with pytest.raises(EstimateError, match="no point of reference 'A' is valid"):
        evaluate([point], (Reference("A", 48e3, 0.02),), SENSOR, QUESTION, CURVE, ORIGIN)


@pytest.mark.usefixtures("own_store")
def test_the_references_that_a_plan_counts_are_the_newest_of_its_bench_that_hold() -> None:
    today, made = date(2998, 12, 31), measured().calibration

    def stored(name: str, scene: str | None, **changes: object) -> ModelCalibration:
        changes = {"device": name, "scene": scene, "source": name, "expires": "2999-01-01", **changes}
        changed = made.model_copy(update=changes)
        path = path_of(ModelCalibration, changed.owner)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_calibration(path, changed)
        return changed

    def planned() -> float | None:
        return SoftnessTest((get_sample("4"),), model="column").plan(REAL).predicted.u

    assert probable_references(QUESTION, None, today) is None
    by_thesis = planned()
    stored("simulated", "ab12", created="9", simulated=True)
    stored("old", None, created="1")
    stored("newest", None, created="3", film_calibration="ab")
    stored("expired", None, created="4", expires="2998-12-30")
    damaged = stored("damaged", None, created="5")
    path = path_of(ModelCalibration, damaged.owner)
    path.write_text(path.read_text().replace(f"constant = {damaged.constant}", "constant = 0.5"))
    for scene, name, same_films in ((None, "newest", False), ("ab12", "simulated", True)):
        found = probable_references(QUESTION, scene, today)
        assert found is not None
        assert (found.calibration.source, found.same_films) == (name, same_films)
    by_references = planned()
    assert by_thesis is not None and by_references is not None and by_references < 0.7 * by_thesis
    thicker = replace(QUESTION, settings={"sensed_thickness": 4e-3})
    assert probable_references(thicker, None, today) is None


def test_a_reference_reads_as_people_write_it() -> None:
    for text in ("A: 48 kPa ± 2 %", "A:48 kPa +- 2%", "A : 48 kPa +/- 0.96 kPa"):
        found = read_reference(text)
        assert (found.name, found.modulus, found.source) == ("A", 48e3, "stated")
        assert found.u == pytest.approx(0.02 / 1.959964)  # ± is the half-width of the 95 % interval
    assert read_reference("4: 48 kPa ± 2 %").sample == "4"
    with pytest.raises(QuantityError):
        read_reference("A: 48 kPa ± two")
