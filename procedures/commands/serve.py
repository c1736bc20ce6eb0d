"""The command palpate serve."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.procedures.commands import texts
from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, option, output_options
from palpate.procedures.commands.texts import SCENE
from palpate.procedures.console.terminal import say

if TYPE_CHECKING:
    from palpate.instrument.bench.description import BenchDescription


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate serve thesis_single --out bench.toml\n\n"
    "  palpate serve thesis_single --out bench.toml --samples 1-6\n\n"
    "  palpate sweep loads --bench bench.toml    (in another terminal)\n\n"
    "  fault shaker_amplifier over_temperature    (typed while it serves)\n\n"
    "  palpate serve noisy_lab --port 1502 --line /tmp/line --can socketcan:vcan0 --status",
)
@SCENE
@option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the scene.")
@option("--listen", default="127.0.0.1", metavar="ADDRESS", help="Address of the Modbus TCP ports.")
@option("--port", type=click.IntRange(1, 65533), help="First Modbus TCP port (default: any free ports).")
@option("--line", type=FILE_NAME, metavar="PATH", help="Make PATH a link to the serial line's terminal.")
@option("--can", default="udp_multicast", metavar="INTERFACE[:CHANNEL]", help="CAN bus of python-can.")
@option(
    "--speed", default=1.0,
    help="Speed of the bench's clock against the wall clock; palpate --bench in another process needs 1.",
)  # fmt: skip
@option(
    "--step",
    callback=texts.quantity("s"),
    metavar="TIME",
    help="Let time stand still, and move it on by TIME at each Enter.",
)
@option("--samples", callback=texts.samples, help="Samples in the sample changer (default: no changer).")
@option(
    "--out",
    type=FILE_NAME,
    metavar="FILE",
    help="Write the bench file to FILE; only that of an earlier served bench is overwritten.",
)
@option("--status", is_flag=True, help="Show outputs, readings, faults and traffic.")
@option("--live", is_flag=True, help="Show them on a page in a browser of this machine, with an oscilloscope.")
@output_options
def serve(
    scene: str,
    seed: int | None,
    listen: str,
    port: int | None,
    line: Path | None,
    can: str,
    speed: float,
    step: float | None,
    samples: tuple[str, ...] | None,
    out: Path | None,
    status: bool,
    live: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Serve a whole simulated bench on the wire until Ctrl-C, for palpate in another process or any other client.

    A script ends it by SIGINT or SIGTERM, also where it was started with &.

    Prints the bench file with which clients find it. With --samples it has a sample changer, which clients command.

    Type what a person does at the bench: mount SAMPLE, lay SAMPLE|none, probe X Y, tooth N, weight MASS, turn DEGREES,
    warm KELVIN. Type faults with the names of a scene's [[fault]] tables: fault PLACE KIND [NAME=VALUE ...] gives a
    fault, clear PLACE [KIND] or clear all removes it, faults lists all. A fault without at, transaction or probability
    begins at once and lasts until it is cleared. Type quit to end.
    """
    from palpate.procedures.virtual.served_bench import Wish, serve_until_told

    output = Output(as_json, quiet)
    wish = Wish.asked(
        scene, seed=seed, listen=listen, port=port, can=can, line=line, speed=speed, step=step, samples=samples, out=out
    )

    def announce(bench: BenchDescription) -> None:
        if as_json:
            output.json(wish.summary(bench))
        output.line(bench.to_toml() if out is None else f"{out}: palpate sweep loads --bench {out}")
        sys.stdout.flush()

    shows_status = status and output.for_people
    if not live:
        serve_until_told(wish, announce, shows_status)
        return
    from palpate.procedures.live.feed import Feed
    from palpate.procedures.live.server import serving

    feed = Feed()
    with serving(feed) as address:
        say(f"live page: {address}", err=True)
        serve_until_told(wish, announce, shows_status, feed)
