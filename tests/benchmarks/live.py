"""What those who listen cost a run, and what a live page shows, on the wire and in headless Chromium."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

import palpate
from palpate.procedures.engine.listeners import Traced
from palpate.procedures.live.feed import Feed
from palpate.procedures.live.server import serving
from palpate.testing import InStep
from tests.benchmarks.common import Row, at_least, at_most, interleaved
from tests.benchmarks.sweep import resident_memory

SWEEP = palpate.LoadSweep(samples=("1", "2", "3"), loads=tuple(1.5 + 0.05 * n for n in range(50)), dwell=0.2)
POINTS = len(SWEEP.samples) * len(SWEEP.loads)
SLOW = palpate.LoadSweep(samples=("1",), loads=tuple(1.5 + 0.1 * n for n in range(20)), dwell=0.2)
VIEWER = "import sys, urllib.request\nfor line in urllib.request.urlopen(sys.argv[1]): pass"
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--window-size=1280,800",
)  # fmt: skip
NOTED = """window.noted = {};
new MutationObserver(() => { window.noted[document.getElementById('count').textContent.split(' ')[0]] ??= Date.now(); })
  .observe(document.getElementById('count'), {childList: true, characterData: true, subtree: true});"""


def _slower(what: str, share: float, folder: Path, rounds: int, *listeners: Callable[..., object]) -> Iterator[Row]:
    """How much longer the sweep takes with some listeners, in turn with one without; whether it is the same."""
    digests: list[str] = []

    def swept(*heard_by: Any) -> None:
        with palpate.open_bench() as bench:
            out = folder / f"{what} {len(digests)}"
            digests.append(palpate.run(SWEEP, bench, out=out, listeners=heard_by).run.digest())

    swept()
    alone, among = interleaved(swept, lambda: swept(*listeners), rounds)
    slower = 100 * (among / alone - 1)
    yield at_most(
        f"a sweep of {POINTS} points with {what}: slower by",
        slower,
        share,
        "{:.0f} %",
        f"{slower:.1f} % of {alone:.2f} s",
    )
    different = len(set(digests))
    yield Row("  different digests, with and without", str(different), "1", different == 1)


def listeners(rounds: int = 5) -> Iterator[Row]:
    """What listeners cost a run: two of three are bad, one hangs and one fails."""
    never = threading.Event()

    def failing(_event: palpate.Event) -> None:
        raise RuntimeError("it fails")

    with tempfile.TemporaryDirectory() as folder:
        bad = (lambda _event: never.wait(), failing, lambda _event: None)
        yield from _slower("three listeners, one hangs and one fails", 2, Path(folder), rounds, *bad)
        never.set()


def live(rounds: int = 5) -> Iterator[Row]:
    """What a live page costs a run, and what it shows, in headless Chromium where that is installed."""
    for readers, silent in ((1, 0), (5, 5)):
        before, feed = resident_memory(), Feed()
        what = f"a live page and {readers + silent} viewers, of which {silent} never read"
        with (
            tempfile.TemporaryDirectory() as folder,
            serving(feed) as address,
            _viewers(address, readers, silent),
        ):
            yield from _slower(what, 5, Path(folder), rounds, Traced(feed))
            yield at_most("  memory", 1e-6 * (resident_memory() - before), 20, "{:.1f} MB")
    if shutil.which("chromium") and shutil.which("chromedriver"):
        yield _latency()
        yield from _frames()
    else:
        yield Row("the live page in a browser", "apt-get install chromium chromium-driver", "measured")


@contextmanager
def _viewers(address: str, readers: int, silent: int) -> Iterator[None]:
    """Processes that read the stream, and connections that never do."""
    port = urlsplit(address).port or 0
    with ExitStack() as ends:
        for _ in range(readers):
            process = subprocess.Popen([sys.executable, "-c", VIEWER, f"{address}events"], stderr=subprocess.DEVNULL)
            ends.callback(process.wait)
            ends.callback(process.kill)
        for _ in range(silent):
            each = ends.enter_context(socket.create_connection(("127.0.0.1", port)))
            each.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        time.sleep(1)  # noqa: TID251  (until all are there)
        yield


@contextmanager
def _browser() -> Iterator[Any]:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as data:
        for each in (*OPTIONS, f"--user-data-dir={data}"):
            options.add_argument(each)
        with webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver"))) as driver:
            yield driver


def _latency() -> Row:
    """When each point stands on the page, after it is on disk."""
    stored: dict[str, float] = {}
    pause = threading.Event()

    def stamp(event: palpate.Event) -> None:
        if event.kind == "point":
            stored[str(event.data["id"])] = time.time()
        if event.kind == "promise":  # which follows a point
            pause.wait(0.3)  # so that each point is shown by itself

    feed = Feed()
    with tempfile.TemporaryDirectory() as folder, _browser() as driver, serving(feed) as address:
        driver.get(address)
        driver.execute_script(NOTED)
        with palpate.open_bench() as bench:
            palpate.run(SLOW, bench, out=Path(folder) / "run", listeners=[InStep(stamp), Traced(feed)])
        pause.wait(0.5)
        shown = driver.execute_script("return window.noted")
    late = sorted(1e-3 * shown[number] - at for number, at in stored.items() if number in shown)
    return Row(
        f"a point stands on the page after it is durable, at most of {len(late)} ({len(stored)} points)",
        f"{1e3 * late[-1]:.0f} ms, median {1e3 * late[len(late) // 2]:.0f} ms", "<= 200 ms",
        late[-1] <= 0.2 and len(late) == len(stored),
    )  # fmt: skip


def _frames(seconds: float = 8.0, channels: int = 8) -> Iterator[Row]:
    """Frames of eight films at 1 kHz at the wall's speed, before and after a hundred thousand points."""
    rate, record = 1000.0, 0.2
    films = [f"film {n}" for n in range(channels)]
    feed, pause = Feed(), threading.Event()
    begun = {"run": "", "points": 0, "procedure": "own", "simulated": True, "started": "", "scene": None, "seed": None}

    def played(driver: Any) -> tuple[float, float]:
        """Frames a second, and the part of a core that this process takes."""
        drawn, start, busy = driver.execute_script("return scope.draws"), time.monotonic(), time.process_time()
        for number in range(round(seconds / record)):
            t = (number * record * rate + np.arange(record * rate)) / rate
            voltage = np.array([np.sin(2 * np.pi * 40 * t + n) for n in range(channels)])
            feed(palpate.Event("trace", 0, {"rate": rate, "films": films, "voltage": voltage}))
            pause.wait(start + (number + 1) * record - time.monotonic())
        took = time.monotonic() - start
        used = (time.process_time() - busy) / took
        return (driver.execute_script("return scope.draws") - drawn) / took, used

    def heap(driver: Any, first: int, last: int) -> float:
        """Memory of the page [MB] once it has these points, too."""
        more = {f"v{n}": n for n in range(25)}
        for number in range(first, last + 1):
            values = {"sample": str(number % 6), "x": number % 100, "y": 1.0, "y_u": 0.1, **more}
            feed(palpate.Event("point", number, {"id": number, "values": values}))
            if number % 500 == 0:
                pause.wait(0.1)
        while not driver.execute_script("return state.last") >= last:
            pause.wait(0.2)
        pause.wait(1.0)
        driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
        return 1e-6 * driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]

    with serving(feed) as address, _browser() as driver:
        driver.get(address)
        feed(palpate.Event("begun", 0, begun))
        pause.wait(1.0)
        played(driver)
        frames, used = played(driver)
        yield at_least(
            f"the oscilloscope with {channels} films at 1 kHz at the wall's speed", frames, 20, "{:.0f} frames/s"
        )
        yield at_most("  server and hooks", 100 * used, 3, "{:.1f} % of a core")
        early, late = heap(driver, 1, 10_000), heap(driver, 10_001, 100_000)
        yield Row(
            "  memory of the page after 100,000 points, against after 10,000",
            f"{late:.1f} MB / {early:.1f} MB",
            "+- 10 %",
            abs(late / early - 1) <= 0.1,
        )
        yield at_least("  frames then", played(driver)[0], 20, "{:.0f} frames/s")
