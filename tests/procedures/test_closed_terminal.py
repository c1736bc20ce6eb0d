"""A terminal that is closed under a command: it hangs up with exit status 129, or where that is ignored goes on."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from palpate.procedures.commands.options import Output
from palpate.procedures.console.terminal import Spoken
from palpate.procedures.lab.operator import Keyboard, keyboard
from palpate.procedures.records.run import Run

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
