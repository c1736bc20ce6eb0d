"""The command palpate live."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, LIVE_PORT, Output, StrictCommand, option, output_options
from palpate.procedures.console.terminal import say

LOOK = 0.2  # s between two looks whether somebody goes on with an interrupted run


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate live first-day\n\n  palpate live runs/20260102T030405Z-sweep-loads --port 8080"
    "\n\n  palpate live first-day --limits limits.toml",
)
@click.argument("run")
@option("--limits", type=FILE_NAME, metavar="FILE", help="Show the verdict by the limits in FILE once the run ends.")
@LIVE_PORT
@output_options
def live(run: str, limits: Path | None, port: int | None, as_json: bool, quiet: bool) -> None:
    """Show a run on a page in a browser of this machine until Ctrl-C. RUN is a folder or a name in runs/.

    The run may have ended long ago, or another process may carry it out or resume it meanwhile; it takes no notice. A
    damaged run is shown up to the damage. A bench command shows its own run with --live, where it can also be paused
    and stopped.
    """
    from palpate.drivers.clock import WallClock
    from palpate.instrument.errors import RecordError
    from palpate.procedures.engine.verdict import judge, read_limits
    from palpate.procedures.lab.store import store
    from palpate.procedures.live.feed import Feed
    from palpate.procedures.live.server import serving
    from palpate.procedures.records.chain import HEAD_FILE, read_head
    from palpate.procedures.records.events import Event, followed
    from palpate.procedures.records.run import Run, find_run

    output = Output(as_json, quiet)
    asked = None if limits is None else read_limits(limits)
    folder, feed, clock = find_run(run, store()), Feed(stored=True), WallClock()
    with suppress(RecordError):  # a damaged run is shown all the same
        if asked is not None and (ended := Run.open(folder)).status == "complete":
            judge(ended, asked)  # limits that it does not have are refused before there is a page
    with serving(feed, port or 0) as address:
        if as_json:
            output.json({"run": str(folder), "page": address})
        else:  # if quiet, too: nobody could guess the port
            say(f"live page: {address}")
        sys.stdout.flush()
        while True:
            try:
                for event in followed(folder):
                    feed(event)
                    if asked is not None and event.kind == "ended" and event.data["status"] == "complete":
                        feed.tell("verdict", judge(Run.open(folder), asked).summary())
            except RecordError as error:
                feed(Event("ended", 0, {"status": "damaged", "summary": {"error": str(error)}}))
                say(f"palpate: error: {error}", err=True)
            end = read_head(folder / HEAD_FILE)
            while read_head(folder / HEAD_FILE) == end:
                clock.wait(LOOK)
