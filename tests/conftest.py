"""The simulated bench for tests, and the check that nothing of it stays behind.

The bench is imported where it is used: the process that hands the tests to the workers starts a second earlier.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import socket
import stat
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.instrument.bench.description import BenchDescription
    from palpate.simulators.bench import SimulatedBench
    from palpate.simulators.scenes.scene import Scene

SLOW = 300  # s
collect_ignore = ["examples"]  # projects of their own, which CI installs


def hasty(description: BenchDescription) -> BenchDescription:
    """The same bench with short time-outs, for tests in which a device does not answer at all."""
    return description.moved({name: {"timeout": "0.3 s"} for name in description.links})


def pytest_configure() -> None:
    """Ctrl-C is not ignored."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # in the background of a script: commands under test get it
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected lives until the end: the collector of garbage looks through it neither now nor later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """No test without a time-out: that of pyproject.toml, this for a slow one, or the one that a test names."""
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW))


def pytest_collection_finish() -> None:
    from palpate.simulators.faults import inject

    inject.TIMEOUT = "0.2 s"  # tests wait in vain a hundred times


@pytest.fixture(scope="session", autouse=True)
def curves(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Curves of sensors are kept for these tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_CURVES", str(tmp_path_factory.mktemp("curves")))
        yield


def open_ends() -> set[str]:
    """Every thread, socket and terminal of this process."""
    ends = {f"thread {thread.name} {thread.ident}" for thread in threading.enumerate()}
    for descriptor in (int(path.name) for path in Path("/dev/fd").iterdir()):
        with suppress(OSError):  # the listing's own descriptor is closed again
            status = os.fstat(descriptor)
            if stat.S_ISSOCK(status.st_mode) or os.isatty(descriptor):
                ends.add(f"descriptor {descriptor} inode {status.st_ino}")
    return ends


def latched(sim: SimulatedBench) -> frozenset[str]:
    """Latched faults, read behind the bus: a request would feed the watchdog."""
    return sim.amplifier.contract.set_bits("faults_latched", sim.amplifier.read("faults_latched"))


@pytest.fixture
def foreground() -> Iterator[None]:
    """Signals that end a program do so, however these tests were started."""
    numbers = (signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, signal.SIG_DFL) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.fixture
def closed_port() -> Iterator[int]:
    """A TCP port of 127.0.0.1 at which nothing answers, kept from other programs until the test ends."""
    with socket.socket() as kept:
        kept.bind(("127.0.0.1", 0))  # bound and not listening: connections are refused, and nobody else gets the port
        yield kept.getsockname()[1]


@pytest.fixture
def nothing_left_behind() -> Iterator[None]:
    before = open_ends()
    yield
    assert open_ends() - before == set()


@pytest.fixture(scope="session")
def scene() -> Scene:
    from palpate.simulators.planning.settle import read_scene

    return read_scene("thesis_single")


@pytest.fixture
def in_threads() -> None:
    """Simulated devices answer in threads of their own, also to others than the bench, and can be held up there."""


@pytest.fixture
def sim(request: pytest.FixtureRequest, nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    """A simulated bench, which answers in the waits of the fixture `bench` where a test has it without `in_threads`."""
    from palpate.simulators.bench import SimulatedBench

    stepped = "bench" in request.fixturenames and "in_threads" not in request.fixturenames
    with SimulatedBench(scene, stepped=stepped) as simulated:
        yield simulated


@pytest.fixture
def bench(sim: SimulatedBench) -> Iterator[Bench]:
    from palpate.drivers.bench import Bench

    with Bench(sim.description, sim.clock, sim.operator) as opened:
        yield opened


@pytest.fixture(params=["thin", "pymodbus"])
def codec(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """What answers requests on Modbus TCP. Private, because nobody else chooses it."""
    from palpate.simulators.wire import modbus

    if request.param == "pymodbus":
        monkeypatch.setattr(modbus, "THIN", frozenset())
    name: str = request.param
    return name


Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Puts a package where Python looks for installed ones: modules, and what it says of its entry points.

    Returns that folder, for the path of another process.
    """
    from palpate.instrument.additions import additions

    site = tmp_path_factory.mktemp("site-packages")
    monkeypatch.syspath_prepend(str(site))

    def installed(package: str, group: str, entries: Mapping[str, str], **modules: str) -> Path:
        about = site / f"{package}-1.2.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n", encoding="utf-8")
        lines = [f"[{group}]", *(f"{name} = {place}" for name, place in entries.items())]
        (about / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
        for module, text in modules.items():
            (site / f"{module}.py").write_text(text, encoding="utf-8")
        importlib.invalidate_caches()
        additions.cache_clear()
        return site

    before = set(sys.modules)
    yield installed
    for module in set(sys.modules) - before:
        if getattr(sys.modules[module], "__file__", None) and Path(sys.modules[module].__file__ or "").parent == site:
            del sys.modules[module]
    additions.cache_clear()
