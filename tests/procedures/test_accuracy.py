"""How the price list is measured, on finite elements whose errors are made up, and what is kept of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate import get_design, response
from palpate.instrument.models import price_list, surface
from palpate.instrument.models.axisymmetric.model import OPEN
from palpate.instrument.models.finite_elements.ladder import estimates
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, SolidParameters, get_parameter_set
from palpate.instrument.models.price_list import Price, PriceList, stored
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.table import MODELS
from palpate.procedures.accuracy import measure as machine
from palpate.procedures.accuracy import measure as measuring
from palpate.procedures.accuracy import meshes
from palpate.procedures.accuracy.measure import measure
from palpate.procedures.accuracy.meshes import (
    MIDDLES,
    MODULI,
    TIMED,
    UNSEEN,
    Array,
    MeshedProblem,
    MeshSolution,
)
from palpate.procedures.virtual import numerics as collecting
from tests.procedures.conftest import Palpate
from tests.shares import first_of

NUMERICS = ("accuracy", "numerics")


def truth(modulus: float) -> float:
    """The force ratio of the round design, within 1e-5."""
    return response(get_design("single_round"), PHYSICAL.load(modulus), "surface").force_ratio


def made_up(mesh: MeshedProblem) -> MeshSolution:
    """Errors of 0.5, 0.1, 0.02, ... by refinement and 2e-4 or less for references; a second for each level.

    Between the moduli the first axisymmetric one is off by 0.3. The finest mesh of two teeth does not fit.
    """
    if isinstance(mesh.parameters, SolidParameters) and mesh.parameters.columns > 1 and mesh.refinement > 1:
        return MeshSolution(None, failure="too large" if not mesh.second else "too large, too")
    level = mesh.refinement + (1 if mesh.model == "solid" else 0)
    error = 0.1 * 0.2 ** (level - 1) if not mesh.second else 1e-5
    if mesh.model == "axisymmetric" and mesh.refinement == 1 and mesh.parameters.sensed_modulus in MIDDLES:
        error = 0.3
    ratio = truth(mesh.parameters.sensed_modulus) * (1 - error)
    return MeshSolution(ratio, (0.5 * level, 0.25 * level, 0.25 * level), curve=constant(ratio))


def constant(ratio: float) -> Curve:
    """A curve of no poles, whose force ratio is the same under any object."""
    none = np.zeros(0)
    return Curve(
        rates=none,
        loads=none.reshape(0, 1),
        goals=none.reshape(0, 0),
        offsets=none.reshape(0, 1),
        ratio=none,
        share=ratio,
        least=0.0,
        clamped=np.ones(1),
        charges=none.reshape(0, 0),
        capacity=none.reshape(0, 0),
    )


def rising_estimates(curves: Sequence[Curve], parameters: RoundParameters, moduli: Array) -> tuple[Array, Array]:
    """What meshes tell of each other, and greater for harder objects, as no curve made up here has it."""
    ratio, voltage = estimates(curves, moduli, OPEN)
    return ratio * np.cbrt(moduli / MODULI[-1]), voltage


def solid_estimates(curves: Sequence[Curve], parameters: SolidParameters, moduli: Array) -> tuple[Array, Array]:
    """The model's own, where a higher degree along the height changes nothing."""
    return solid.estimates(curves, parameters, moduli, [curves[0]] * (len(curves) - 2))


@contextmanager
def in_this_process() -> Iterator[Any]:
    yield map


def beside(sensor: SolidParameters, meshes: int) -> list[tuple[SolidParameters, str]]:
    """The mesh that the estimate of a third mesh asks for."""
    return [(sensor, "a mesh")] if meshes > 2 else []


def beside_on(_: SolidParameters, mesh: str) -> SimpleNamespace:
    """That mesh, of 0.5 s."""
    assert mesh == "a mesh"
    return SimpleNamespace(seconds=(0.1, 0.4))


@pytest.fixture(scope="module")
def measured() -> PriceList:
    seen: list[tuple[int, int]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(meshes, "solve", made_up)
        patch.setattr(meshes, "side_by_side", in_this_process)
        patch.setattr(measuring, "BETWEEN", 12)
        patch.setattr(measuring, "axisymmetric", SimpleNamespace(estimates=rising_estimates))
        patch.setattr(measuring, "solid", SimpleNamespace(estimates=solid_estimates, beside=beside, curve_on=beside_on))
        patch.setattr(measuring, "seconds_of", lambda call: (call(), 1e-6)[1])
        prices = measure(
            ["single_round", "single", "common_base"], lambda done, total, what: seen.append((done, total))
        )
    assert seen[0][0] == 1 and seen[-1] == (seen[-1][1],) * 2  # progress reaches its end
    assert len({total for _, total in seen}) == 1
    return prices


def rows(prices: PriceList, design: str, model: str) -> list[Price]:
    return [price for price in prices.prices if (price.design, price.model) == (design, model)]


# --- measuring -----------------------------------------------------------------------------------------


def test_every_model_has_its_refinements(measured: PriceList) -> None:
    for design in ("single_round", "single"):
        counts = {model: len(rows(measured, design, model)) for model in MODELS}
        assert counts == {
            "column": 1, "column_fitted": 1, "experiment": 1, "beam_printed": 1, "beam_exact": 1,
            "beam": 1, "axisymmetric": 5, "solid": 3, "surface": 1,
        }  # fmt: skip


def test_an_error_is_the_greatest_of_both_ends_and_the_middle(measured: PriceList) -> None:
    reference = measured.references[0]
    second = rows(measured, "single_round", "axisymmetric")[1]
    ends = [
        abs(0.98 * truth(m) - r) + u
        for m, r, u in zip(MODULI, reference.force_ratios, reference.uncertainties, strict=True)
    ]
    (curves,) = rows(measured, "single_round", "surface")
    middles = [0.02 * truth(m) + (own or 0.0) for m, own in zip(MIDDLES, curves.errors, strict=True)]
    greatest = [max(*pair, middle) for pair, middle in zip(itertools.pairwise(ends), middles, strict=True)]
    assert (second.errors, second.errors[0]) == (
        pytest.approx(greatest, rel=1e-12),
        pytest.approx(0.02 * truth(MODULI[1]), rel=2e-2),
    )
    coarsest = rows(measured, "single_round", "axisymmetric")[0]
    assert coarsest.errors == pytest.approx([0.3 * truth(modulus) for modulus in MIDDLES], rel=2e-2)


def test_a_mesh_that_does_not_fit_is_left_in_and_the_reference_goes_without(measured: PriceList) -> None:
    found = rows(measured, "common_base", "solid")
    assert ([price.failure for price in found], found[-1].errors) == (["", "", "too large"], (None,) * 4)
    assert (found[-1].build_s, found[-1].seconds, found[-1].answer_s) == (None, None, None)
    reference = measured.references[2]
    assert (
        "refinements up to 1" in reference.how
        and "not checked by a finer or other mesh: too large, too" in reference.how
    )
    # Errors of 0.1 and 0.02 lead to none; two meshes may leave more unseen.
    for modulus, ratio, uncertainty in zip(MODULI, reference.force_ratios, reference.uncertainties, strict=True):
        assert (ratio, uncertainty) == (
            pytest.approx(truth(modulus), rel=1e-9),
            pytest.approx(max(0.02 * truth(modulus), UNSEEN[2]), rel=1e-6),
        )


def test_a_certified_answer_costs_all_the_meshes_that_its_estimate_needs(measured: PriceList) -> None:
    answers = [price.answer_s for price in rows(measured, "single_round", "axisymmetric")]
    assert answers == [None, 3.0, 6.0, 10.0, 15.0]
    assert [price.answer_s for price in rows(measured, "single_round", "solid")] == [None, 3.0, 6.5]
    assert [price.seconds for price in rows(measured, "single_round", "solid")] == [1.0, 2.0, 3.0]


def test_measuring_is_told_to_take_the_seconds_of_all_its_meshes_and_references(
    measured: PriceList, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Prices made up here: the stored ones are those of the machine that measured them last, and change with it."""
    axisymmetric, solid, references = 9 * (1 + 2 + 3 + 4 + 5), 2 * (0 + 1 + 2 + 3), 84  # nine moduli, two processes
    monkeypatch.setattr(measuring, "stored", lambda: measured)
    expected = measuring.expected_seconds(["single_round"])
    assert expected == pytest.approx((axisymmetric + solid + references) / 2, rel=1e-6)
    assert measuring.expected_seconds(["single_round", "array_16"]) == expected  # which the list does not have yet


@pytest.mark.parametrize("damaged", [True, False])
def test_all_prices_are_measured_anew_where_the_list_is_damaged_or_missing(
    damaged: bool, measured: PriceList, palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "prices.json"
    if damaged:
        path.write_text("{")
    asked: list[list[str]] = []
    monkeypatch.setattr(price_list, "STORED", path)
    monkeypatch.setattr(measuring, "measure", lambda designs, _: asked.append(designs) or measured)
    stored.cache_clear()
    assert "measure all designs anew: palpate accuracy numerics --store" in palpate(*NUMERICS).err
    said = palpate(*NUMERICS, "--store", "--quiet")
    stored.cache_clear()
    assert (said.status, said.err, asked, stored.__wrapped__()) == (0, "", [[*measuring.DESIGNS]], measured)


def test_estimates_are_the_greatest_that_the_models_give_in_each_interval(measured: PriceList) -> None:
    first, second, *_ = rows(measured, "single_round", "axisymmetric")
    assert first.estimates == (None,) * 4
    meshes_there = [constant((1 - error) * truth(MODULI[2])) for error in (0.1, 0.02)]
    bounds, _ = rising_estimates(meshes_there, RoundParameters(), np.array(MODULI[1:]))
    assert second.estimates == pytest.approx(bounds, rel=1e-12)
    assert bounds[-1] > 0.02 * truth(MODULI[2])  # the error of that mesh


def test_the_reference_of_a_round_design_is_its_finest_mesh_and_says_how_it_was_checked(measured: PriceList) -> None:
    round_one, square, _ = measured.references
    finest = [0.1 * 0.2**5] * len(MODULI)
    for modulus, ratio, error in zip(MODULI, round_one.force_ratios, finest, strict=True):
        assert ratio == pytest.approx(truth(modulus) * (1 - error), rel=1e-12)
    for way in ("plain displacement form", "refinement 5", "solid model"):
        assert way in round_one.how
    assert "another degree" in square.how
    # Errors of 0.1, 0.02 and 0.004 lead to none; the second way is 1e-5 off.
    at = MODULI.index(TIMED)
    assert (square.force_ratios[at], square.uncertainties[at]) == (
        pytest.approx(truth(TIMED), rel=1e-9),
        pytest.approx(0.004 * truth(TIMED), rel=1e-3),
    )


def test_a_closed_form_is_looked_at_between_the_moduli(measured: PriceList) -> None:
    """The column is nearly right at 1 MPa and at 140 GPa, and 0.004 off in between."""
    (column,) = rows(measured, "single_round", "column")
    design = get_design("single_round")
    for modulus, end in ((1e6, 1.5e-3), (140e9, 1.5e-3)):
        assert abs(response(design, PHYSICAL.load(modulus), "column").force_ratio - truth(modulus)) < end
    assert column.errors[3] is not None and column.errors[3] > 4e-3
    assert column.answer_s == 1e-6


def test_what_a_model_does_not_answer_is_left_in_with_its_reason(measured: PriceList) -> None:
    (nothing,) = rows(measured, "single_round", "experiment")
    assert nothing.errors == (None,) * 4 and nothing.answer_s is None
    assert "nothing was measured" in nothing.failure
    (samples,) = rows(measured, "single", "experiment")
    assert [error is None for error in samples.errors] == [True, False, True, True]
    assert samples.answer_s is not None and "outside the measured" in samples.failure


def test_a_surface_is_priced_with_its_own_estimates_and_by_its_poles(measured: PriceList) -> None:
    (found,) = rows(measured, "single_round", "surface")
    known = surface.find(get_design("single_round"), PHYSICAL.load(1e5))
    assert found.refinement == f"{len(known.poles.rates)} poles of axisymmetric"
    for (low, high), given in zip(itertools.pairwise(MODULI), found.estimates, strict=True):
        ends = known.estimates(np.array([low, high]))[0]
        assert given is not None and given >= ends.max() > 0
    assert found.answer_s is not None and found.evaluate_s is not None and found.evaluate_s < found.answer_s


# --- the commands --------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def nothing_else_is_measured(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(collecting, "collect", lambda design, progress: [])
    stored()
    yield
    stored.cache_clear()


def test_prices_of_one_design_take_the_place_of_its_stored_ones(
    measured: PriceList, palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, fresh = stored(), replace(measured.of(["single"]), machine=stored().machine)
    monkeypatch.setattr(machine, "this_machine", lambda: replace(old.machine, date="today"))
    monkeypatch.setattr(measuring, "measure", lambda *_: fresh)
    monkeypatch.setattr(price_list, "STORED", tmp_path / "prices.json")
    palpate(*NUMERICS, "--design", "single", "--store", "--quiet")
    kept = stored.__wrapped__()
    assert kept.of(["single"]) == fresh != old.of(["single"])
    others = list(dict.fromkeys(price.design for price in old.prices if price.design != "single"))
    assert (kept.of(others), [reference.design for reference in kept.references]) == (
        old.of(others),
        [reference.design for reference in old.references],
    )


def test_prices_of_another_machine_are_refused_before_anything_is_measured(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    abacus = replace(stored().machine, cpu="abacus")
    monkeypatch.setattr(machine, "this_machine", lambda: abacus)
    monkeypatch.setattr(measuring, "measure", lambda *_: pytest.fail("measured"))
    said = palpate(*NUMERICS, "--design", "single", "--store")
    assert said.status == 2
    assert [
        text
        for text in (
            f"are of {stored().machine.cpu}",
            "this is abacus",
            "measure all designs anew: palpate accuracy numerics --store",
        )
        if text not in said.complaint
    ] == []


def test_stored_surfaces_are_listed_with_their_bounds(palpate: Palpate) -> None:
    found = palpate("model", "surfaces", "--json").object["surfaces"]
    listed = [(design, parameters) for design in measuring.DESIGNS for parameters in measuring.sets_of(design)]
    assert [(row["design"], row["parameters"]) for row in found] == listed
    assert ("single", "identified") in listed and ("single_round", "identified") not in listed
    for row in found:
        assert set(row) == {"design", "parameters", "model", "meshes", "poles", "discretisation", "build_s"}
        chosen = get_parameter_set(row["parameters"], "surface")
        sensor = chosen.design(get_design(row["design"]))
        given = response(sensor, chosen.load(1e5), "surface")
        estimate = (given.error_estimate or 0.0) * given.force_ratio
        assert row["discretisation"] * (1 + 1e-10) >= estimate > 0  # other kernels round so
        assert row["meshes"] > 1 and row["poles"] > 10 and row["build_s"] > 0
    assert "error of the model" in palpate("model", "surfaces", "--design", "single").out


@pytest.mark.parametrize("damaged", first_of([True, False]))
def test_the_command_that_builds_curves_again_does_so_where_one_is_damaged_or_missing(
    damaged: bool, palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface, "STORED", tmp_path)
    monkeypatch.setattr(surface, "ROUND_REFINEMENTS", (1, 2))
    surface.read_surface.cache_clear()
    build = ("model", "surfaces", "--design", "single_round", "--store", "--quiet")
    old = [tmp_path / f"{design}.1.00000000.curve" for design in ("single", "single_round")]
    for each in old:
        each.write_text("old")
    palpate(*build)
    assert [each.exists() for each in old] == [True, False]  # those of the design that is built go
    files = sorted(tmp_path.glob("single_round.*.curve"))
    whole = [file.read_bytes() for file in files]
    if damaged:
        files[1].write_bytes(whole[1][:-8])
    else:
        files[1].unlink()
    surface.read_surface.cache_clear()
    assert "palpate model surfaces --store" in palpate(*build[:-2]).err
    assert (palpate(*build).status, sorted(tmp_path.glob("single_round.*.curve")), len(files)) == (0, files, 2)
    surface.read_surface.cache_clear()
    found = surface.find(get_design("single_round"), PHYSICAL.load(1e5))
    surface.read_surface.cache_clear()  # other tests ask for the curves that come with palpate
    monkeypatch.undo()
    assert found.force_ratios(np.array([1e5])) == pytest.approx(truth(1e5), abs=1e-3)


def test_a_sweep_with_model_auto_names_the_model_that_answered(palpate: Palpate, tmp_path: Path) -> None:
    said = palpate(
        "sweep", "loads", "--model", "auto", "--samples", "2", "--loads", "2 N", "--dwell", "0.1 s", "--json",
        "--out", str(tmp_path / "run"),
    ).object  # fmt: skip
    assert said["model"] in MODELS
    (sample,) = said["samples"]
    true = response(get_design("single"), PHYSICAL.load(24131.65), "surface").force_ratio
    assert sample["force_ratio"] == pytest.approx(true, abs=price_list.AUTO_TOLERANCE + 4 * sample["force_ratio_u"])
