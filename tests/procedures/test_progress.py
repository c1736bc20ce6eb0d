"""Who waits for a run on a bench is told how long it still takes, on a terminal and without one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from palpate.procedures.console import terminal as progress_module
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import Palpate

SWEEP = ("sweep", "loads", "--samples", "1,2,3", "--loads", "2 N, 3 N", "--dwell", "10 s", "--assume-mounted")
LINE = re.compile(r"palpate: progress: (\d) of 6(?:, about (\d+) (s|min) left)?; .+")


@pytest.fixture
def bench_time(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """What people see is timed by the bench's clock [s], and each look at it is kept."""
    looks: list[float] = []

    def now() -> float:
        looks.append(sim.clock.now_ns() / 1e9)
        return looks[-1]

    monkeypatch.setattr(progress_module, "monotonic", now)
    yield looks


def lines(err: str) -> list[tuple[int, float]]:
    """Finished points and seconds left of each line about the progress."""
    found = [LINE.fullmatch(line) for line in err.splitlines() if line.startswith("palpate: progress")]
    assert all(found), err
    units = {"s": 1, "min": 60, None: 0}
    return [(int(each[1]), int(each[2] or 0) * units[each[3]]) for each in found if each]


def test_without_a_terminal_a_line_now_and_then_says_how_long_it_still_takes(
    lab: str, palpate: Palpate, bench_time: list[float]
) -> None:
    said = palpate(*SWEEP, "--bench", lab)
    assert said.status == 0, said.err
    told, took = lines(said.err), bench_time[-1] - bench_time[0]
    assert 3 <= len(told) <= took / progress_module.LEAST
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    left = [seconds for _, seconds in told]
    assert left == sorted(left, reverse=True)
    assert took / 3 < left[0] < took


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--quiet", "--json"])
def test_no_line_where_none_is_wanted(lab: str, palpate: Palpate, bench_time: list[float], option: str) -> None:
    said = palpate(*SWEEP, "--bench", lab, option)
    assert (said.status, lines(said.err)) == (0, [])


def test_a_short_run_has_no_line(palpate: Palpate) -> None:
    said = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
    assert (said.status, said.err) == (0, "")


@pytest.mark.slow
def test_a_bar_shows_the_time_of_the_plan_before_anything_is_measured(
    lab: str, palpate: Palpate, bench_time: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = Path("bar").open("w+", encoding="utf-8")  # noqa: SIM115
    screen = Console(file=written, force_terminal=True, width=100, color_system=None)
    monkeypatch.setattr(progress_module, "console", lambda **_: screen)
    assert palpate(*SWEEP, "--bench", lab, "--json").status == 0
    written.seek(0)
    first = next(frame for frame in re.split(r"[\r\n]", written.read()) if "0/6" in frame)
    written.close()
    assert re.search(r" 0/6 [5-9] min ", first), first
