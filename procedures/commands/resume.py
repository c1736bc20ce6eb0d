"""The command palpate runs resume."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, assume_option, option, output_options
from palpate.procedures.lab.store import store


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate runs resume 20260102T030405Z-sweep-loads"
    "\n\n  palpate runs resume first-day --bench moved.toml --accept-change --json",
)
@click.argument("run")
@option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench (default: the run's own).")
@option("--accept-change", is_flag=True, help="Go on although bench or software changed; the record lists changes.")
@assume_option
@output_options
def resume(run: str, bench: Path | None, accept_change: bool, assume_mounted: bool, as_json: bool, quiet: bool) -> None:
    """Go on with a run that was killed, stopped or failed. RUN is a folder or a name in runs/.

    The bench is opened again and compared with the record: settings, devices, contracts, calibrations, versions. No
    finished point is lost or stored twice. A real bench continues at the next point, with its sample mounted again; a
    simulated bench repeats everything up to there, so that the finished run equals one without an interruption. If
    another machine computed the stored points, they are compared to a relative 1e-6; the record says so.
    """
    from palpate.procedures.commands.procedures import tell
    from palpate.procedures.engine.catalogue import class_of
    from palpate.procedures.engine.resume import begun, go_on
    from palpate.procedures.lab.keys import keyboard
    from palpate.procedures.records.run import Run, find_run

    opened = Run.open(find_run(run, store()))
    output = Output(as_json, quiet)
    procedure = begun(opened, class_of(opened, "resume"), bench)
    with keyboard() as pause, output.progress() as progress:
        done = go_on(
            procedure,
            opened,
            bench=bench,
            accept_change=accept_change,
            assume_mounted=assume_mounted,
            progress=progress,
            pause=pause,
        )
    return tell(procedure, done, output)
