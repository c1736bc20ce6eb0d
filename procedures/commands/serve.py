"""palpate serve."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.procedures.commands.options import FILE_NAME, Command, Output, output_options

if TYPE_CHECKING:
    from palpate.instrument.bench.description import BenchDescription


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate serve thesis_single --out bench.toml\n\n"
    "  palpate serve thesis_single --out bench.toml --samples 1-6    (and elsewhere)\n\n"
    "  palpate sweep loads --bench bench.toml\n\n"
    "  fault shaker_amplifier over_temperature    (typed while it serves)\n\n"
    "  palpate serve noisy_lab --port 1502 --line /tmp/line --can socketcan:vcan0 --status",
)
@click.argument("scene")
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the scene.")
@click.option("--listen", default="127.0.0.1", show_default=True, metavar="ADDRESS", help="Of the Modbus TCP ports.")
@click.option("--port", type=click.IntRange(1, 65533), help="First Modbus TCP port (default: any that are free).")
@click.option("--line", type=FILE_NAME, metavar="PATH", help="Name of the serial line, a link to its terminal.")
@click.option("--can", default="udp_multicast", show_default=True, metavar="INTERFACE[:CHANNEL]", help="Of python-can.")
@click.option(
    "--speed", default=1.0, show_default=True,
    help="Of the bench's clock, to that of the wall; --bench of another process goes by the wall's and wants 1.",
)  # fmt: skip
@click.option("--step", metavar="TIME", help="Time stands still; Enter moves it on by so much.")
@click.option("--samples", help="Samples that a sample changer holds and mounts.")
@click.option("--out", type=FILE_NAME, metavar="FILE", help="Write the bench file there.")
@click.option("--status", is_flag=True, help="Show outputs, readings, faults and traffic.")
@output_options
def serve(
    scene: str,
    seed: int | None,
    listen: str,
    port: int | None,
    line: Path | None,
    can: str,
    speed: float,
    step: str | None,
    samples: str | None,
    out: Path | None,
    status: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Serve a whole simulated bench on the wire until Ctrl-C, for palpate in another process or any other client.

    Prints the bench file by which it is found. With --samples a sample changer mounts what its clients tell it to.

    What a person does at the bench is typed: mount SAMPLE, lay SAMPLE|none, probe X Y, tooth N, weight MASS, turn
    DEGREES, warm KELVIN. So are faults, as [[fault]] tables of a scene name them: fault PLACE KIND [NAME=VALUE ...]
    gives one, clear PLACE [KIND] or clear all takes it away, faults lists them. One without at, transaction or
    probability begins at once and lasts until it is cleared. quit ends it.
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

    serve_until_told(wish, announce, status and output.for_people)
