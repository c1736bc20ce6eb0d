"""The group palpate bus, with its commands show and replay."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from palpate.procedures.commands.bus_lss import lss
from palpate.procedures.commands.bus_scan import scan
from palpate.procedures.commands.options import FILE_NAME, OUT, Output, StrictGroup, output_options


@click.group(cls=StrictGroup)
def bus() -> None:
    """Find devices on buses, and look at the traffic of a run, which `--log FILE` of a command with a bench records."""


bus.add_command(scan)
bus.add_command(lss)


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus show trace.blf\n\n"
    "  palpate bus show trace.pcapng --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@output_options
def show(log: Path, as_json: bool, quiet: bool) -> None:
    """Decode a log of all traffic (.pcapng) or of CAN (.blf, .asc, .log of candump), with names, values and units.

    Times are those of the bench's clock, in seconds since the first message. Exit status 1: the log is damaged, or was
    cut off; what precedes that is shown.
    """
    from palpate.procedures.logs.shown import ShownMessage, read_log
    from palpate.procedures.records.chain import check_holes

    output = Output(as_json, quiet)
    check_holes(log)
    messages: list[ShownMessage] = []
    try:
        messages.extend(read_log(log))  # keeps the messages before a damage
        if output.as_json:
            output.json({"file": str(log), "messages": [asdict(message) for message in messages]})
    finally:
        channels = {message.channel for message in messages if message.channel}
        width = max(map(len, channels)) + 2 if len(channels) > 1 else 0
        for message in messages:
            place = message.channel.ljust(width)[:width]
            output.line(f"{message.time - messages[0].time:12.6f}  {place}{message.who:16}  {message.text}")


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus replay trace.pcapng"
    "\n\n  palpate bus replay trace.blf --out again --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@OUT
@output_options
def replay(log: Path, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Repeat the run of a log: the drivers receive the logged answers, and the points are the same to the byte.

    FILE is the .pcapng file of a log, or the CAN file beside it. Neither devices nor an operator are needed, and no
    time passes. Resulting calibrations are not stored for later runs. The replay stops at the first request that the
    log does not have at this place.
    """
    from palpate.procedures.commands.procedures import tell
    from palpate.procedures.engine.catalogue import class_of
    from palpate.procedures.engine.replay import do_again
    from palpate.procedures.lab.logged import LoggedRun
    from palpate.procedures.records.chain import check_holes

    check_holes(log)
    logged, output = LoggedRun(log), Output(as_json, quiet)
    procedure = class_of(logged.run, "replay").recorded(logged.run)
    with output.progress() as progress:
        done = do_again(procedure, logged, out, progress)
    return tell(procedure, done, output)
