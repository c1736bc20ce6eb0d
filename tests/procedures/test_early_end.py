"""A procedure that has enough before its plan ends: the record says why, and resuming or replaying ends there too."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import pytest

import palpate
from palpate.extend import Design, Lab, Measurement, Plan, Procedure, Recorder, SimpleResult, Step, Target, read_scene
from palpate.instrument.calibration.films import MountingScatterCalibration
from palpate.instrument.models.response import RatioQuestion
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.calibrations import install
from palpate.testing import steps
from tests.procedures.conftest import HEADER, interrupt_at

pytestmark = pytest.mark.usefixtures("own_store")

T = TypeVar("T")
SECONDS = 0.5


@dataclass(frozen=True)
class Reading:
    home_m: float
    time_s: float


@dataclass(frozen=True)
class Waiting(Procedure[Step, Reading, SimpleResult[Reading]]):
    """Reads the probe's position until it has so many readings."""

    name = "waiting"
    point = Reading
    resumable_on_real_bench = True

    wanted: int = 3
    most: int = 6

    def plan(self, target: Target) -> Plan[Step]:
        return Plan(self.name, [Step(None, SECONDS, None, what=f"{i}") for i in range(self.most)])

    def begin(self, plan: Plan, lab: Lab, record: Recorder) -> _Reader:
        return _Reader(lab)

    def course(self, plan: Plan, points: Sequence[Reading], lab: Lab) -> Generator[int, None, str]:
        for number in range(self.most):
            if len(points) == self.wanted:
                return f"{self.wanted} readings are enough"
            yield number
        return ""

    def evaluate(self, points: Sequence[Reading], plan: Plan, lab: Lab) -> SimpleResult[Reading]:
        return SimpleResult(points)


@dataclass
class _Reader:
    lab: Lab

    def arrange(self, step: Step) -> None: ...

    def take(self, step: Step) -> Measurement[Reading]:
        bench = self.lab.bench
        bench.clock.wait(SECONDS)
        at = next(d for d in bench.devices if hasattr(d, "travel")).position()
        return Measurement(Reading(at, 1e-9 * bench.clock.now_ns()))

    def end(self) -> None:
        self.lab.bench.rest()


def test_a_procedure_that_has_enough_ends_before_its_plan_and_says_why(tmp_path: Path) -> None:
    with palpate.open_bench(scene="ideal") as bench:
        done = palpate.run(Waiting(), bench, out=tmp_path / "run")
        whole = palpate.run(Waiting(wanted=9), bench, out=tmp_path / "whole")
    run = done.run
    assert (len(done.result.points), run.status) == (3, "complete")
    assert [(e["kind"], e["message"]) for e in run.events()] == [("enough", "3 readings are enough")]
    assert (len(whole.result.points), whole.run.events()) == (6, [])


def test_finished_points_of_a_real_bench_that_are_enough_are_not_added_to_and_none_is_left_out(tmp_path: Path) -> None:
    class GoesOn(Recorder):
        count = 3

        def finished(self, kind: type[T]) -> list[T]:
            return [kind(0.0, float(i)) for i in range(self.count)]  # type: ignore[call-arg]

    with palpate.open_bench(scene="ideal") as bench, GoesOn.create(tmp_path, HEADER) as record:
        lab = bench.lab("waiting", bench.started)
        assert [point.time_s for point in conduct(Waiting(), lab, record).points] == [0.0, 1.0, 2.0]
        record.count = 4
        with pytest.raises(palpate.RecordError, match="holds 4 points, and this procedure takes 3; run it anew"):
            conduct(Waiting(), lab, record)


def test_a_replay_ends_where_the_run_did(tmp_path: Path) -> None:
    log = tmp_path / "bus.pcapng"
    with palpate.open_bench(scene="ideal", log=log) as bench:
        first = palpate.run(Waiting(), bench, out=tmp_path / "run")
    again = palpate.replay(log, tmp_path / "again", Waiting)
    assert (again.run.digest(), [e["kind"] for e in again.run.events()]) == (first.run.digest(), ["enough"])


@dataclass(frozen=True)
class Grouped(Waiting):
    """Reads three times in each of two groups, or as often as the group needs."""

    name = "grouped"
    first_needs: int = 1

    def plan(self, target: Target) -> Plan[Step]:
        steps = [Step(None, SECONDS, None, what=f"{g} {i}", group=g) for g in ("a", "b") for i in range(3)]
        return Plan(self.name, steps)

    def course(self, plan: Plan, points: Sequence[Reading], lab: Lab) -> Generator[int, None, str]:
        yield from (*range(self.first_needs), *range(3, 6))
        return ""


def test_steps_of_a_group_that_has_enough_are_left_out_also_when_the_run_is_resumed(tmp_path: Path) -> None:
    shown: list[tuple[int, str]] = []

    def stop(done: int, _all: int, what: str) -> None:
        shown.append((done, what))
        if len(shown) == 6:
            raise KeyboardInterrupt

    with palpate.open_bench(scene="ideal") as bench:
        whole = palpate.run(Grouped(), bench, out=tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(scene="ideal") as bench:
        palpate.run(Grouped(), bench, out=tmp_path / "cut", listeners=[steps(stop)])
    assert shown == [(0, "a"), (0, "a 0"), (1, "a 0"), (3, "b"), (3, "b 0"), (4, "b 0")]
    done = palpate.resume(tmp_path / "cut", Grouped)
    assert len(whole.result.points) == len(done.result.points) == 4
    assert done.run.digest() == whole.run.digest()


@dataclass(frozen=True)
class Asking(Waiting):
    """Asks a model, so that the scatter of mountings that is stored for the sensor belongs to the run."""

    name = "asking"

    def model_question(self, design: Design) -> RatioQuestion:
        return RatioQuestion(design.name, "experiment")

    def evaluate(self, points: Sequence[Reading], plan: Plan, lab: Lab) -> SimpleResult[Reading]:
        return SimpleResult(points, {"scatter": lab.mountings.means_u if lab.mountings else None})


@pytest.mark.parametrize("began_with", [None, 0.02])
def test_a_resumed_run_has_the_scatter_of_mountings_that_it_began_with(
    tmp_path: Path, began_with: float | None
) -> None:
    def store(scatter: float, created: str) -> None:
        install(MountingScatterCalibration(
            means_u=scatter, degrees_of_freedom=2, sets_u=0.005, sets_freedom=27, design="single", device="20260101",
            simulated=True, scene=read_scene("ideal").identity, source="run", created=created, expires="2999-01-01",
        ))  # fmt: skip

    if began_with is not None:
        store(began_with, "2026-01-01")
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(scene="ideal") as bench:
        palpate.run(Asking(), bench, out=tmp_path / "cut", listeners=[steps(interrupt_at(2))])
    store(0.05, "2026-01-02")
    assert palpate.resume(tmp_path / "cut", Asking).result.values == {"scatter": began_with}
    with palpate.open_bench(scene="ideal") as bench:
        assert palpate.run(Asking(), bench, out=tmp_path / "new").result.values == {"scatter": 0.05}
