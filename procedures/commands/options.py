"""Options that commands share, and how they speak: tables for people, one JSON object for machines."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar, cast

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.console.progress import Progress, bar, silent
from palpate.procedures.console.terminal import say

F = TypeVar("F", bound=Callable[..., object])


class Command(click.Command):
    """A command that refuses an option of one value which is given twice; click would take the last."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        parser = self.make_parser(ctx)
        single = [p for p in self.params if isinstance(p, click.Option) and not (p.multiple or p.is_flag or p.count)]
        for option in single:
            parser.add_option(option, option.opts, option.name, "append")
        given, _, _ = parser.parse_args(list(args))
        for option in single:
            values = [repr(value) for value in given.get(option.name, ())]
            if len(values) > 1 and not ctx.resilient_parsing:  # as a shell does that completes a line
                name = max(option.opts, key=len)
                raise UsageError(f"{name} is given {len(values)} times, as {' and '.join(values)}; give it once")
        return super().parse_args(ctx, args)


class Group(Command, click.Group):
    """A group of such commands."""

    command_class = Command
    group_class = type


def make_folder(out: Path | None) -> None:
    """A folder for a plot, before anything is measured for it. Raises RecordError: it cannot be made."""
    from palpate.procedures.records.run import storing

    if out is not None:
        with storing(out):
            out.mkdir(parents=True, exist_ok=True)


def output_options(command: F) -> F:
    """--json and --quiet."""
    command = click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")(command)
    return click.option("--quiet", "-q", is_flag=True, help="No progress and no tables.")(command)


DRY_RUN = click.option("--dry-run", is_flag=True, help="Print what would be done and how long it takes; send nothing.")

# What is done at a point: each comes as text.
sample_option = click.option("--sample", default="1", show_default=True, help="Rubber sample.")
load_option = click.option("--load", default="2 N", show_default=True, help="Load, peak to peak.")
dwell_option = click.option("--dwell", default="1 s", show_default=True, help="Time over which each point is averaged.")
frequency_option = click.option("--frequency", default="10 Hz", show_default=True, help="Frequency of the load.")


def extrapolate_option(command: F) -> F:
    """--extrapolate: the command gets it as `extrapolate`."""
    text = "Let loads pass that lie outside the calibrated range."
    return click.option("--extrapolate", is_flag=True, help=text)(command)


assume_option = click.option(
    "--assume-mounted", is_flag=True, help="Ask nobody to confirm what is mounted or placed; the record says so."
)


def budget_option(command: F) -> F:
    """--budget, of a command with `bench_options` above it: `output` then has `budgets`."""

    @functools.wraps(command)
    def gathered(*, budget: bool, output: Output, **own: object) -> object:
        return command(output=replace(output, budgets=budget), **own)

    text = "Print the uncertainty budget of each result; with --json it has them as budgets."
    return cast("F", click.option("--budget", is_flag=True, help=text)(gathered))


class _FileName(click.Path):
    """A path that is given: "" would be the current folder."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> str | bytes | os.PathLike[str]:
        if not value:
            self.fail("the name is empty; leave the option out, or name a file or folder", param, ctx)
        return super().convert(value, param, ctx)


FILE_NAME = _FileName(path_type=Path)
OUT = click.option("--out", type=FILE_NAME, metavar="DIR", help="Folder of this run (default: new in runs/).")


@dataclass(frozen=True, slots=True)
class Choice:
    """Which bench a command shall use, where its run and a log of its buses go; None: what is usual, no log.

    `assume_mounted`: nobody is asked to confirm what was mounted or placed by hand.
    """

    bench: Path | None
    scene: str | None
    seed: int | None
    out: Path | None
    log: Path | None = None
    assume_mounted: bool = False

    def simulated_on(self, scene: str) -> Choice:
        """It, on this scene where neither a scene nor a bench is named."""
        return self if self.bench or self.scene else replace(self, scene=scene)


def bench_options(command: F) -> F:
    """Options of every command that uses a bench: it gets them as `choice` and `output`."""

    @functools.wraps(command)
    def gathered(
        *,
        bench: Path | None,
        scene: str | None,
        seed: int | None,
        out: Path | None,
        log: Path | None,
        assume_mounted: bool,
        as_json: bool,
        quiet: bool,
        **own: object,
    ) -> object:
        return command(
            choice=Choice(bench, scene, seed, out, log, assume_mounted), output=Output(as_json, quiet), **own
        )

    options: Callable[..., object] = gathered
    for option in (
        assume_option,
        click.option(
            "--log",
            type=FILE_NAME,
            metavar="FILE",
            help="Record all traffic there (.pcapng), or CAN (.blf, .asc) and all beside it.",
        ),
        click.option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the simulated scene."),
        click.option(
            "--scene", metavar="NAME|FILE", help="Scene to simulate (default: the one named above, else thesis_single)."
        ),
        click.option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench."),
        OUT,
    ):
        options = option(options)
    return cast("F", output_options(options))


@dataclass(frozen=True, slots=True)
class Output:
    """How to speak. `budgets`: with the uncertainty budget of each result."""

    as_json: bool
    quiet: bool
    budgets: bool = False

    @property
    def for_people(self) -> bool:
        return not self.as_json and not self.quiet

    def json(self, value: Mapping[str, object]) -> None:
        """The one object on stdout."""
        click.echo(json.dumps(value, indent=2, allow_nan=False))

    def line(self, text: str) -> None:
        if self.for_people:
            say(text)

    def progress(self, first: str = "opening the bench") -> AbstractContextManager[Progress]:
        """A progress bar on stderr, where someone can see it."""
        return nullcontext(silent) if self.quiet else bar(first)
