"""palpate bus."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from procedures.cli.options import FILE_NAME, Output, output_options


@click.group()
def bus() -> None:
    """Look at what went over the buses of a run (`--log FILE` of every command that uses a bench)."""


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus show trace.blf\n\n"
    "  palpate bus show trace.pcapng --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@output_options
def show(log: Path, as_json: bool, quiet: bool) -> None:
    """Decode a log of CAN (.blf, .asc) or Modbus traffic (.pcapng), with names, values and units.

    Times are of the bench's clock, in s since the first message.
    """
    from procedures.bus_log import read_log

    output = Output(as_json, quiet)
    messages = list(read_log(log))
    if output.as_json:
        output.json({"file": str(log), "messages": [asdict(message) for message in messages]})
    for message in messages:
        output.line(f"{message.time - messages[0].time:12.6f}  {message.who:16}  {message.text}")
