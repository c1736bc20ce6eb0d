"""The group of all commands. These import slow modules inside their functions, so that palpate starts fast."""

from __future__ import annotations

import contextlib
import io
import resource
import signal
import sys
import traceback
from pathlib import Path

import click

from palpate.procedures.commands.accuracy import accuracy
from palpate.procedures.commands.bus import bus
from palpate.procedures.commands.campaign import campaign
from palpate.procedures.commands.contracts import contracts
from palpate.procedures.commands.history import history
from palpate.procedures.commands.live import live
from palpate.procedures.commands.measure import measure, softness
from palpate.procedures.commands.model import model
from palpate.procedures.commands.new import new
from palpate.procedures.commands.options import StrictGroup
from palpate.procedures.commands.reproduce import reproduce
from palpate.procedures.commands.runs import judge, runs
from palpate.procedures.commands.scene import scene
from palpate.procedures.commands.serve import serve
from palpate.procedures.commands.short import calibrate, characterise, sweep, test
from palpate.procedures.commands.study import study
from palpate.procedures.console.terminal import draw_as_shipped, fill_streams, give_up, say

# --- Says which installed package's code raised an error that is none of palpate's ---------------------


def blamed(error: BaseException) -> str:
    """What failed in the code of an installed package, for people; empty if no such code was running.

    It names the package, the function that palpate called, the error, and the line of the package where it came up.
    """
    from palpate.instrument.additions import additions
    from palpate.instrument.bench.kinds import GROUP as KINDS
    from palpate.instrument.sensor.designs import GROUP as DESIGNS
    from palpate.procedures.engine.catalogue import GROUP as PROCEDURES
    from palpate.procedures.virtual.explained import GROUP as EFFECTS

    origins = {
        each.place.partition(":")[0].partition(".")[0]: each.origin
        for group in (PROCEDURES, KINDS, EFFECTS, DESIGNS)
        for several in additions(group).values()
        for each in several
    }
    frames = [
        (origins[module], frame.f_code, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if (module := str(frame.f_globals.get("__name__")).partition(".")[0]) in origins and module != "palpate"
    ]
    if not frames:
        return ""
    (origin, hook, _), (_, code, line) = frames[0], frames[-1]
    return (
        f"{origin}: {hook.co_qualname} failed: {type(error).__name__}: {error} ({Path(code.co_filename).name}, line"
        f" {line}); mend that package"
    )


# --- the group -----------------------------------------------------------------------------------------

UNREAD = 128 + signal.SIGPIPE  # exit status: nobody reads the output any more, as behind `| head`
ENDED: dict[object, str] = {128 + signal.SIGTERM: "terminated", 128 + signal.SIGHUP: "hung up"}  # exit status: message
MOST_FILES = 128  # files that may have to be open at once; a served bench with all its clients has about 100


@click.group(
    cls=StrictGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Examples:\n\n  palpate sweep loads\n\n  palpate calibrate load-cell\n\n  palpate runs list",
)
@click.version_option(package_name="palpate")
def palpate() -> None:
    """Drive a bench for piezoelectric tactile sensors, or its simulation.

    Without --bench the bench is simulated: no hardware is needed. Results are stored in runs/, marked SIMULATED.

    Exit status: 0 done; 1 the bench or the disk failed, or no point is valid; 2 wrong or impossible arguments; 3 a
    limit fails; 4 a limit is undecided, and none fails; 129 the terminal was closed; 130 interrupted by Ctrl-C; 141
    nobody reads the output any more; 143 terminated.
    """


for group in (
    sweep, study, calibrate, test, softness, characterise, measure, judge, live, history, serve, runs, contracts,
    model, scene, reproduce, accuracy, new, bus, campaign,
):  # fmt: skip
    palpate.add_command(group)


def run() -> None:
    """Run the command line, and turn every error into one message and the exit status that `palpate --help` lists."""
    fill_streams()
    draw_as_shipped()
    unread = False
    try:
        _run()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError as error:
                unread |= stream is sys.stdout and isinstance(error, BrokenPipeError)
                give_up(stream)
        if unread:
            sys.exit(UNREAD)


def _run() -> None:
    from palpate.instrument.errors import BenchError, PalpateError

    stdout = sys.stdout
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        # file names can contain bytes that are no text, and with LANG=C the stream takes ASCII alone
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        _check_files()
        status = palpate.main(prog_name="palpate", standalone_mode=False)
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        say(shown.getvalue().rstrip("\n"), err=True)
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt) as error:
        _complain("interrupted", error.__cause__ or error)  # click puts the notes of Ctrl-C on the cause
        sys.exit(130)
    except SystemExit as error:
        if error.code in ENDED:
            _complain(ENDED[error.code], error)
        if sys.stdout is not stdout:  # click has met a broken pipe: it puts another stream there, and exits with 1
            sys.exit(UNREAD)
        raise
    except PalpateError as error:
        of_package = isinstance(error, BenchError) and error.__cause__ and blamed(error.__cause__)
        _complain(f"error: {of_package or error}", error)
        sys.exit(error.exit_code)
    except OSError as error:
        if isinstance(before := error.__context__, SystemExit) and before.code in ENDED:
            raise before from None  # the program was ending already, and only its last message could not be written
        _complain(f"error: {blamed(error) or error}", error)
        sys.exit(1)
    except MemoryError as error:
        _complain("error: this computer has too little memory for it; take a smaller file or fewer points", error)
        sys.exit(1)
    except Exception as error:  # code of an installed package can raise anything
        if not (why := blamed(error)):
            raise
        _complain(f"error: {why}", error)
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)


def _check_files() -> None:
    """Raises BenchError: fewer files may be open at once than the sockets, terminals and records of a bench need."""
    from palpate.instrument.errors import BenchError

    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= allowed < MOST_FILES:  # -1: without limit
        raise BenchError(
            f"only {allowed} files may be open at once, but a bench can need {MOST_FILES}; run ulimit -n {MOST_FILES} "
            "first"
        )


def _complain(message: str, error: BaseException) -> None:
    with contextlib.suppress(OSError):  # the terminal may be gone
        for line in (f"palpate: {message}", *getattr(error, "__notes__", ())):
            say(line, err=True)
