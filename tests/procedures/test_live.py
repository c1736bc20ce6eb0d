"""The server of a live page without a browser, listeners and `palpate.watch`: what they hear; no run waits for them."""

from __future__ import annotations

import base64
import hashlib
import json
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate
from palpate.testing import InStep, steps
from tests.procedures.conftest import Palpate, interrupt_at
from tests.procedures.live import Served, ids, served, told, until, with_a_run
from tests.runs import NIGHTLY, flip, made

LONG = ("sweep", "loads", "--loads", ", ".join(f"{1.5 + 0.002 * n:g} N" for n in range(1000)), "--dwell", "0.2 s")
SHORTER = ("sweep", "loads", "--samples", "1", "--loads", ", ".join(f"{1.5 + 0.04 * n:g} N" for n in range(60)))
HEADER = {"procedure": "own", "simulated": True, "started": "2026-01-02T03:04:05Z", "scene": None, "seed": None}
FAILED = '["force ratio of sample 1"]\nhigh = 0.01\n'


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = with_a_run(tmp_path_factory.mktemp("store"))
    (folder / "limits.toml").write_text(FAILED)
    return folder


def test_each_page_is_told_what_a_watcher_hears_what_the_record_knows_and_the_verdict(store: Path) -> None:
    limits = ("--quiet", "--limits", str(store / "limits.toml"))
    with served(store, "live", "done", *limits) as live, ExitStack() as open_:
        heard = [until("verdict", told(stream)) for stream in [open_.enter_context(live.stream()) for _ in range(10)]]
    assert [(ids(messages), messages[-1]["verdict"]) for messages in heard] == [([1, 2, 3], "fail")] * 10
    hello, *messages, verdict = heard[0]
    assert (hello["event"], hello["version"], hello["controls"], hello["stored"]) == ("page", 1, [], True)
    (about,) = [each for each in messages if each["event"] == "about"]
    messages.remove(about)
    assert messages == [{"event": e.kind, "bench_ns": e.bench_ns, **e.data} for e in palpate.watch(store / "done")]
    assert about["devices"] == palpate.read(store / "done").header["devices"]
    assert {"name": "force_ratio", "unit": "", "u": "force_ratio_u"} in about["columns"]
    assert verdict["verdicts"][0]["outcome"] == "fail"


@pytest.fixture(scope="module")
def live(store: Path) -> Iterator[Served]:
    with served(store, "live", "done") as found:
        yield found


def test_a_page_gets_the_stored_waveforms_of_a_point(store: Path, live: Served) -> None:
    with live.stream() as stream:
        until("ended", told(stream))
    (status, text), missing, wrong = (live.ask(f"/trace?point={point}") for point in ("2", "9", "../../etc/passwd"))
    assert (status, missing, wrong[0]) == (200, (200, "null"), 404)
    trace, run = json.loads(text), palpate.read(store / "done")
    assert (trace["films"], trace["of"]) == (run.waveform_names(2), run.waveform(2, trace["films"][0]).size)
    volts = np.frombuffer(base64.b64decode(trace["voltage"]), "<f4").reshape(len(trace["films"]), trace["samples"])
    assert np.array_equal(volts, [run.waveform(2, film) for film in trace["films"]])


@pytest.mark.parametrize(
    ("headers", "why"),
    [
        ({"Host": "evil.example"}, "Host is 'evil.example'; open http://127.0.0.1:"),
        ({"Origin": "http://evil.example"}, "Origin is 'http://evil.example'; only the page of palpate itself may ask"),
    ],
)
def test_pages_of_others_are_refused(live: Served, headers: dict[str, str], why: str) -> None:
    found = [live.ask(path, headers) for path in ("/", "/events", "/trace?point=1")]
    assert [(status, text[: len(why)]) for status, text in found] == [(403, why)] * 3


def test_the_page_may_load_nothing_from_elsewhere(live: Served) -> None:
    with live.stream() as stream:
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
def test_only_the_token_of_the_terminal_pauses_and_stops_a_run(tmp_path: Path) -> None:
    with served(tmp_path, *LONG, "--live", "--out", str(tmp_path / "run")) as live, live.stream() as stream:
        origin, heard = live.address.rstrip("/"), told(stream)
        allowed = {"Origin": origin, "X-Palpate-Token": live.token}
        until("point", heard)
        refused = (
            {**allowed, "X-Palpate-Token": live.token[:-1]},
            {**allowed, "Origin": "null"},
            {"X-Palpate-Token": live.token},
        )
        wrong, *others = (live.ask("/stop", headers, "POST") for headers in refused)
        assert wrong == (403, "wrong token; take the one that palpate printed in the terminal")
        assert [status for status, _ in others] == [403, 403]
        for then in ("paused", "resumed"):
            live.ask("/pause", allowed, "POST")
            until(then, heard)
        assert ids(until("point", heard)) > [1]
        assert live.ask("/stop", allowed, "POST") == (200, "asked")
        *_, last = heard
        live.process.wait()
    assert (live.process.returncode, last["event"], last["status"]) == (128 + signal.SIGINT, "ended", "stopped")
    assert palpate.read(tmp_path / "run").status == "stopped"


@pytest.mark.slow
def test_a_run_with_a_page_and_a_hundred_viewers_that_never_read_is_the_same_and_its_verdict_is_told(
    tmp_path: Path,
) -> None:
    words = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N, 4 N")
    (tmp_path / "limits.toml").write_text(FAILED)
    with palpate.open_bench() as bench:
        alone = palpate.run(palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0, 4.0)), bench, out=tmp_path / "alone")
    judged = ("--limits", str(tmp_path / "limits.toml"), "--out", str(tmp_path / "run"))
    with served(tmp_path, *words, "--live", *judged) as live, ExitStack() as open_:
        messages = told(open_.enter_context(live.stream()))
        for _ in range(100):
            each = open_.enter_context(socket.create_connection(("127.0.0.1", live.port)))
            each.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{live.port}\r\n\r\n".encode())
        assert [each["verdict"] for each in messages if each["event"] == "verdict"] == ["fail"]
        live.process.wait()
        assert live.process.stderr is not None
        assert "hears no more" not in live.process.stderr.read()
    assert (live.process.returncode, palpate.read(tmp_path / "run").digest()) == (3, alone.run.digest())


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
    flip(tmp_path / "hurt" / "run.record", b'"x":30.0', 4)
    with served(tmp_path, "live", "hurt") as live, live.stream() as stream:
        messages = until("ended", told(stream))
    assert (ids(messages), messages[-1]["status"]) == (list(range(1, 31)), "damaged")
    assert "is damaged (point 31 is not as it was written)" in messages[-1]["summary"]["error"]


@pytest.mark.slow
def test_a_run_that_is_resumed_under_a_viewer_is_told_from_its_beginning_also_by_its_own_page(tmp_path: Path) -> None:
    with served(tmp_path, *SHORTER, "--live", "--out", str(tmp_path / "run")) as live, live.stream() as stream:
        until("point", told(stream))
        live.process.kill()
        live.process.wait()
    before = len(palpate.read(tmp_path / "run").points())
    with served(tmp_path, "live", "run") as live, live.stream() as stream:
        heard = told(stream)
        killed = until("ended", heard)
        assert (len(ids(killed)), killed[-1]["status"]) == (before, "killed")
        with served(tmp_path, "runs", "resume", "run", "--live") as own, own.stream() as its:
            for each in (heard, told(its)):
                assert ids(until("ended", each)) == list(range(1, 61))


def test_limits_of_what_a_run_does_not_have_are_refused(palpate: Palpate, store: Path, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[warmth]\nhigh = 1\n")
    refused = palpate("live", str(store / "done"), "--limits", str(limits)).refusal
    assert f"{limits}: unknown quantity of this result 'warmth'" in refused


@pytest.mark.slow
def test_one_page_shows_all_steps_of_a_campaign(tmp_path: Path) -> None:
    file = tmp_path / "nightly.toml"
    file.write_text(NIGHTLY)
    with served(tmp_path, "campaign", str(file), "--live") as live, live.stream() as stream:
        messages = told(stream)
        heard = until("point", messages)
        with live.stream() as late:
            assert until("campaign", told(late))[-1]["done"] == 0
        heard += messages
        assert live.process.wait() == 0
    shown, begun = ([each for each in heard if each["event"] == kind] for kind in ("campaign", "begun"))
    assert [each["done"] for each in shown] == [0, 1, 2, 3]
    assert [each["name"] for each in shown[0]["steps"]] == ["cell", "films", "sweep"]
    assert [each["procedure"] for each in begun] == ["calibrate-load-cell", "calibrate-films", "sweep-loads"]
    assert [each["run"] for each in shown[-1]["steps"]] == [each["run"] for each in begun]


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
    dry = "--live: a dry run measures nothing that a page could show; leave --live or"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        in_use = f"--port {port}: Address already in use; name another one"
        for words, told in (
            (("live", str(store / "done"), "--port", port), in_use),
            (("sweep", "loads", "--live", "--port", port), in_use),
            (("live", "nothing"), "unknown run 'nothing'; runs holds no run yet; measure one, as with palpate sweep "),
            (("sweep", "loads", "--port", "80"), "--port: it is that of the live page; give --live, too"),
            (("sweep", "loads", "--live", "--dry-run"), dry),
            (("campaign", "nightly.toml", "--live", "--dry-run"), dry),
            (("sweep", "loads", "--pace", "1", "--dry-run"), "--pace: a dry run takes no time on the bench; leave --"),
        ):
            assert palpate(*words).refusal.startswith(told)


# --- listeners, and those who watch in another process -------------------------------------------------


SWEEP = palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0), dwell=0.2)
NOT_STORED = ("step", "promise")  # what a record does not hold


def swept(out: Path, *listeners: Any) -> palpate.Run:
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench:
        return palpate.run(SWEEP, bench, out=out, listeners=listeners).run


def test_a_listener_and_a_watcher_hear_the_same_and_it_is_what_the_record_holds_on_disk_already(
    tmp_path: Path,
) -> None:
    heard: list[palpate.Event] = []
    on_disk: list[tuple[int, int]] = []

    def look(event: palpate.Event) -> None:
        if event.kind == "point":
            on_disk.append((event.data["id"], len(palpate.read(tmp_path / "run").points())))

    run = swept(tmp_path / "run", heard.append, InStep(look))
    assert on_disk == [(number, number) for number in (1, 2, 3, 4)]
    assert list(palpate.watch(run.folder)) == [event for event in heard if event.kind not in NOT_STORED]
    points = [{"bench_ns": e.bench_ns, "id": e.data["id"], **e.data["values"]} for e in heard if e.kind == "point"]
    assert points == run.points()
    kinds = [event.kind for event in heard]
    assert (kinds[:2], kinds[-1]) == (["begun", "planned"], "ended")
    assert (heard[1].data["points"], heard[-1].data["summary"]) == (4, run.summary)
    promises = [event.data for event in heard if event.kind == "promise"]
    left = [promise["seconds"] for promise in promises]  # it falls to what comes after the points
    assert left == sorted(left, reverse=True)
    assert left[0] == heard[1].data["seconds"] == run.summary["predicted_seconds"]
    assert (left[-1], promises[-1]["u"]) == (pytest.approx(0, abs=1e-9), run.summary["achieved_u"])


@pytest.mark.slow
def test_listeners_that_fail_or_hang_are_dropped_and_the_run_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[str] = []
    never = threading.Event()

    def failing(event: palpate.Event) -> None:
        raise SystemExit("no more")

    def hanging(event: palpate.Event) -> None:
        never.wait()

    alone = swept(tmp_path / "alone")
    among = swept(tmp_path / "among", hanging, failing, lambda event: heard.append(event.kind))
    never.set()
    assert (among.digest(), among.summary) == (alone.digest(), alone.summary)
    assert (heard.count("point"), heard[-1]) == (4, "ended")
    told = capsys.readouterr().err.splitlines()
    assert [line.split(" hears no more of this run: ")[1] for line in told] == [
        "it failed: SystemExit: no more",
        "it was busy with one event for more than 2 s when the run had ended",
    ]
    assert "failing" in told[0]


def test_a_watcher_that_comes_while_a_stopped_run_is_resumed_hears_it_to_its_new_end(tmp_path: Path) -> None:
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench, pytest.raises(KeyboardInterrupt):
        palpate.run(SWEEP, bench, out=tmp_path / "run", listeners=[steps(interrupt_at(3))])
    assert list(palpate.watch(tmp_path / "run"))[-1].data["status"] == "stopped"
    heard: list[palpate.Event] = []
    watcher = threading.Thread(target=lambda: heard.extend(palpate.watch(tmp_path / "run")))

    def look(event: palpate.Event) -> None:
        if event.kind == "begun":
            watcher.start()
            while not any(each.kind == "incident" for each in heard):  # it has read to the end of the stopped run
                watcher.join(0.01)

    palpate.resume(tmp_path / "run", listeners=[InStep(look)])
    watcher.join()
    assert [event.data["status"] for event in heard if event.kind == "ended"] == ["complete"]
    assert [event.data["id"] for event in heard if event.kind == "point"] == [1, 2, 3, 4]


def test_nothing_is_told_of_a_run_that_is_none_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    with pytest.raises(palpate.UnknownName, match="nothing"):
        palpate.watch(tmp_path / "nothing")
    made(tmp_path / "run", HEADER, (({"x": float(n)}, {}) for n in range(9)))
    flip(tmp_path / "run" / "run.record")
    with pytest.raises(palpate.RecordError, match=r"run\.record is damaged"):
        list(palpate.watch(tmp_path / "run"))


def test_a_command_writes_each_event_as_a_line_of_json(palpate: Palpate) -> None:
    said = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--progress", "json", "--json")
    events = [json.loads(line) for line in said.err.splitlines()]
    assert [each["event"] for each in events if each["event"] not in NOT_STORED] == [
        "begun", "planned", "point", "point", "ended",
    ]  # fmt: skip
    assert events[0]["run"] == said.object["run"]
    said = palpate("sweep", "loads", "--progress", "yaml")
    assert (said.status, "'yaml' is not one of 'bar', 'json'" in said.err) == (2, True)
