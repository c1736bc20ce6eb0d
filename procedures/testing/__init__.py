"""The pytest plugin: a fresh bench for each test, simulated or real.

Slow imports happen only when a test asks for a bench.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.drivers.watched_clock import WatchedClock
    from palpate.instrument.bench.description import BenchDescription
    from palpate.instrument.bench.operator import Operator
    from palpate.procedures.testing.benches import WatchedBench
    from palpate.simulators.scenes.scene import Scene

REAL: pytest.StashKey[BenchDescription] = pytest.StashKey()
WATCH: pytest.StashKey[WatchedBench] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("palpate").addoption(
        "--bench", dest="palpate_bench", metavar="FILE", help="Run on the real bench of this bench file, not on scenes."
    )


def pytest_configure(config: pytest.Config) -> None:
    """Give this process a store of its own, and read the bench file of `--bench`.

    Raises UsageError: the bench file is missing or wrong, or several workers would share the bench.
    """
    _own_store(config)
    config.addinivalue_line(
        "markers",
        "scene(name='thesis_single', *, seed=None, faults=()): what the simulated bench of this test is; a name, or"
        " a file beside the test; faults as in a scene's [[fault]]",
    )
    file = config.getoption("palpate_bench")
    if file is None:
        return
    if getattr(config.option, "dist", "no") != "no":
        raise pytest.UsageError(f"--bench {file}: one bench cannot serve several workers; give -n0")
    from palpate.procedures.testing.benches import described

    config.stash[REAL] = described(Path(file))


def _own_store(config: pytest.Config) -> None:
    """Have this process keep runs and calibrations in a folder of its own, until the configuration is taken down.

    What is stored elsewhere must not change the numbers of tests, nor tests what is stored there. Each worker of
    pytest-xdist is such a process. The folder is made once something is stored.
    """
    from palpate.procedures.lab.store import STORE

    own = Path(tempfile.gettempdir()) / f"palpate-store-{os.getpid()}-{os.urandom(4).hex()}"
    patch = pytest.MonkeyPatch()
    patch.setenv(STORE, str(own))
    config.add_cleanup(lambda: shutil.rmtree(own, ignore_errors=True))
    config.add_cleanup(patch.undo)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip tests that need a scene if the bench is real; else check the scene markers.

    A worker of pytest-xdist must not stop here, so that there the marked test itself fails.

    Raises UsageError: a marker names a scene or a fault that does not exist.
    """
    marked = [item for item in items if item.get_closest_marker("scene")]
    if REAL in config.stash:
        scenic = [item for item in items if "scene" in getattr(item, "fixturenames", ())]
        for item in {*marked, *scenic}:
            item.add_marker(pytest.mark.skip(reason="needs a simulated bench, and --bench gives a real one"))
    elif marked and not hasattr(config, "workerinput"):
        from palpate.procedures.testing.benches import marked_scene

        for item in marked:
            marked_scene(item)


@pytest.fixture
def scene(request: pytest.FixtureRequest) -> Scene:
    """The scene of this test's bench: the marker's scene, or thesis_single. A real bench has no scene."""
    from palpate.procedures.testing.benches import marked_scene

    try:
        return marked_scene(request.node)
    except pytest.UsageError as error:
        problem = str(error)
    pytest.fail(problem, pytrace=False)


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A bench for this test only, opened and identified. Its outputs are off before and after the test."""
    from palpate.procedures.testing.benches import real_bench, simulated_bench

    description = request.config.stash.get(REAL, None)
    opening = simulated_bench(request.getfixturevalue("scene")) if description is None else real_bench(description)
    with opening as watch:
        request.node.stash[WATCH] = watch
        with watch.bench:
            yield watch.bench


@pytest.fixture
def clock(bench: Bench) -> WatchedClock:
    """The clock of this test's bench, on which a test waits in bench time."""
    return bench.clock


@pytest.fixture
def operator(bench: Bench) -> Operator:
    """The operator of this test's bench, who mounts samples; on a real bench a person at the console (give -s)."""
    return bench.operator


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and WATCH in item.stash:
        from palpate.procedures.testing.benches import failure_report

        report.sections.append((f"palpate bench at {call.when}", failure_report(item, item.stash[WATCH])))
    return report
