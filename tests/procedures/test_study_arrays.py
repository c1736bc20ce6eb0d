"""Cells of one scene, computed together as arrays, are to the last bit what each of them is when computed alone."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from palpate.procedures.study.description import Study
from palpate.procedures.study.run import CellBlock, one_by_one
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.planning import seeds
from tests.procedures.studies import study_from
from tests.shares import first_of


def asked(axes: str, loads: str, more: str = "") -> tuple[Study, StudyComputation]:
    study = study_from(f'name = "arrays"\nloads = "{loads}"\n{more}\n[axes]\n{axes}\n')
    return study, StudyComputation.of(study, "study.toml")


def contents(block: CellBlock) -> dict[str, object]:
    """All that is stored of a block but what tells how it was computed."""
    points = {name: (column.dtype, column[block.done].tobytes()) for name, column in block.columns.items()}
    return {**points, "reasons": block.reasons, "means": block.means.tobytes()}


CASES = {
    "seeds and samples": ('seed = "1-12"\nsample = ["1", "6"]', "1.5 N:4 N:0.5 N", ""),
    "every effect at the inputs": ('scene = ["noisy_lab"]\nseed = "5-12"', "1.5 N, 3 N", ""),
    "leaks and warming": ('scene = ["humid_body", "long_drift"]\nseed = "1-4"', "1 N, 2 N, 2 N", ""),
    "common base": ('scene = ["thesis_common_base"]\nseed = "1-4"', "1 N, 4 N", ""),
    "an array on five nodes": ('scene = ["array_16"]\nmodel = ["column"]\nseed = "1-4"', "2 N", ""),
    "no scatter": ('scene = ["ideal"]\nseed = "1-4"', "1 N, 2 N", ""),
    "gains by mounting": ('effects.gain_scatter.redrawn = ["mounting"]\nseed = "1-4"', "1 N, 2 N, 2 N", ""),
    "films that share forces": (
        'effects.crosstalk.over_teeth = [0.5]\nscene = ["thesis_common_base"]\nseed = "1-4"', "2 N", "",
    ),
    "clipped in the fine range": ('effects.mains_hum.amplitude = ["0.49 V"]\nseed = "1-4"', "2 N, 4 N", ""),
    "clipped in both": ('effects.mains_hum.amplitude = ["5 V"]\nseed = "1-4"', "2 N, 4 N", ""),
    "a coarse converter": ('effects.adc.bits = [8]\nseed = "1-4"', "2 N, 4 N", ""),
    "short records": ('scene = ["noisy_lab"]\nseed = "1-8"', "2 N, 3 N", 'dwell = "0.3 s"'),
    "hum off its rated frequency": ('effects.mains_hum.frequency = ["50.4 Hz"]\nseed = "1-4"', "2 N, 3 N", ""),
    "some without a ratio": ('effects.white_noise.density = ["5 mV/√Hz"]\nseed = "1-8"', "1 N, 2 N", 'dwell = "0.3 s"'),
    "limits that act": ('scene = ["overdriven"]\nseed = "1-4"', "2 N, 3 N", ""),
    "a time constant of a minute": (
        'effects.charge_amplifier.time_constant = ["60 s"]\nseed = "1-4"', "1 N:4 N:0.5 N", "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", first_of([*CASES]))
def test_arrays_are_to_the_last_bit_what_single_cells_are(case: str) -> None:
    axes, loads, more = CASES[case]
    study, computation = asked(axes, loads, more)
    together = computation.block(study, range(len(study)))
    alone = one_by_one(computation, study, range(len(study)))
    assert contents(together) == contents(alone)
    assert set(together.alone) == {""}


@pytest.mark.parametrize("pieces", [[1] * 9, [4, 5], [8, 1]])
def test_the_results_do_not_depend_on_how_cells_are_put_together(pieces: list[int]) -> None:
    study, computation = asked('seed = "1-3"\nsample = ["1", "2", "3"]', "2 N")
    whole = computation.block(study, range(9))
    columns: dict[str, list[bytes]] = {}
    first = 0
    for piece in pieces:
        block = computation.block(study, range(first, first + piece))
        for name, column in block.columns.items():
            columns.setdefault(name, []).append(column.tobytes())
        first += piece
    assert {name: b"".join(parts) for name, parts in columns.items()} == {
        name: column.tobytes() for name, column in whole.columns.items()
    }


def test_most_cells_are_sure_and_one_on_the_edge_of_a_step_is_computed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    study, computation = asked('seed = "1-6"', "2 N")
    followed: Counter[str] = Counter()
    monkeypatch.setattr(
        StudyComputation,
        "__call__",
        lambda self, cell, was=StudyComputation.__call__: followed.update("x") or was(self, cell),
    )
    sure = computation.block(study, range(6))
    assert not followed
    # The margin is now a quarter of a step, so that a sample of every cell lies in it.
    monkeypatch.setattr(seeds, "ROUND_OFF", 2.0**-17)
    unsure = computation.block(study, range(6))
    assert followed["x"] == 6
    assert contents(unsure) == contents(sure)


def test_an_effect_that_is_not_linear_in_what_a_seed_draws_is_named() -> None:
    study, computation = asked('effects.mounting_scatter.scatter = [0.02]\nseed = "1-4"', "2 N")
    block = computation.block(study, range(4))
    assert set(block.alone) == {"mounting_scatter"}
    assert contents(block) == contents(one_by_one(computation, study, range(4)))
    assert len(np.unique(block.means[:, 0])) == 4


@pytest.mark.parametrize(("samples", "cause"), [(4, ""), (5, "few cells share a scene")])
def test_cells_of_many_scenes_with_few_seeds_each_are_computed_alone_and_that_is_told(samples: int, cause: str) -> None:
    names = ", ".join(f'"{sample}"' for sample in range(1, samples + 1))
    study, computation = asked(f'seed = "1-2"\nsample = [{names}]\neffects.gain_scatter.strength = [0.5, 1.0]', "2 N")
    assert set(computation.block(study, range(len(study))).alone) == {cause}
