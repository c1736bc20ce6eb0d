"""palpate serve."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Command, Output, output_options


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
    from palpate.instrument.errors import RangeError, UsageError
    from palpate.instrument.quantity import parse
    from palpate.instrument.sensor.sample import get_sample, parse_samples
    from palpate.procedures.virtual.served_bench import Wish, serve_until_told
    from palpate.simulators.bench import Place
    from palpate.simulators.planning.settle import read_scene

    if not 0.001 <= speed <= 1000:
        raise RangeError(f"--speed {speed:g} is outside 0.001 to 1000")
    pause = None if step is None else parse(step, "s")
    if pause is not None and not 0 < pause <= 3600:
        raise RangeError(f"--step {step} is outside 0 to 1 h")
    if line is not None and (line.exists() or line.is_symlink()):
        raise UsageError(f"--line {line} exists already; give another name")
    interface, _, channel = can.partition(":")
    chosen = read_scene(scene)
    wish = Wish(
        scene=chosen if seed is None else chosen.with_seed(seed),
        place=Place(listen, port or 0, interface, channel or None),
        line=line,
        speed=speed,
        step=pause,
        samples=tuple(get_sample(name) for name in parse_samples(samples)) if samples is not None else (),
        out=out,
    )
    serve_until_told(wish, Output(as_json, quiet), status)
