"""Error estimates over the modulus of the object, from the curves of two made-up meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.model import OPEN
from palpate.instrument.models.finite_elements.ladder import Ladder, Manner, estimates
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid import model as solid


def _one_pole(rate: float, ratio: float) -> Curve:
    """Of a made-up mesh."""
    return Curve(
        rates=np.array([rate]),
        loads=np.array([[0.5]]),
        goals=np.zeros((1, 0)),
        offsets=np.zeros((0, 1)),
        ratio=np.array([ratio]),
        share=0.1,
        least=0.0,
        clamped=np.array([1.0]),
        charges=np.array([[1e-9]]),
        capacity=np.array([[1e9]]),
    )


PLAIN = Manner(product=1.0, factors=(1.0,), voltages=(4.0,), luck=0.0)
BY_STEP = Manner(product=1.0, factors=(2.0, 1.0, 0.5), voltages=(4.0,), luck=0.12)


def _ratio_bound(curves: Sequence[Curve], modulus: float, manner: Manner = PLAIN) -> float:
    ratio, _ = estimates(curves, np.array([modulus]), manner)
    return float(ratio[0])


GRID = 10.0 ** (np.arange(8 * 3, 8 * 7) / 8)
COARSE, FINE = _one_pole(1.2e-5, 1.02), _one_pole(1e-5, 1.0)


def test_many_moduli_have_the_bounds_of_each() -> None:
    moduli = np.array([3.1e4, 1e5, 7.7e8, 2.4, 1e5])
    ratio, voltage = estimates([COARSE, FINE], moduli, PLAIN)
    each = [estimates([COARSE, FINE], moduli[[place]], PLAIN) for place in range(len(moduli))]
    assert np.array_equal(np.concatenate(each, axis=1), [ratio, voltage])


@pytest.mark.parametrize("modulus", [1e4, 1.03e4, 9.9e3, 5.2e4])
def test_two_meshes_that_cross_at_a_modulus_are_told_apart_there(modulus: float) -> None:
    """The finer one's pole is moved so that both give the same ratio there."""
    crossing = 0.5 * 1.02 / (0.5 / (1 + 1e-5 * modulus)) - 1
    coarse = _one_pole(crossing / modulus, 1.02)
    at = np.array([modulus])
    assert coarse.force_ratios(at)[0, 0] == pytest.approx(FINE.force_ratios(at)[0, 0], abs=1e-15)
    near = modulus * np.array([10**-0.5, 10**0.5])
    apart = np.abs(coarse.force_ratios(near) - FINE.force_ratios(near)).max()
    assert _ratio_bound([coarse, FINE], modulus) >= apart > 1e-4


def test_moduli_more_than_half_a_decade_away_count_by_a_share() -> None:
    """The change falls as 1/E on the hard side, so that it is about three times as great a decade away."""
    near, wide, part = (_ratio_bound([COARSE, FINE], 1e8, replace(PLAIN, product=0.0, far=k)) for k in (0.0, 1.0, 0.5))
    assert wide > 2.5 * near > 0
    assert part == pytest.approx(wide / 2)


def test_moduli_up_to_four_decades_away_count_by_a_smaller_share() -> None:
    """The change falls as 1/E on the hard side, and is greatest near 1e5 Pa."""
    apart = np.abs(COARSE.force_ratios(GRID) - FINE.force_ratios(GRID)).max()
    bounds = [_ratio_bound([COARSE, FINE], at, replace(PLAIN, product=0.0, distant=0.01)) for at in (2e8, 3e10)]
    assert bounds[0] == pytest.approx(0.01 * apart, rel=1e-3)
    assert bounds[1] < 0.005 * apart


def test_the_bound_of_voltages_is_of_the_greatest_change_nearby() -> None:
    at = np.array([1e5 * 10**0.5])
    change = np.abs(COARSE.voltages(at) - FINE.voltages(at)).max()
    _, (voltage,) = estimates([COARSE, FINE], np.array([1e5]), PLAIN)
    assert voltage >= 4 * change > 0


def _constant(ratio: float) -> Curve:
    return replace(_one_pole(1e-5, 0.0), share=ratio)


def test_each_step_of_the_meshes_has_its_factor_and_no_bound_falls_below_a_share_of_the_one_before() -> None:
    meshes = [_constant(ratio) for ratio in (0.5, 0.4, 0.36, 0.359, 0.359)]
    bounds = [_ratio_bound(meshes[:k], 1e5, BY_STEP) for k in (2, 3, 4, 5)]
    assert bounds == pytest.approx([2 * 0.1, 0.04, 0.12 * 0.04, 0.12 * 0.12 * 0.04])


def test_meshes_that_agree_by_luck_leave_a_share_of_the_bounds_before() -> None:
    at = np.array([1e5])
    before, after = (np.array(estimates(meshes, at, OPEN)) for meshes in ([COARSE, FINE], [COARSE, FINE, FINE]))
    assert after == pytest.approx(OPEN.luck * before)
    assert after.min() > 0


def test_the_change_by_a_higher_degree_along_the_height_counts_where_meshes_do_not_show_it() -> None:
    at, manner = np.array([1e5]), replace(PLAIN, height=0.25)
    changed = np.array(estimates([COARSE, FINE], at, Manner(0.0, (1.0,), (1.0,), luck=0.0)))
    found = np.array(estimates([FINE, FINE, FINE], at, manner, [COARSE, FINE]))
    assert found == pytest.approx(0.25 * changed)
    assert found.min() > 0
    assert np.array(estimates([FINE, FINE, FINE], at, manner.widened(4.0), [COARSE, FINE])) == pytest.approx(changed)


def test_energies_bound_a_ratio_that_two_meshes_agree_upon() -> None:
    """The load's changes by 3 J Pa over the modulus, most at the soft end of the window; the jump's by 2 J."""
    fine = replace(FINE, clamped=FINE.clamped + 3.0, least=FINE.least + 2.0)
    product = np.sqrt(3.0 / (1e5 * 10**-0.5) * 2.0)
    assert _ratio_bound([FINE, fine], 1e5) == pytest.approx(product)
    assert _ratio_bound([FINE, fine], 1e5, replace(PLAIN, product=0.1)) == pytest.approx(0.1 * product)


def test_a_mesh_and_its_twin_that_agree_by_luck_are_rounded_no_less_than_those_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The twin of the last mesh is the mesh itself; that of the one before differs."""
    flat = replace(RoundParameters(), sensed_thickness=1e-4)
    assert axisymmetric.may_round(flat)
    monkeypatch.setattr(axisymmetric, "curve", lambda _, number: {2: FINE, 3: FINE}[number])
    at = np.array([1e5])
    apart = np.abs(COARSE.force_ratios(at * 10**0.5) - FINE.force_ratios(at * 10**0.5))
    (told,), _ = axisymmetric.rounding([FINE, COARSE, FINE], flat, at)
    assert told >= axisymmetric.ROUNDING * apart.max() > 0
    (told,), _ = axisymmetric.rounding([COARSE, FINE, FINE], flat, at)
    assert told == axisymmetric.ROUND_OFF


def test_bounds_are_several_times_as_wide_where_a_gap_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the error only halves from mesh to mesh."""
    monkeypatch.setattr(axisymmetric, "rounding", lambda *_: (0.0, 0.0))
    sensor, at = RoundParameters(ring_inner_radius=RoundParameters().tooth_radius), np.array([1e5])
    once = np.array(estimates([FINE, COARSE], at, Manner(1.0, (1.0,), (1.0,), luck=0.0)))
    assert once.min() > 0
    for meshes, factors in (([FINE, COARSE], [6, 24]), ([COARSE, FINE, COARSE], [3, 12])):
        found = np.array(axisymmetric.estimates(meshes, sensor, at))
        assert (found / once).ravel() == pytest.approx(factors)


FEW = SolidParameters()
MANY = SolidParameters(cell_length=12e-3, cell_width=12e-3, columns=3, rows=2)
THIN_RUBBER = replace(FEW, sensed_thickness=0.11 * FEW.cell_length, sensed_poisson=0.4999)
SEALED, MANY_NARROW = (
    replace(FEW, ring_inner_radius=FEW.tooth_radius),
    replace(MANY, ring_inner_radius=1.04 * MANY.tooth_radius),
)
POINT, POINT_NARROW = (replace(each, load_at=(6e-3, 5e-3)) for each in (MANY, MANY_NARROW))


def known_of(sensor: SolidParameters, count: int, curve: Curve) -> list[Curve]:
    """One curve for all meshes that an estimate for the last of so many meshes asks."""
    return [curve] * len(solid.beside(sensor, count))


# Gap and thickness over the tooth's radius, Poisson ratio; whether few and many teeth are hard.
HARDNESS = (
    (0.06, 3.6, 0.5, False, False),
    (0.06, 3.5, 0.5, True, False),
    (0.06, 0.09, 0.44, False, True),
    (0.04, 0.95, 0.44, False, True),
    (0.0, 0.95, 0.3, True, True),
)


@pytest.mark.parametrize(
    ("sensor", "of", "factors", "of_voltages"),
    [
        (FEW, Manner(0.05, (1.0,), (1.0,), luck=0.0, far=0.3), (0.95, 0.9), (20.0, 6.0)),
        (THIN_RUBBER, Manner(0.05, (1.0,), (1.0,), luck=0.0, far=0.3), (4.5, 3.0), (16.0, 12.0)),
        (SEALED, Manner(0.05, (1.0,), (1.0,), luck=0.0, far=0.3), (4.5, 3.0), (16.0, 12.0)),
        (POINT, Manner(0.15, (1.0,), (1.0,), luck=0.0, far=1.0), (2.0, 1.0, 0.5), (12.0, 8.0, 4.0)),
        (POINT_NARROW, Manner(0.15, (1.0,), (1.0,), luck=0.0, far=1.0), (8.0, 4.0, 2.0), (48.0, 32.0, 16.0)),
    ],
)
def test_the_solid_model_believes_its_meshes_as_its_decisions_say(
    sensor: SolidParameters, of: Manner, factors: tuple[float, ...], of_voltages: tuple[float, ...]
) -> None:
    """By their number and that of the teeth, and less where coarse meshes see too little."""
    at = np.array([1e5])
    meshes = [COARSE, FINE, COARSE, FINE]
    if sensor.load_at is not None:
        meshes = [replace(each, clamped=np.zeros(1)) for each in meshes]
    ratio, voltage = estimates(meshes[:2], at, of)
    for count in range(2, len(factors) + 2):
        found = solid.estimates(meshes[-count:], sensor, at, known_of(sensor, count, COARSE))
        assert found[0] - 1e-8 == pytest.approx(factors[count - 2] * ratio)
        assert found[1] == pytest.approx(of_voltages[count - 2] * voltage)


@pytest.mark.parametrize(("gap", "thick", "poisson", "few", "many"), HARDNESS)
def test_what_coarse_meshes_see_too_little_of(gap: float, thick: float, poisson: float, few: bool, many: bool) -> None:
    """A narrow gap and a thin object on many teeth; on few ones a closed gap, and a flat object of rubber."""
    for sensor, hard in ((FEW, few), (MANY, many)):
        radius = sensor.tooth_radius
        inner, thickness = (1 + gap) * radius, thick * radius
        shaped = replace(sensor, ring_inner_radius=inner, sensed_thickness=thickness, sensed_poisson=poisson)
        assert ladders.is_hard(shaped) == hard


@pytest.mark.parametrize(("thickness", "hard"), [(0.24, True), (0.26, False)])
def test_meshes_see_too_little_of_a_load_in_one_point_on_a_flat_object(thickness: float, hard: bool) -> None:
    shaped = replace(FEW, sensed_thickness=thickness * FEW.cell_length)
    assert not ladders.is_hard(shaped)
    assert ladders.is_hard(replace(shaped, load_at=(5e-3, 4e-3))) == hard


@pytest.mark.parametrize(("thickness", "told"), [(0.09, True), (0.11, False)])
def test_the_solid_model_tells_what_the_mesh_of_a_sheet_may_be_rounded_by(
    thickness: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From its twin in another unit of length, which here differs."""
    asked = []

    def twin(of: SolidParameters, refinement: int) -> SimpleNamespace:
        asked.append((of.sensed_thickness, refinement))
        return SimpleNamespace(poles=_constant(0.5001))

    monkeypatch.setattr(solid, "curve", twin)
    sheet = replace(FEW, sensed_thickness=thickness * FEW.cell_length)
    meshes = [_constant(0.5)] * 3
    (found,), _ = solid.estimates(meshes, sheet, np.array([1e5]), [meshes[0], meshes[0]])
    assert asked == ([(pytest.approx(1.37 * sheet.sensed_thickness), 2)] if told else [])
    assert found == pytest.approx(1e-8 + (20 * 1e-4 if told else 0))


def test_many_teeth_err_as_one_cell_does_and_more_by_what_their_meshes_differ_more() -> None:
    at = np.array([1e5])
    assert [each for each, _ in solid.beside(MANY, 2)] == [replace(MANY, rows=1, columns=1)] * 7
    assert [mesh for _, mesh in solid.beside(MANY, 3)][:2] == list(ladders.OF_MANY_TEETH.resolutions[1:3])
    cell = [_constant(ratio) for ratio in (0.5, 0.48)]
    best = [_constant(0.471)] * 5
    for sensor, change, times in (
        (MANY, 0.02, 1.5),
        (MANY, 0.04, 2.0),
        (MANY, 0.0, 1.5),
        (MANY_NARROW, 0.04, 3.0),
        (MANY_NARROW, 0.08, 4.0),
    ):
        (found,), _ = solid.estimates([_constant(0.3), _constant(0.3 + change)], sensor, at, [*cell, *best])
        assert found - 1e-8 == pytest.approx(times * (0.009 + 1e-8))


def test_many_teeth_doubt_their_cells_best_mesh_by_its_own_estimate() -> None:
    at, cell = np.array([1e5]), replace(MANY, rows=1, columns=1)
    meshes, asked = [_constant(ratio) for ratio in (0.5, 0.48, 0.47)], [_constant(0.55), _constant(0.501)]
    own, _ = solid.estimates(meshes, cell, at, asked)
    alike = [_constant(0.6), _constant(0.45)]
    (found,), _ = solid.estimates(alike, MANY, at, [*alike, *meshes, *asked])
    assert found - 1e-8 == pytest.approx(1.5 * (0.02 + own[0]))


# --- Meshes that are refined until made-up error estimates meet a tolerance, which is relative to a ratio of a half

Array = NDArray[np.float64]
# Bounds by number of meshes, and then by modulus [Pa]. The second one is worse than the first at 1 Pa.
BOUNDS = {2: {1.0: 3e-3, 2.0: 1e-3, 3.0: 1e-4}, 3: {1.0: 7e-3, 2.0: 1e-4, 3.0: 1e-5}}


class Half(int):
    """The curve of a made-up mesh: at every modulus half of the force is on the tooth."""

    def force_ratios(self, moduli: Array) -> Array:
        return np.full((len(moduli), 1), 0.5)


def made_up(asked: list[int]) -> Ladder[int, tuple[int, float, float]]:
    """Three meshes; an answer is its mesh, modulus and bound of voltages. `asked` gets the meshes that are set up."""

    def mesh(refinement: int) -> int:
        asked.append(refinement)
        return refinement

    def estimates(curves: Sequence[Curve], moduli: Array) -> tuple[Array, Array]:
        found = np.array([BOUNDS[len(curves)][modulus] for modulus in moduli])
        return found, 10 * found

    def read(mesh: int, moduli: Array, bounds: Array) -> list[tuple[int, float, float]]:
        return [(mesh, float(modulus), float(bound)) for modulus, bound in zip(moduli, bounds, strict=True)]

    return Ladder(
        "made up", (5, 6, 7), lambda _count: None, mesh, lambda of: cast(Any, Half(of)), estimates, read, rounding=1e-8
    )


def test_each_modulus_is_answered_by_the_first_mesh_that_meets_the_tolerance() -> None:
    asked: list[int] = []
    ladder = made_up(asked)
    answers = ladder.solve_at(np.array([2.0, 3.0]), 1e-3)
    assert answers == [((7, 2.0, pytest.approx(1e-3)), 1e-4), ((6, 3.0, pytest.approx(1e-3)), 1e-4)]
    assert ladder.poles_to(np.array([2.0, 3.0]), 1e-3) == (7, 1e-4)
    asked.clear()
    assert [estimate for _, estimate in ladder.solve_at(np.array([1.0, 3.0]), 8e-3)] == [3e-3, 1e-4]
    assert ladder.poles_to(np.array([1.0, 3.0]), 8e-3) == (6, 3e-3)
    assert asked == [5, 6, 5, 6]


@pytest.mark.parametrize("way", ["solve_at", "poles_to"])
def test_the_least_error_of_all_meshes_is_told_where_none_meets_the_tolerance(way: str) -> None:
    ask = getattr(made_up([]), way)
    with pytest.raises(
        RangeError, match=r"cannot meet tolerance 0\.001: its least error here is ± 0\.6 % of the force ratio; give"
    ):
        ask(np.array([1.0, 3.0]), 1e-3)


@pytest.mark.parametrize("way", ["solve_at", "poles_to"])
def test_a_tolerance_below_rounding_is_refused_before_a_mesh_is_set_up(way: str) -> None:
    asked: list[int] = []
    ask = getattr(made_up(asked), way)
    for tolerance, why in ((1e-9, "rounds its ratio by up to 1e-08; give a larger one"), (0.0, "is not above 0")):
        with pytest.raises(RangeError, match=why):
            ask(np.array([3.0]), tolerance)
    assert asked == []
