"""palpate runs resume."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.procedures.commands.characterise import of_characterise
from palpate.procedures.commands.options import FILE_NAME, Choice, Command, Output, assume_option, output_options
from palpate.procedures.lab.store import store

if TYPE_CHECKING:
    from palpate.procedures.engine.unconverted import Procedure
    from palpate.procedures.records.run import Run


def unconverted() -> dict[str, Callable[[], Procedure[Any, Any]]]:
    """The procedures that `engine/known.py` does not have yet, by the name in their header."""
    return {
        "characterise": of_characterise,
    }


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate runs resume 20260102T030405Z-sweep-loads"
    "\n\n  palpate runs resume first-day --bench moved.toml --accept-change --json",
)
@click.argument("run")
@click.option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench (default: the run's own).")
@click.option("--accept-change", is_flag=True, help="Go on although the bench has changed; the record says how.")
@assume_option
@output_options
def resume(run: str, bench: Path | None, accept_change: bool, assume_mounted: bool, as_json: bool, quiet: bool) -> None:
    """Go on with a run that was killed, stopped or failed. RUN is a folder or a name in runs/.

    The bench is opened again and compared with the record: settings, devices, contracts, calibrations, versions. No
    finished point is lost or stored twice. A real bench begins at the next point, its sample mounted anew; a simulated
    one does everything again up to there, so that the finished run equals one that was never interrupted. Where the
    last digits of numbers are another machine's, stored points are compared to 1e-6 of each; the record says so.
    """
    from palpate.procedures.commands.measure import tell
    from palpate.procedures.engine.known import class_of
    from palpate.procedures.engine.resume import begun, go_on
    from palpate.procedures.lab.keys import keyboard
    from palpate.procedures.records.run import Run
    from palpate.procedures.records.run_list import find_run
    from palpate.procedures.showing.runs import unhashed

    opened = Run.open(find_run(run, store()))
    output = Output(as_json, quiet)
    if opened.procedure in unconverted():
        return _resume_unconverted(opened, bench, accept_change, assume_mounted, output)
    procedure = begun(opened, class_of(opened, "resumed"), bench)
    for line in unhashed(opened.hashed):
        output.line(line)
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


def _resume_unconverted(opened: Run, bench: Path | None, accept: bool, assume: bool, output: Output) -> None:
    from palpate.instrument.errors import UsageError
    from palpate.procedures.engine.unconverted import conduct
    from palpate.procedures.lab.keys import keyboard
    from palpate.procedures.records.resumed import Resumed, header_of, settings_of
    from palpate.procedures.showing.runs import unhashed

    procedure = unconverted()[opened.procedure]()
    if simulated := header_of(opened)["scene"] is not None:
        if bench is not None:
            raise UsageError("--bench: the run was on a simulated bench; leave it out")
    elif not procedure.continues and opened.points():
        raise UsageError(
            f"{opened.folder}: on a real bench {opened.procedure!r} cannot go on in the middle, its points belong "
            "together; run it anew"
        )
    settings = settings_of(opened, procedure.settings)
    for line in unhashed(opened.hashed):
        output.line(line)
    record = Resumed(opened, replay=simulated, accept=accept)
    try:
        with keyboard() as pause:
            conduct(
                procedure,
                settings,
                _choice(opened, bench, assume),
                output,
                pause=pause,
                resumed=record,
            )
    finally:
        record.close()


def _choice(run: Run, bench: Path | None, assume: bool) -> Choice:
    """The bench of a run: its own files, which a run that was killed at its start may lack."""
    from palpate.procedures.records.record import put_file

    scene: Any = run.header["scene"]
    path = run.folder / ("scene.toml" if scene else "bench.toml")
    if not path.exists():
        put_file(path, scene["toml"] if scene else str(run.header["bench"]))
    if scene:
        return Choice(None, str(path), None, None, assume_mounted=assume)
    return Choice(bench or path, None, None, None, assume_mounted=assume)
