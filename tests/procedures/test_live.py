"""The server of a live page, asked without a browser: who may ask, what it tells, and that no run waits for a page."""

from __future__ import annotations

import base64
import hashlib
import json
import signal
import socket
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

import palpate
from tests.campaigns import NIGHTLY
from tests.procedures.conftest import Palpate
from tests.procedures.live import ids, served, told, until, with_a_run
from tests.runs import made

LONG = ("sweep", "loads", "--loads", ", ".join(f"{1.5 + 0.002 * n:g} N" for n in range(1000)), "--dwell", "0.2 s")
SHORTER = ("sweep", "loads", "--samples", "1", "--loads", ", ".join(f"{1.5 + 0.04 * n:g} N" for n in range(60)))
HEADER = {"procedure": "own", "simulated": True, "started": "2026-01-02T03:04:05Z", "scene": None, "seed": None}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_a_run(tmp_path_factory.mktemp("store"))


def test_a_page_is_told_what_a_watcher_hears_and_what_the_record_knows(store: Path) -> None:
    with served(store, "live", "done") as live, live.stream() as stream:
        hello, *messages = until("ended", told(stream))
    assert (hello["event"], hello["version"], hello["controls"], hello["stored"]) == ("page", 1, [], True)
    (about,) = [each for each in messages if each["event"] == "about"]
    messages.remove(about)
    assert messages == [{"event": e.kind, "bench_ns": e.bench_ns, **e.data} for e in palpate.watch(store / "done")]
    assert about["devices"] == palpate.read(store / "done").header["devices"]
    assert {"name": "force_ratio", "unit": "", "u": "force_ratio_u"} in about["columns"]


def test_a_page_gets_the_stored_waveforms_of_a_point(store: Path) -> None:
    with served(store, "live", "done") as live:
        with live.stream() as stream:
            until("ended", told(stream))
        status, text = live.ask("/trace?point=2")
        missing = live.ask("/trace?point=9")
        wrong = live.ask("/trace?point=../../etc/passwd")
    trace = json.loads(text)
    run = palpate.read(store / "done")
    assert status == 200
    assert trace["films"] == run.waveform_names(2)
    assert trace["of"] == run.waveform(2, trace["films"][0]).size
    volts = np.frombuffer(base64.b64decode(trace["voltage"]), "<f4").reshape(len(trace["films"]), trace["samples"])
    for film, row in zip(trace["films"], volts, strict=True):
        assert np.array_equal(row, run.waveform(2, film))
    assert missing == (200, "null")
    assert wrong[0] == 404


@pytest.mark.parametrize(
    ("headers", "why"),
    [
        ({"Host": "evil.example"}, "Host is 'evil.example'; open http://127.0.0.1:"),
        ({"Origin": "http://evil.example"}, "Origin is 'http://evil.example'; only the page of palpate itself may ask"),
    ],
)
def test_pages_of_others_are_refused(store: Path, headers: dict[str, str], why: str) -> None:
    with served(store, "live", "done") as live:
        for path in ("/", "/events", "/trace?point=1"):
            status, text = live.ask(path, headers)
            assert (status, text[: len(why)]) == (403, why)


def test_the_page_may_load_nothing_from_elsewhere(store: Path) -> None:
    with served(store, "live", "done") as live, live.stream() as stream:
        assert stream.headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self';")
        assert live.ask("/../../pyproject.toml")[0] == 404
        assert live.ask("/stop", {"Origin": live.address.rstrip("/")}, "POST")[0] == 404


def test_what_draws_in_the_browser_is_as_its_maker_published_it() -> None:
    """Version 1.6.32 of uPlot in npm's registry."""
    folder = Path(palpate.__file__).parent / "procedures" / "live" / "page" / "uplot"
    for line in (folder / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


@pytest.mark.slow
def test_only_the_token_of_the_terminal_stops_a_run(tmp_path: Path) -> None:
    with served(tmp_path, *LONG, "--live", "--out", str(tmp_path / "run")) as live:
        own = {"Origin": live.address.rstrip("/")}
        with live.stream() as stream:
            until("point", told(stream))
            wrong = live.ask("/stop", {**own, "X-Palpate-Token": live.token[:-1]}, "POST")
            foreign = live.ask("/stop", {"Origin": "null", "X-Palpate-Token": live.token}, "POST")
            without = live.ask("/stop", {"X-Palpate-Token": live.token}, "POST")
            assert live.process.poll() is None
            assert live.ask("/stop", {**own, "X-Palpate-Token": live.token}, "POST") == (200, "asked")
            *_, last = told(stream)
        live.process.wait()
    assert wrong == (403, "wrong token; take the one that palpate printed in the terminal")
    assert (foreign[0], without[0]) == (403, 403)
    assert live.process.returncode == 128 + signal.SIGINT
    assert (last["event"], last["status"]) == ("ended", "stopped")
    assert palpate.read(tmp_path / "run").status == "stopped"


@pytest.mark.slow
def test_a_run_is_paused_and_goes_on_by_its_page(tmp_path: Path) -> None:
    with served(tmp_path, *LONG, "--live", "--out", str(tmp_path / "run")) as live, live.stream() as stream:
        allowed = {"Origin": live.address.rstrip("/"), "X-Palpate-Token": live.token}
        heard = told(stream)
        until("point", heard)
        live.ask("/pause", allowed, "POST")
        until("paused", heard)
        live.ask("/pause", allowed, "POST")
        until("resumed", heard)
        assert ids(until("point", heard)) > [1]


@pytest.mark.slow
def test_a_run_with_a_page_and_a_hundred_viewers_that_never_read_is_the_same(tmp_path: Path) -> None:
    words = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N, 4 N")
    with palpate.open_bench() as bench:
        alone = palpate.run(palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0, 4.0)), bench, out=tmp_path / "alone")
    with served(tmp_path, *words, "--live", "--out", str(tmp_path / "run")) as live, ExitStack() as open_:
        for _ in range(100):
            each = open_.enter_context(socket.create_connection(("127.0.0.1", live.port)))
            each.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{live.port}\r\n\r\n".encode())
        live.process.wait()
        assert live.process.stderr is not None
        assert "hears no more" not in live.process.stderr.read()
    assert live.process.returncode == 0
    assert palpate.read(tmp_path / "run").digest() == alone.run.digest()


def test_ten_viewers_at_once_hear_all_points(store: Path) -> None:
    with served(store, "live", "done") as live, ExitStack() as open_:
        for stream in [open_.enter_context(live.stream()) for _ in range(10)]:
            assert ids(until("ended", told(stream))) == [1, 2, 3]


def test_a_page_that_comes_late_is_told_of_few_points_of_many(tmp_path: Path) -> None:
    made(tmp_path / "many", HEADER, (({"x": float(n), "valid": n % 2 == 0}, {}) for n in range(5000)))
    with served(tmp_path, "live", "many") as live:
        with live.stream() as stream:  # until all is told
            until("ended", told(stream))
        with live.stream() as stream:
            hello, *messages = until("ended", told(stream))
    assert (hello["points"], hello["invalid"], hello["every"]) == (5000, 2500, 4)
    assert ids(messages) == list(range(1, 5001, 4))


def test_a_damaged_run_is_shown_up_to_the_damage(tmp_path: Path) -> None:
    made(tmp_path / "hurt", HEADER, (({"x": float(n)}, {}) for n in range(50)))
    record = tmp_path / "hurt" / "run.record"
    content = bytearray(record.read_bytes())
    content[content.index(b'"x":30.0') + 4] ^= 1
    record.write_bytes(content)
    with served(tmp_path, "live", "hurt") as live, live.stream() as stream:
        messages = until("ended", told(stream))
    assert ids(messages) == list(range(1, 31))
    assert messages[-1]["status"] == "damaged"
    assert "is damaged (point 31 is not as it was written)" in messages[-1]["summary"]["error"]


def kill_one(store: Path) -> None:
    """Leave a run of sixty points in a store, killed after the first ones."""
    with served(store, *SHORTER, "--live", "--out", str(store / "run")) as live, live.stream() as stream:
        until("point", told(stream))
        live.process.kill()


@pytest.mark.slow
def test_a_run_that_is_resumed_under_a_viewer_is_told_from_its_beginning(tmp_path: Path) -> None:
    kill_one(tmp_path)
    before = len(palpate.read(tmp_path / "run").points())
    with served(tmp_path, "live", "run") as live, live.stream() as stream:
        heard = told(stream)
        killed = until("ended", heard)
        assert (len(ids(killed)), killed[-1]["status"]) == (before, "killed")
        palpate.resume(tmp_path / "run")
        assert ids(until("ended", heard)) == list(range(1, 61))


@pytest.mark.slow
def test_a_resumed_run_shows_on_its_page_what_was_measured_before(tmp_path: Path) -> None:
    kill_one(tmp_path)
    with served(tmp_path, "runs", "resume", "run", "--live") as live, live.stream() as stream:
        assert ids(until("ended", told(stream))) == list(range(1, 61))


@pytest.mark.slow
def test_a_verdict_is_told(tmp_path: Path) -> None:
    (tmp_path / "limits.toml").write_text('["force ratio of sample 1"]\nhigh = 0.01\n')
    words = ("--samples", "1", "--limits", str(tmp_path / "limits.toml"), "--out", str(tmp_path / "run"))
    with served(tmp_path, "sweep", "loads", *words, "--live") as live, live.stream() as stream:
        (verdict,) = [each for each in told(stream) if each["event"] == "verdict"]
    assert verdict["verdict"] == "fail"


@pytest.mark.slow
def test_a_verdict_on_a_stored_run_is_told_to_each_page(store: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text('["force ratio of sample 1"]\nhigh = 0.01\n')
    with served(store, "live", "done", "--limits", str(limits)) as live:
        for _ in range(2):
            with live.stream() as stream:
                verdict = until("verdict", told(stream))[-1]
                assert (verdict["verdict"], verdict["verdicts"][0]["outcome"]) == ("fail", "fail")


def test_limits_of_what_a_run_does_not_have_are_refused(palpate: Palpate, store: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[warmth]\nhigh = 1\n")
    refused = palpate("live", str(store / "done"), "--limits", str(limits))
    assert refused.status == 2
    assert f"{limits}: unknown quantity of this result 'warmth'" in refused.err


@pytest.mark.slow
def test_one_page_shows_all_steps_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "nightly.toml").write_text(NIGHTLY)
    with served(tmp_path, "campaign", str(tmp_path / "nightly.toml"), "--live") as live, live.stream() as stream:
        messages = told(stream)
        heard = until("point", messages)
        with live.stream() as late:
            assert until("campaign", told(late))[-1]["done"] == 0
        heard += messages
        assert live.process.wait() == 0
    shown = [each for each in heard if each["event"] == "campaign"]
    assert [each["done"] for each in shown] == [0, 1, 2, 3]
    assert [each["name"] for each in shown[0]["steps"]] == ["cell", "films", "sweep"]
    begun = [each["procedure"] for each in heard if each["event"] == "begun"]
    assert begun == ["calibrate-load-cell", "calibrate-films", "sweep-loads"]
    assert [each["run"] for each in shown[-1]["steps"]] == [each["run"] for each in heard if each["event"] == "begun"]


@pytest.mark.slow
def test_a_served_bench_shows_its_devices_and_what_its_films_give(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    with served(tmp_path, "serve", "ideal", "--live", "--out", str(file)) as live, live.stream() as stream:
        heard = told(stream)
        shown = until("bench", heard)[-1]
        assert (shown["scene"], shown["simulated"], shown["faults"]) == ("ideal", True, [])
        assert dict(shown["devices"])["sensor nodes"] == "1 pre-operational"
        with palpate.open_bench(bench=file, assume_mounted=True) as bench:
            bench.bench.device("sensor_node_1").acquire(0.3)
        trace = until("trace", heard)[-1]
        assert (trace["rate"], trace["films"]) == (1000.0, ["rigid", "total"])
        live.process.terminate()
        assert live.process.wait() == 0


def test_what_cannot_be_served_is_refused(palpate: Palpate, store: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for words in (("live", str(store / "done")), ("sweep", "loads", "--live")):
            refused = palpate(*words, "--port", str(port))
            assert refused.status == 2
            assert refused.complaint.startswith(f"--port {port}: Address already in use; name another one")
    assert palpate("live", "nothing").complaint == (
        "unknown run 'nothing'; runs holds no run yet; measure one, as with palpate sweep loads, "
        "or set PALPATE_STORE to another folder"
    )
    without = palpate("sweep", "loads", "--port", "80")
    assert without.complaint == "--port: it is that of the live page; give --live, too"
    for words in (("sweep", "loads"), ("campaign", "nightly.toml")):
        dry = palpate(*words, "--live", "--dry-run")
        assert (dry.status, dry.out) == (2, "")
        assert dry.complaint.startswith("--live: a dry run measures nothing that a page could show; leave --live or")
    dry = palpate("sweep", "loads", "--pace", "1", "--dry-run")
    assert (dry.status, dry.out) == (2, "")
    assert dry.complaint == "--pace: a dry run takes no time on the bench; leave --pace or --dry-run out"


def test_a_quiet_viewer_tells_its_address(store: Path) -> None:
    with served(store, "live", "done", "--quiet") as live:
        assert live.ask("/")[0] == 200
