"""What a live page costs a run, and what it shows: on the wire, and in headless Chromium where that is installed."""

from __future__ import annotations

import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
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
from tests.benchmarks.row import Row, interleaved

SWEEP = palpate.LoadSweep(samples=("1", "2", "3"), loads=tuple(1.5 + 0.05 * n for n in range(50)), dwell=0.2)
SLOW = palpate.LoadSweep(samples=("1",), loads=tuple(1.5 + 0.1 * n for n in range(20)), dwell=0.2)
ROUNDS = 5
VIEWER = "import sys, urllib.request\nfor line in urllib.request.urlopen(sys.argv[1]): pass"
CHANNELS, RATE, RECORD, SECONDS = 8, 1000.0, 0.2, 8.0
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--window-size=1280,800",
)  # fmt: skip
NOTED = """window.noted = {};
new MutationObserver(() => { window.noted[document.getElementById('count').textContent.split(' ')[0]] ??= Date.now(); })
  .observe(document.getElementById('count'), {childList: true, characterData: true, subtree: true});"""


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        yield from _cost(Path(folder), readers=1, silent=0)
        yield from _cost(Path(folder), readers=5, silent=5)
    if shutil.which("chromium") and shutil.which("chromedriver"):
        yield from _latency()
        yield from _frames()
    else:
        yield Row("the live page in a browser", "apt-get install chromium chromium-driver", "measured")


def _cost(folder: Path, readers: int, silent: int) -> Iterator[Row]:
    number, digests = 0, set()

    def swept(*listeners: Any) -> None:
        nonlocal number
        number += 1
        with palpate.open_bench() as bench:
            out = folder / f"{readers}-{silent}-{number}"
            digests.add(palpate.run(SWEEP, bench, out=out, listeners=listeners).run.digest())

    swept()
    before, feed = _memory(), Feed()
    with serving(feed) as address, _viewers(address, readers, silent):
        alone, among = interleaved(swept, lambda: swept(Traced(feed)), ROUNDS)
        grown = _memory() - before
    viewers = f"{readers + silent} viewers, {silent} never read" if silent else "one viewer"
    yield Row(
        f"a sweep of {len(SWEEP.samples) * len(SWEEP.loads)} points with a live page and {viewers}: slower by",
        f"{100 * (among / alone - 1):.1f} % of {alone:.2f} s", "<= 5 %", among <= 1.05 * alone,
    )  # fmt: skip
    yield Row("  different digests, with and without", str(len(digests)), "1", len(digests) == 1)
    if silent:
        yield Row("  memory", f"{grown / 1e6:.1f} MB", "<= 20 MB", grown <= 20e6)


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


def _memory() -> int:
    """Memory of this process that is not swapped out [B]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


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


def _latency() -> Iterator[Row]:
    """When each point stands on the page, after it is on disk."""
    stored: dict[str, float] = {}
    pause = threading.Event()

    def stamp(event: palpate.Event) -> None:
        if event.kind == "point":
            stored[str(event.data["id"])] = time.time()
        if event.kind == "promise":  # which follows a point
            pause.wait(0.3)  # so that each point is shown by itself

    with tempfile.TemporaryDirectory() as folder, _browser() as driver:
        feed = Feed()
        with serving(feed) as address, palpate.open_bench() as bench:
            driver.get(address)
            driver.execute_script(NOTED)
            palpate.run(SLOW, bench, out=Path(folder) / "run", listeners=[InStep(stamp), Traced(feed)])
            pause.wait(0.5)
            shown = driver.execute_script("return window.noted")
    late = sorted(1e-3 * shown[number] - at for number, at in stored.items() if number in shown)
    yield Row(
        f"a point stands on the page after it is durable, at most of {len(late)} ({len(stored)} points)",
        f"{1e3 * late[-1]:.0f} ms, median {1e3 * late[len(late) // 2]:.0f} ms", "<= 200 ms",
        late[-1] <= 0.2 and len(late) == len(stored),
    )  # fmt: skip


def _frames() -> Iterator[Row]:
    """Frames of eight films at 1 kHz at the wall's speed, before and after a hundred thousand points."""
    films = [f"film {n}" for n in range(CHANNELS)]
    feed, pause = Feed(), threading.Event()
    begun = {"run": "", "points": 0, "procedure": "own", "simulated": True, "started": "", "scene": None, "seed": None}

    def played(driver: Any) -> tuple[float, float]:
        """Frames a second, and the part of a core that this process takes."""
        drawn, start, busy = driver.execute_script("return scope.draws"), time.monotonic(), time.process_time()
        for number in range(round(SECONDS / RECORD)):
            t = (number * RECORD * RATE + np.arange(RECORD * RATE)) / RATE
            voltage = np.array([np.sin(2 * np.pi * 40 * t + n) for n in range(CHANNELS)])
            feed(palpate.Event("trace", 0, {"rate": RATE, "films": films, "voltage": voltage}))
            pause.wait(start + (number + 1) * RECORD - time.monotonic())
        took = time.monotonic() - start
        used = (time.process_time() - busy) / took
        return (driver.execute_script("return scope.draws") - drawn) / took, used

    def told(first: int, last: int) -> None:
        for number in range(first, last + 1):
            values = {
                "sample": str(number % 6),
                "x": number % 100,
                "y": 1.0,
                "y_u": 0.1,
                **{f"v{n}": n for n in range(25)},
            }
            feed(palpate.Event("point", number, {"id": number, "values": values}))
            if number % 500 == 0:
                pause.wait(0.1)

    def heap(driver: Any, points: int) -> float:
        while not driver.execute_script("return state.last") >= points:
            pause.wait(0.2)
        pause.wait(1.0)
        driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
        used: float = driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"]
        return used

    with serving(feed) as address, _browser() as driver:
        driver.get(address)
        feed(palpate.Event("begun", 0, begun))
        pause.wait(1.0)
        played(driver)
        rate, used = played(driver)
        yield Row(
            f"the oscilloscope with {CHANNELS} films at 1 kHz at the wall's speed",
            f"{rate:.0f} frames/s",
            ">= 20",
            rate >= 20,
        )
        yield Row("  server and hooks", f"{100 * used:.1f} % of a core", "<= 3 %", used <= 0.03)
        told(1, 10_000)
        early = heap(driver, 10_000)
        told(10_001, 100_000)
        late = heap(driver, 100_000)
        rate, _ = played(driver)
        yield Row(
            "  memory of the page after 100,000 points, against after 10,000",
            f"{late / 1e6:.1f} MB / {early / 1e6:.1f} MB", "+- 10 %", abs(late / early - 1) <= 0.1,
        )  # fmt: skip
        yield Row("  frames then", f"{rate:.0f} frames/s", ">= 20", rate >= 20)
