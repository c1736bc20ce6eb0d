"""Who mounts the samples: a plan takes the time of the sample changer where there is one, and a run keeps to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from palpate import (
    Characterisation,
    FrequencySweep,
    LoadSweep,
    ObjectModulus,
    SoftnessTest,
    TemperatureSweep,
    get_design,
    get_sample,
)
from palpate.extend import Bench, Lab, Procedure, Recorder, Scene, Target
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import SampleError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.chosen import choose
from palpate.procedures.lab.lab import BY_HAND, MOUNTING, Mounts, mounts_by
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER

CHANGER = Mounts(5.0, changer=True)
BY_CHANGER = Target(get_design("single"), 10.0, 1, "experiment", mounts=CHANGER)
MODULUS = ObjectModulus(get_sample("4"), 0.1, relative_to_model=True, mountings=2, mounting_scatter=0.0)


@pytest.fixture
def sim(nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    with SimulatedBench(scene, samples=[SAMPLES["4"], SAMPLES["1"]]) as simulated:
        yield simulated


def test_a_bench_file_with_a_sample_changer_tells_its_time(sim: SimulatedBench, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(sim.description.patient().to_toml(), encoding="utf-8")
    assert (choose(file).target.mounts, choose(None).target.mounts) == (CHANGER, BY_HAND)
    unknown = replace(KINDS["sample_changer"], exchange=None)
    assert mounts_by(lambda role: unknown if role == "sample_changer" else None) == Mounts(MOUNTING, changer=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "procedure",
    [
        LoadSweep(("1", "2"), (2.0, 3.0)),
        LoadSweep(("1", "2"), (2.0, 3.0), tolerance=0.04),
        SoftnessTest((SAMPLES["1"], SAMPLES["4"])),
        SoftnessTest((SAMPLES["1"], SAMPLES["4"]), risk=0.05),
        FrequencySweep(),
        TemperatureSweep(),
        Characterisation(),
        Characterisation(tolerance=0.06),
        replace(MODULUS, mountings=1),
    ],
    ids=lambda each: each.name,
)
def test_plans_take_the_time_of_the_changer_and_say_who_mounts(procedure: Procedure) -> None:  # type: ignore[type-arg]
    by_hand, changed = (procedure.plan(replace(BY_CHANGER, mounts=mounts)) for mounts in (BY_HAND, CHANGER))
    saved = MOUNTING - CHANGER.seconds
    mountings = round((by_hand.seconds - changed.seconds) / saved, 1)
    assert mountings in (1, 2), by_hand.seconds - changed.seconds
    told = "\n".join(changed.predicted.lines)
    assert "(person" not in told
    assert not told or "(sample changer" in told


def test_the_bound_of_a_plan_is_that_of_the_changer() -> None:
    by_hand, changed = (
        MODULUS.course_on(replace(BY_CHANGER, mounts=mounts)).prospect.times for mounts in (BY_HAND, CHANGER)
    )
    assert by_hand.longest - changed.longest == pytest.approx(2 * MOUNTING - 3 * CHANGER.seconds, abs=1)


@pytest.mark.slow
def test_a_changer_takes_the_object_off_for_each_mounting_in_the_planned_time(
    bench: Bench, sim: SimulatedBench, tmp_path: Path
) -> None:
    lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
    assert lab.target.mounts == CHANGER
    planned = MODULUS.plan(lab.target).predicted
    with Recorder.create(tmp_path / "run", HEADER) as record:
        found = conduct(MODULUS, lab, record)
    assert [point.mounting for point in found.points] == 10 * [1] + 10 * [2]
    assert sim.rig.exchanges == 6  # sample 4, off and sample 1, off and sample 4 again
    assert 1e-9 * sim.clock.now_ns() == pytest.approx(planned.details["planned"]["as_known_s"], rel=0.06)


def test_a_changer_with_one_sample_alone_cannot_mount_it_anew(scene: Scene, tmp_path: Path) -> None:
    with (
        SimulatedBench(scene, samples=[SAMPLES["4"]]) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
        Recorder.create(tmp_path / "run", HEADER) as record,
        pytest.raises(SampleError, match=r"holds '4' alone, .* put another sample into .* or give --mountings 1"),
    ):
        conduct(MODULUS, Lab(bench, get_design("single"), THESIS_LOAD_CELL), record)
    assert sim.rig.exchanges == 0  # nothing has moved
