"""Elimination by dense fronts, cells and halves that are alike, and the projection of what is left."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements import elimination, poles, work
from palpate.instrument.models.finite_elements.elimination import Condensed, ElementSystem, condense, dissected
from palpate.instrument.models.finite_elements.poles import Sensor, curve, projected
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import OF_FEW_TEETH
from palpate.instrument.models.solid.parts import Diagonal, SolidStack
from palpate.instrument.models.solid.system import alike, symmetry
from tests.shares import first_of

Array = NDArray[np.float64]
SIDE = 9  # elements along a square; its nodes have one unknown each, and so has the inside of each element


def square() -> tuple[ElementSystem, Array]:
    """A square of random elements, held at its left side, kept at its right one; and its whole matrix, dense.

    Two places of the first element are one unknown.
    """
    rng = np.random.default_rng(1)
    node = np.arange((SIDE + 1) ** 2).reshape(SIDE + 1, SIDE + 1)
    unknowns = np.stack([node[:-1, :-1], node[1:, :-1], node[:-1, 1:], node[1:, 1:]], axis=-1).reshape(-1, 4)
    unknowns = np.where(unknowns % (SIDE + 1) == 0, -1, unknowns)
    unknowns[0, 3] = unknowns[0, 1] = node[1, 1]
    unknowns = np.column_stack([unknowns, node.size + np.arange(SIDE**2)])
    free = np.unique(unknowns[unknowns >= 0])
    unknowns = np.where(unknowns >= 0, np.searchsorted(free, unknowns), -1)
    roots = rng.normal(size=(len(unknowns), 5, 4))
    roots -= roots.mean(axis=1, keepdims=True)  # a common displacement of all nodes costs nothing
    matrices = roots @ roots.transpose(0, 2, 1)
    kept = (free % (SIDE + 1) == SIDE) & (free < node.size)
    x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    whole = np.zeros((len(free) + 1,) * 2)
    for own, matrix in zip(unknowns, matrices, strict=True):
        np.add.at(whole, (own[:, None], own), matrix)
    loads = rng.normal(size=(len(free), 2))
    return ElementSystem(unknowns, np.column_stack([x.ravel(), y.ravel()]), matrices.__getitem__, kept, loads), whole[
        :-1, :-1
    ]


@pytest.mark.parametrize("few", [0, elimination.FEW])  # unknowns of elements are added by runs, or one by one
def test_what_is_left_is_the_schur_complement_and_what_was_inside_comes_back(
    monkeypatch: pytest.MonkeyPatch, few: int
) -> None:
    monkeypatch.setattr(elimination, "FEW", few)
    mesh, whole = square()
    found, kept = condense(mesh, remembers=True), mesh.kept
    inner = np.linalg.inv(whole[~kept][:, ~kept])
    coupling, own = whole[kept][:, ~kept], mesh.loads[~kept]
    assert found.stiffness == pytest.approx(whole[kept][:, kept] - coupling @ inner @ coupling.T)
    assert found.loads == pytest.approx(mesh.loads[kept] - coupling @ inner @ own)
    assert found.work == pytest.approx(own.T @ inner @ own)
    assert found.inside is not None
    factors = np.array([2.0, -1.0])
    moved = np.linalg.solve(found.stiffness, found.loads @ factors)
    assert found.inside(moved, factors) == pytest.approx(np.linalg.solve(whole, mesh.loads @ factors))


def test_element_matrices_are_asked_for_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elimination, "AT_ONCE", 7)
    mesh, _ = square()
    asked: list[list[int]] = []

    def matrices(elements: NDArray[np.intp]) -> Array:
        asked.append(elements.tolist())
        return mesh.matrices(elements)

    assert condense(replace(mesh, matrices=matrices)).stiffness == pytest.approx(condense(mesh).stiffness)
    assert max(map(len, asked)) == 7
    assert sorted(element for few in asked for element in few) == list(range(SIDE**2))


def test_a_part_that_nothing_holds_is_refused() -> None:
    spring = ElementSystem(
        unknowns=np.array([[0, 1]]),
        coordinates=np.zeros((1, 1)),
        matrices=lambda _elements: np.array([[[1.0, -1.0], [-1.0, 1.0]]]),
        kept=np.zeros(2, dtype=bool),
        loads=np.zeros((2, 1)),
    )
    with pytest.raises(EstimateError, match="not positive definite to working precision; bring moduli"):
        condense(spring)


def test_fronts_that_do_not_fit_into_memory_are_refused_before_they_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, _ = square()
    monkeypatch.setattr(work, "free_memory", lambda: 10_000)

    def begun(_elements: object) -> Array:
        raise AssertionError

    with pytest.raises(EstimateError, match=r"171 unknowns needs 0.0 GB of memory, .* give a larger tolerance"):
        condense(replace(mesh, matrices=begun))


def test_the_free_memory_is_known_and_a_limit_of_this_process_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    known = work.free_memory() or 0
    assert known > 1e8
    monkeypatch.setattr(work.resource, "getrlimit", lambda _which: (1024, 1024))
    assert work.free_memory() == 0


def test_unknowns_inside_an_element_burden_no_front() -> None:
    """Fronts with the inside of their elements took ten times the work on a mesh of degree 6."""
    mesh, _ = square()
    found = dissected(mesh.unknowns, mesh.coordinates, mesh.kept)
    assert found.inside == SIDE**2
    assert sum(front.count for front in found.fronts) == np.count_nonzero(~mesh.kept) - SIDE**2
    assert max(front.size for front in found.fronts) <= len(mesh.kept) - SIDE**2


SIZE = 600


def projectable(softest: float) -> tuple[Sensor, Condensed, Array, Array]:
    """Sensor, object, its rigid motion and the ratio's row: random matrices, which are harder than a sensor's.

    Compliances of the object begin at `softest` and end at 1.
    """
    rng = np.random.default_rng(2)
    first, second = (np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0] for _ in range(2))
    sensor = Sensor.__new__(Sensor)
    sensor.stiffness = (first * np.geomspace(1e4, 1e5, SIZE)) @ first.T
    sensor.charges, sensor.capacity = rng.normal(size=(SIZE, 1)), np.eye(1)
    mode = np.ones((SIZE, 1)) / np.sqrt(SIZE)
    soft = (second * np.geomspace(softest, 1.0, SIZE)) @ second.T
    away = np.eye(SIZE) - mode @ mode.T
    return sensor, Condensed(away @ soft @ away, rng.normal(size=(SIZE, 1)), np.eye(1)), mode, rng.normal(size=SIZE)


@pytest.mark.slow
def test_poles_of_a_projected_contact_give_what_all_poles_give(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three moduli alone leave 1.2 % of its voltage."""
    sensor, sensed, mode, row = projectable(1e-8)
    taken: list[int] = []
    factorised = elimination.factorised
    monkeypatch.setattr(elimination, "factorised", lambda matrix: taken.append(1) or factorised(matrix))
    fewer = projected(sensor.stiffness, sensed.stiffness, sensed.loads, row[:, None], sensor.charges, mode, 24e3)
    assert len(taken) >= 7
    assert fewer is not None and fewer.onto.shape[1] < SIZE / 3
    assert fewer.onto.T @ fewer.onto == pytest.approx(np.eye(fewer.onto.shape[1]), abs=1e-12)
    asked = (sensor, sensed, mode, row[:, None], np.zeros((1, 1)), row, 0.0, 0.0)
    full, few = curve(*asked), curve(*asked, 24e3)
    assert len(few.rates) < len(full.rates) / 3
    places = 24e3 * np.logspace(-2, 8, 21)
    for of in ("values", "voltages", "shorted", "force_ratios"):
        apart = np.abs(getattr(few, of)(places) - getattr(full, of)(places))
        assert apart.max() < 1e-7 * np.abs(getattr(full, of)(places)).max()
    for own, other in zip(few.energies(places), full.energies(places), strict=True):
        assert own == pytest.approx(other, rel=1e-5)


def test_all_poles_are_sought_where_few_moduli_do_not_suffice(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor, sensed, mode, row = projectable(1e-8)
    asked = sensor.stiffness, sensed.stiffness, sensed.loads, row[:, None], sensor.charges, mode, 24e3
    monkeypatch.setattr(poles, "MOST", len(poles.FIRST))
    assert projected(*asked) is None


def test_a_rate_below_0_is_rounded_up_where_it_is_rounding_and_else_refused() -> None:
    sensor = Sensor.__new__(Sensor)
    sensor.stiffness, sensor.charges, sensor.capacity = np.eye(3), np.zeros((3, 0)), np.zeros((0, 0))

    def rates(least: float) -> list[float]:
        sensed = Condensed(np.diag([1.0, 0.5, least]), np.ones((3, 1)), np.eye(1))
        found = curve(sensor, sensed, np.zeros((3, 0)), np.ones((3, 1)), np.zeros((1, 1)), np.ones(3))
        return sorted(found.rates.tolist())

    assert rates(-1e-8) == pytest.approx([0.0, 0.5, 1.0], abs=1e-15)
    with pytest.raises(EstimateError, match="rounding makes the stiffness of the object negative; give a thicker"):
        rates(-1e-4)


# --- Cells of an array that are alike: what one of them leaves serves for all --------------------------


def test_cells_are_alike_where_places_and_joints_are() -> None:
    """Three cells of two elements in a row, the last one held at its end; then one whose elements do not touch."""
    unknowns = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, -1], [6, 7], [8, 9]])
    cells, relative = np.arange(8) // 2, np.arange(8)[:, None] % 2
    found = alike(unknowns, cells, relative)
    assert found is not None
    assert found.names.tolist() == [[0, 1, 2], [2, 3, 4], [4, 5, -1]]
    assert found.elements.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert found.places.tolist() == [[0, 1], [1, 2]]
    assert alike(unknowns[:2], cells[:2], relative[:2]) is None
    assert alike(unknowns, cells, np.arange(8)[:, None]) is None  # no element is another's translation
    assert alike(unknowns, np.zeros(8, dtype=int), relative) is None


# --- Sensors that are their own mirror image about the diagonal: what is eliminated in sums and differences

SMALLEST = OF_FEW_TEETH.resolutions[0]
SOFT = SolidParameters(sensed_modulus=1.0)


@pytest.mark.parametrize(
    ("changed", "is_halved"),
    first_of(
        [
            ({}, True),
            ({"load_at": (5e-3, 5e-3)}, True),
            ({"load_at": (6e-3, 5e-3)}, False),
            ({"load_at": (6e-3, 6e-3)}, True),
            ({"columns": 2}, False),
            ({"cell_width": 11e-3}, False),
            ({"rows": 2, "columns": 2, "separate_bases": True}, True),
        ]
    ),
)
def test_a_sensor_is_halved_where_it_is_its_own_mirror_image(changed: dict[str, Any], is_halved: bool) -> None:
    sensor = replace(SOFT, **changed)
    found = Diagonal(SolidStack(sensor, SMALLEST, symmetry(sensor)))
    columns = np.arange(3.0 * found.stack.unknowns).reshape(-1, 3)
    assert np.array_equal(found.turned(columns), columns) is not is_halved
    assert found.turned(found.turned(columns)) == pytest.approx(columns)


def test_halves_have_half_of_the_unknowns_but_for_those_on_the_diagonal() -> None:
    stack = SolidStack(SOFT, SMALLEST, (True, True))
    sums, differences = Diagonal(stack).pieces(stack.object)
    counts = [len(np.unique(piece.unknowns[piece.unknowns >= 0])) for piece in (sums, differences)]
    free = np.unique(stack.object.names[stack.object.names >= 0])
    assert sum(counts) == len(free)
    assert counts[0] > counts[1] > 0.4 * len(free)
    assert not np.intersect1d(sums.unknowns[sums.unknowns >= 0], differences.unknowns).size
