"""What a terminal is sent, what happens where it is closed, and how long a run still takes."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import resource
import signal
import subprocess
import sys
import termios
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
from rich.console import Console
from rich.text import Text

from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.errors import LinkError
from palpate.procedures.commands.options import Output
from palpate.procedures.console import terminal as progress_module
from palpate.procedures.console.terminal import Spoken, clean, console
from palpate.procedures.lab.operator import Keyboard, keyboard
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import IDEAL_SCENE, Palpate

EVIL = "evil\x1b[31m\x07\x08\r\x9b2J\u202e"
SHOWN = "evil␛[31m␇␈␍\ufffd2J\ufffd"
SCENE = IDEAL_SCENE.replace('"ideal"', '"' + "".join(f"\\u{ord(c):04x}" for c in EVIL) + '"')
SMALL = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")


def harmless(text: str) -> bool:
    return all(character.isprintable() or character in "\n\t\ufffd" for character in text)


def test_whatever_a_text_holds_of_controls_only_tab_and_line_feed_reach_the_terminal() -> None:
    every = [chr(code) for code in range(0x3000)]
    cleaned = [clean(character) for character in every]
    controls = {c for c in every if unicodedata.category(c) in ("Cc", "Zl", "Zp")}
    assert set(cleaned) & controls == {"\t", "\n"}
    assert not {c for c in cleaned if unicodedata.bidirectional(c) in ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI")}
    assert all(len(shown) == 1 for shown in cleaned)
    assert all(shown == c for shown, c in zip(cleaned, every, strict=True) if c.isprintable())


def test_names_of_scenes_runs_and_files_reach_the_terminal_as_pictures(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / f"{EVIL}.toml").write_text(SCENE)
    for command in (
        ("scene", "show", f"{EVIL}.toml"),
        ("scene", "check", f"{EVIL}.toml"),
        ("scene", "show", f"no {EVIL}"),
        ("runs", "show", f"no {EVIL}"),
        ("bus", "show", f"{EVIL}.pcapng"),
        (f"no {EVIL}",),
        ("scene", "show", f"{EVIL}.toml", EVIL),
        (*SMALL, "--samples", EVIL),
    ):
        said = palpate(*command)
        assert harmless(said.out + said.err), command
        assert "Traceback" not in said.err
    assert "evil␛[31m" in palpate("scene", "show", f"{EVIL}.toml").out


@pytest.mark.slow
def test_a_run_of_such_a_scene_in_such_a_folder_is_shown_in_pictures(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / f"{EVIL}.toml").write_text(SCENE)
    for command in (
        (*SMALL, "--scene", f"{EVIL}.toml", "--out", EVIL),
        ("scene", "explain", f"{EVIL}.toml"),
        ("runs", "show", EVIL),
        ("runs", "list", "--out", "."),
        ("runs", "check", EVIL),
        ("runs", "export", EVIL, "--to", "csv"),
    ):
        said = palpate(*command)
        assert said.status == 0, said.err
        assert harmless(said.out + said.err), command
        assert "evil" in said.out


def test_what_a_bus_log_says_of_its_devices_reaches_the_terminal_as_pictures(palpate: Palpate) -> None:
    with Path("log.pcapng").open("wb") as file:
        log = PcapngWriter(file)
        log.write(Packet(1, EVIL, Link.LINE, False, bytes.fromhex("01 03 02 00 01 79 84")))
        log.end()
    said = palpate("bus", "show", "log.pcapng")
    assert (said.status, SHOWN in said.out, harmless(said.out)) == (0, True, True)


def test_colours_of_our_own_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    console(force_terminal=True, color_system="standard").print(Text(EVIL, "bold red"))
    assert capsys.readouterr().out.startswith("\x1b[1;31mevil␛[31m")


# --- files that are none, and too few of them ------------------------------------------------------------


@pytest.mark.parametrize("command", ["show", "replay"])
@pytest.mark.parametrize("name", ["/", ".", "/dev/null", "folder.blf", "pipe.pcapng", "pipe.asc"])
def test_what_is_no_bus_log_is_one_message(palpate: Palpate, command: str, name: str) -> None:
    Path("folder.blf").mkdir()
    for pipe in ("pipe.pcapng", "pipe.asc"):
        os.mkfifo(pipe)
    said = palpate("bus", command, name).refusal
    assert f"{name}: is no file, so no bus log" in said or f"{name}: no bus log" in said


def test_too_few_open_files_are_refused_before_anything_is_begun(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _what: (12, 4096))
    told = "only 12 files may be open at once, but a bench can need 128; run ulimit -n 128 first"
    assert palpate(*SMALL).complaint == told
    assert not Path("runs").exists()


def test_a_link_that_fails_for_want_of_files_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=9))
    monkeypatch.setattr(link.client, "connect", lambda: False)
    monkeypatch.setattr(os, "open", Mock(side_effect=OSError(errno.EMFILE, os.strerror(errno.EMFILE))))
    with pytest.raises(LinkError, match=r"cannot be opened: Too many open files in this program; .* ulimit -n"):
        link.open()


# --- a terminal that is closed -------------------------------------------------------------------------


PALPATE = str(Path(sys.executable).with_name("palpate"))


@pytest.mark.slow
@pytest.mark.parametrize(("ignored", "status", "left"), [(False, 129, "stopped"), (True, 1, "complete")])
def test_a_sweep_whose_terminal_is_closed_hangs_up_or_where_that_is_ignored_takes_all_points(
    ignored: bool, status: int, left: str, tmp_path: Path
) -> None:
    """The second cannot show its table, which is exit status 1; no point of it is lost."""
    run = tmp_path / "run"
    ours, theirs = os.openpty()

    def at_its_terminal() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
        fcntl.ioctl(0, termios.TIOCSCTTY)

    sweep = subprocess.Popen(
        [PALPATE, "sweep", "loads", "--samples", "1", "--out", str(run)],
        stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True, preexec_fn=at_its_terminal,
    )  # fmt: skip
    os.close(theirs)
    shown = b""
    while b"0/6" not in shown:  # the bench is open, and of six points none is there
        shown += os.read(ours, 4096)
    os.close(ours)
    assert (sweep.wait(), Run.open(run).status) == (status, left)


def test_a_command_without_standard_streams_ends_with_its_own_exit_status() -> None:
    closed = f"exec '{PALPATE}' nonsense <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", closed], timeout=60).returncode == 2


def test_no_file_gets_the_number_of_a_standard_stream_that_is_closed() -> None:
    """Else what a library writes to stderr could land in a record, or on a serial line."""
    script = (
        "import os, sys; from palpate.procedures.console.terminal import fill_streams; fill_streams();"
        "print('lost'); print('lost', file=sys.stderr); sys.exit(os.open(os.devnull, os.O_RDONLY) <= 2)"
    )
    assert (
        subprocess.run(["sh", "-c", f'exec "{sys.executable}" -c "{script}" <&- >&- 2>&-'], timeout=60).returncode == 0
    )


def test_nobody_presses_a_key_at_a_terminal_that_has_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "rb", buffering=0) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with keyboard() as pause:
            assert isinstance(pause, Keyboard)
            assert not pause.asked()
            os.close(ours)
            assert not pause.asked()
            pause.wait()


def test_progress_that_cannot_be_shown_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "w") as stderr:
        monkeypatch.setattr(sys, "stderr", stderr)
        with Output(False, False).progress() as progress:
            progress(1, 2, "here")
            os.close(ours)
            progress(2, 2, "gone")
        print("more", file=Spoken(), flush=True)  # type: ignore[call-overload]


# --- how long it still takes ---------------------------------------------------------------------------


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
    done, left = ([each[place] for each in told] for place in (0, 1))
    assert (done, left) == (sorted(done), sorted(left, reverse=True))
    assert took / 3 < left[0] < took


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--quiet", "--json"])
def test_no_line_where_none_is_wanted(lab: str, palpate: Palpate, bench_time: list[float], option: str) -> None:
    said = palpate(*SWEEP, "--bench", lab, option)
    assert (said.status, lines(said.err)) == (0, [])


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
