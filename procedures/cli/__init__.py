"""The command line `palpate`. Modules that cost start-up time are imported inside the commands."""

from __future__ import annotations

import io
import signal
import sys

import click

from procedures.cli.accuracy import accuracy
from procedures.cli.bus import bus
from procedures.cli.calibrate import calibrate
from procedures.cli.characterise import characterise
from procedures.cli.contracts import contracts
from procedures.cli.model import model
from procedures.cli.new import new
from procedures.cli.options import Group
from procedures.cli.reproduce import reproduce
from procedures.cli.runs import runs
from procedures.cli.scene import scene
from procedures.cli.serve import serve
from procedures.cli.softness import softness
from procedures.cli.study import study
from procedures.cli.sweep import sweep
from procedures.cli.test import test


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Examples:\n\n  palpate sweep loads\n\n  palpate calibrate load-cell\n\n  palpate runs list",
)
@click.version_option(package_name="palpate")
def palpate() -> None:
    """Drive a bench for piezoelectric tactile sensors, or its simulation.

    Without --bench the bench is simulated: no hardware is needed. Results lie in runs/, stamped SIMULATED.
    """


for group in (
    sweep, study, calibrate, test, softness, characterise, serve, runs, contracts, model, scene, reproduce, accuracy,
    new, bus,
):  # fmt: skip
    palpate.add_command(group)


def main() -> None:
    """Run, and turn every mistake of the user's or the bench's into one message and an exit status.

    Exit status: 0 done, 1 the bench or the disk could not, 2 what was asked for cannot be, 130 interrupted,
    143 terminated.
    """
    from instrument.errors import PalpateError
    from procedures.arithmetic import same_everywhere

    same_everywhere()
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files can hold bytes that are no text
    try:
        status = palpate.main(prog_name="palpate", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt) as error:
        _complain("interrupted", error.__cause__ or error)  # what was noted of Ctrl-C is on click's cause
        sys.exit(130)
    except SystemExit as error:
        if error.code == 128 + signal.SIGTERM:
            _complain("terminated", error)
        raise
    except PalpateError as error:
        _complain(f"error: {error}", error)
        sys.exit(error.exit_code)
    except OSError as error:
        _complain(f"error: {error}", error)
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)


def _complain(message: str, error: BaseException) -> None:
    for line in (f"palpate: {message}", *getattr(error, "__notes__", ())):
        click.echo(line, err=True)
