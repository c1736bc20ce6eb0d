"""The end of a forked child is not the end of the bench that its parent has opened."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate.drivers.logs.bus_log import read_frames, read_pcapng
from palpate.instrument.errors import BenchError, BenchInUse
from palpate.procedures.records.damage import check
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.testing import steps
from tests.shares import first_of

pytestmark = pytest.mark.usefixtures("own_store")
SWEEP = palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.2)
ELSEWHERE = "a child that was forked from it; use the bench in that process"
STUCK = 20  # s, after which a child counts as hanging


def fork() -> int:
    """The id of a forked child, which does not hang; 0 in the child."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # newer Pythons warn of the threads that a bench has
        child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(STUCK)
    return child


def begun(work: Callable[[], object]) -> int:
    """Begin some work in a forked child; returns the child's process id."""
    child = fork()
    if child == 0:
        status = 1
        try:
            work()
            status = 0
        finally:
            os._exit(status)
    return child


def ended(child: int) -> int:
    """Wait for a child's end; returns its exit status, or minus the number of the signal that has ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def forked(work: Callable[[], object]) -> int:
    """Do some work in a forked child; returns its exit status."""
    return ended(begun(work))


@pytest.fixture
def sim() -> Iterator[SimulatedBench]:
    with SimulatedBench(read_scene("thesis_single")) as bench:
        yield bench


@pytest.fixture
def file(sim: SimulatedBench, tmp_path: Path) -> Path:
    """A bench file, with which the bench is opened as a real one."""
    path = tmp_path / "bench.toml"
    patient = sim.description.patient().model_copy(update={"watchdog": 60.0})  # else a slow machine feeds it meanwhile
    path.write_text(patient.to_toml(), encoding="utf-8")
    return path


@pytest.mark.parametrize("suffix", first_of([".pcapng", ".blf", ".asc"]))
def test_a_child_leaves_the_block_of_a_bench_at_once_which_goes_on_and_whose_log_holds_each_message_once(
    suffix: str, tmp_path: Path
) -> None:
    found = []
    for name in ("whole", "forked"):
        log = (tmp_path / name).with_suffix(suffix)
        with ExitStack() as block:
            bench = block.enter_context(palpate.open_bench(scene="thesis_single", seed=3, log=log))
            if name == "forked":
                assert forked(block.close) == 0
            table = palpate.run(SWEEP, bench, out=tmp_path / f"run of {name}").run.table()
            assert table["valid"].all() and not table["incidents"].any()
        packets = list(read_pcapng(log.with_suffix(".pcapng")))  # which compares the log with its hash
        frames = [] if suffix == ".pcapng" else sorted((each.identifier, each.data) for each in read_frames(log))
        found.append((len(packets), frames))
    assert found[0] == found[1]


def test_the_outputs_that_a_parent_has_switched_on_and_its_lock_outlast_its_children(
    sim: SimulatedBench, file: Path
) -> None:
    with ExitStack() as block:
        generator = block.enter_context(palpate.open_bench(bench=file)).bench.device("signal_generator")
        generator.set(amplitude=0.2)
        generator.set(output="on")

        def fails() -> None:
            with block:
                raise KeyboardInterrupt

        requests = sim.servers.transactions
        assert (forked(block.close), forked(fails), sim.servers.transactions) == (0, 1, requests)
        with pytest.raises(BenchInUse), palpate.open_bench(bench=file):
            pass
        ours, theirs = os.pipe()
        child = begun(lambda: (os.close(theirs), os.read(ours, 1)))  # it lives on, and keeps no bench taken
        assert generator.get("output") == 1
        block.close()
        assert sim.generator.settings["output"] == 0
        with palpate.open_bench(bench=file):
            pass
    os.close(theirs)
    assert ended(child) == 0
    os.close(ours)


def test_a_bench_that_is_used_in_a_child_is_refused_with_one_message_and_the_child_opens_its_own() -> None:
    with palpate.open_bench(scene="thesis_single", seed=3) as bench:

        def refused() -> None:
            uses: tuple[Callable[[], Any], ...] = (
                lambda: bench.bench.device("signal_generator").get("output"),
                lambda: bench.bench.device("sensor_node_1").get("serial"),  # on the CAN bus
                lambda: bench.bench.clock.wait(1.0),
                lambda: palpate.run(SWEEP, bench),
            )
            for use in uses:
                with pytest.raises(BenchError, match=ELSEWHERE):
                    use()
            with palpate.open_bench(scene="thesis_single", seed=4) as other:
                assert palpate.run(SWEEP, other).run.table()["valid"].all()

        assert forked(refused) == 0


class Child(BaseException):
    """What ends a child in the middle of a run."""


@pytest.mark.parametrize("error", first_of([Child, RuntimeError, SystemExit]))
def test_a_child_that_is_forked_within_a_run_writes_nothing_into_its_record(
    error: type[BaseException], tmp_path: Path
) -> None:
    parent, statuses = os.getpid(), list[int]()

    def fork_after_a_point(done: int, _total: int, _what: str) -> None:
        if done == 1 and not statuses:
            child = fork()
            if child == 0:
                raise error
            statuses.append(ended(child))

    runs = []
    try:
        for listeners in ([], [steps(fork_after_a_point)]):
            with palpate.open_bench(scene="thesis_single", seed=3) as bench:
                runs.append(palpate.run(SWEEP, bench, out=tmp_path / str(len(runs)), listeners=listeners).run)
    finally:
        if os.getpid() != parent:
            os._exit(7)
    assert statuses == [7]
    assert runs[0].digest() == runs[1].digest() and runs[0].events() == runs[1].events()
    assert not check(runs[1].folder).faults
