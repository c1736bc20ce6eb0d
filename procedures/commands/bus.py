"""palpate bus."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, OUT, Group, Output, output_options


@click.group(cls=Group)
def bus() -> None:
    """Look at what went over the buses of a run (`--log FILE` of every command that uses a bench)."""


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus show trace.blf\n\n"
    "  palpate bus show trace.pcapng --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@output_options
def show(log: Path, as_json: bool, quiet: bool) -> None:
    """Decode a log, whole (.pcapng) or of CAN alone (.blf, .asc), with names, values and units.

    Times are of the bench's clock, in s since the first message.
    """
    from palpate.procedures.logs.shown import Line, read_log
    from palpate.procedures.records.holes import check_holes

    output = Output(as_json, quiet)
    check_holes(log)
    messages: list[Line] = []
    try:
        messages.extend(read_log(log))  # keeps what stands before the damage
        if output.as_json:
            output.json({"file": str(log), "messages": [asdict(message) for message in messages]})
    finally:
        for message in messages:
            output.line(f"{message.time - messages[0].time:12.6f}  {message.who:16}  {message.text}")


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus replay trace.pcapng"
    "\n\n  palpate bus replay trace.blf --out again --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@OUT
@output_options
def replay(log: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Do the run of a log again: the drivers hear what they heard then, and the points are the same to the byte.

    FILE is the .pcapng of a log, or the CAN file beside it. No device, nobody and no time is needed. Calibrations that
    come out are not kept for later runs. It ends at the first request that the log does not hold at that place.
    """
    from palpate.procedures.commands.procedures import tell
    from palpate.procedures.engine.known import class_of
    from palpate.procedures.engine.replay import do_again
    from palpate.procedures.lab.logged import LoggedRun
    from palpate.procedures.records.holes import check_holes

    check_holes(log)
    logged, output = LoggedRun(log), Output(as_json, quiet)
    procedure = class_of(logged.run, "replayed").recorded(logged.run)
    with output.progress() as progress:
        done = do_again(procedure, logged, out, progress)
    return tell(procedure, done, output)
