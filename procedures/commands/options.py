"""Options that commands share, and their output: tables for people, one JSON object for machines."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import texts
from palpate.procedures.commands.texts import quantity, share
from palpate.procedures.console.terminal import Progress, say, shown, silent

if TYPE_CHECKING:
    from palpate.procedures.live.control import PageControl
    from palpate.procedures.live.feed import Feed
    from palpate.procedures.records.events import Event, Listener
    from palpate.procedures.steps.pause import Pause

F = TypeVar("F", bound=Callable[..., object])


LONGEST = 1000  # characters of a command's summary, more than any has
UNKNOWN_THICKNESS = 3e-3  # m
MANY = 100  # entries of a list in JSON

option = functools.partial(click.option, show_default=True)


class StrictCommand(click.Command):
    """A command that refuses an option that is given twice; click would silently take the last value."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        parser = self.make_parser(ctx)
        single = [p for p in self.params if isinstance(p, click.Option) and not (p.multiple or p.is_flag or p.count)]
        for option in single:
            parser.add_option(option, option.opts, option.name, "append")
        given, _, _ = parser.parse_args(list(args))
        for option in single:
            values = [repr(value) for value in given.get(option.name, ())]
            if len(values) > 1 and not ctx.resilient_parsing:  # no error while a shell completes the line
                name = max(option.opts, key=len)
                raise UsageError(f"{name} is given {len(values)} times, as {' and '.join(values)}; give it once")
        return super().parse_args(ctx, args)


class StrictGroup(StrictCommand, click.Group):
    """A group whose commands are of this kind."""

    command_class = StrictCommand
    group_class = type

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands with their whole summaries; click would cut them off at the end of a line."""
        listed = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, each.get_short_help_str(LONGEST)) for name, each in listed if each is not None])


def output_options(command: F) -> F:
    """Add the options --json and --quiet."""
    command = option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")(command)
    return option("--quiet", "-q", is_flag=True, help="No progress and no tables.")(command)


def picture_option(default: str) -> Callable[[F], F]:
    """The option --out of a command that draws a picture; `default`: where it is drawn without it."""
    says = f"File of the picture, .png or .svg (default: {default})."
    return option("--out", type=FILE_NAME, metavar="FILE", help=says)


BAR, EVENTS = "bar", "json"
PROGRESS = option(
    "--progress",
    type=click.Choice((BAR, EVENTS)),
    default=BAR,
    help="What stderr shows meanwhile: a bar, or each event of the run as a line of JSON.",
)

LIVE_PORT = option("--port", type=click.IntRange(1, 65535), help="Port of the live page (default: any free one).")


def live_options(command: F) -> F:
    """Add the options --live and --port; the command gets `live`: the port, 0 for any, or None without a page."""

    @functools.wraps(command)
    def gathered(*, live: bool, port: int | None, **own: object) -> object:
        if port is not None and not live:
            raise UsageError("--port: it is that of the live page; give --live, too")
        if live and own.get("dry_run"):
            raise UsageError("--live: a dry run measures nothing that a page could show; leave --live or --dry-run out")
        return command(live=(port or 0) if live else None, **own)

    text = "Show the run on a page in a browser of this machine, with an oscilloscope."
    return cast("F", option("--live", is_flag=True, help=text)(LIVE_PORT(gathered)))


def check_junit(path: Path | None) -> None:
    """Raises UsageError: the verdicts cannot be written there."""
    if path is not None and (path.is_dir() or not path.name):
        raise UsageError(f"--junit {path}: is a folder; name a file, such as {path / 'verdicts.xml'}")


DRY_RUN = option(
    "--dry-run",
    is_flag=True,
    help="Print what would be done, how long it takes and how uncertain results are; send nothing.",
)

dwell_option = option("--dwell", callback=quantity("s"), default="1 s", help="Time over which each point is averaged.")
thickness_option = option(
    "--thickness", callback=quantity("m", positive=True), help="Thickness of an unknown object (default: 3 mm)."
)


def unknown_thickness(given: float | None, samples: object) -> float:
    """Thickness of an unknown object [m]: the given one, or 3 mm.

    Raises UsageError: it is given for samples, which have their own; `samples`: None: there are none.
    """
    if given is not None and samples is not None:
        raise UsageError(
            "--thickness is that of an unknown object, and a sample has its own; leave it out, or give --modulus"
        )
    return UNKNOWN_THICKNESS if given is None else given


assume_option = option(
    "--assume-mounted", is_flag=True, help="Ask nobody to confirm what is mounted or placed; the record says so."
)


def budget_option(command: F) -> F:
    """Add the option --budget to a command with `bench_options` above it; its `output` then has `budgets`."""

    @functools.wraps(command)
    def gathered(*, budget: bool, output: Output, **own: object) -> object:
        return command(output=replace(output, budgets=budget), **own)

    text = "Print the uncertainty budget of each result; with --json it has them as budgets."
    return cast("F", option("--budget", is_flag=True, help=text)(gathered))


class _FileName(click.Path):
    """A path that is not empty, because "" would mean the current folder."""

    def convert(
        self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> str | bytes | os.PathLike[str]:
        if not value:
            self.fail("the name is empty; leave the option out, or name a file or folder", param, ctx)
        return super().convert(value, param, ctx)


FILE_NAME = _FileName(path_type=Path)
JUNIT = option("--junit", type=FILE_NAME, metavar="FILE", help="Write the verdicts to FILE as JUnit XML.")
WHERE = option(
    "--where",
    multiple=True,
    metavar="'NAME = VALUE'",
    help="Only runs for which this holds; NAME is what --about told, or one of run, procedure, started, status, "
    "simulated, scene, seed, points and settings.NAME. May be given several times.",
)
OUT = option("--out", type=FILE_NAME, metavar="DIR", help="Folder of this run (default: new in runs/).")


@dataclass(frozen=True, slots=True)
class BenchChoice:
    """The bench of a command, and its files.

    Attributes:
        bench: bench file of a real bench; None: the bench is simulated.
        scene: name or file of the scene; None: the default.
        seed: seed of the scene; None: the scene's own.
        out: folder of the run; None: a new one in the store.
        log: file for the bus traffic; None: no log.
        assume_mounted: True: nobody is asked to confirm what was mounted or placed by hand.
        fidelity: change of the result below which effects of the scene are left out; None: all are simulated.
        about: what the run says about itself, as it was typed.
        pace: most simulated seconds in a second of the wall's clock; None: no limit.
    """

    bench: Path | None
    scene: str | None
    seed: int | None
    out: Path | None
    log: Path | None = None
    assume_mounted: bool = False
    fidelity: float | None = None
    about: tuple[str, ...] = ()
    pace: float | None = None

    def simulated_on(self, scene: str) -> BenchChoice:
        """The same choice, with this scene if neither a scene nor a bench is named."""
        return self if self.bench or self.scene else replace(self, scene=scene)


def bench_options(command: F) -> F:
    """Add the options of every command with a bench, which the command gets as `choice` and `output`."""

    @functools.wraps(command)
    def gathered(
        *,
        bench: Path | None,
        scene: str | None,
        seed: int | None,
        out: Path | None,
        log: Path | None,
        assume_mounted: bool,
        fidelity: float | None,
        about: tuple[str, ...],
        pace: float | None,
        progress: str,
        live: int | None,
        limits: Path | None,
        junit: Path | None,
        as_json: bool,
        quiet: bool,
        **own: object,
    ) -> object:
        if junit is not None and limits is None:
            raise UsageError("--junit: it holds verdicts of limits; give them with --limits FILE")
        check_junit(junit)
        if pace is not None and own.get("dry_run"):
            raise UsageError("--pace: a dry run takes no time on the bench; leave --pace or --dry-run out")
        choice = BenchChoice(bench, scene, seed, out, log, assume_mounted, fidelity, about, pace)
        output = Output(as_json, quiet, progress, limits=limits, junit=junit, live=live)
        return command(choice=choice, output=output, **own)

    options: Callable[..., object] = gathered
    for each in (
        live_options,
        PROGRESS,
        JUNIT,
        option(
            "--limits",
            type=FILE_NAME,
            metavar="FILE",
            help="Judge the result by the limits in FILE. Exit status 3: one fails; 4: one is undecided, none fails.",
        ),
        assume_option,
        option(
            "--about",
            multiple=True,
            metavar="'KEY = VALUE'",
            help="What the run says about itself, such as 'operator = AB'; may be given several times.",
        ),
        option(
            "--log",
            type=FILE_NAME,
            metavar="FILE",
            help="Record all traffic in FILE (.pcapng), or CAN in FILE (.blf, .asc) and all traffic beside it.",
        ),
        option(
            "--fidelity",
            callback=share,
            help="Leave out of the scene what changes force and force ratio by no more, such as 1e-3.",
        ),
        option(
            "--pace",
            callback=quantity("", "1", positive=True),
            help="Seconds of the simulated bench for one of the wall's, at most: 1 plays it at the wall's speed.",
        ),
        option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the simulated scene."),
        option(
            "--scene",
            shell_complete=texts.complete_scene,
            metavar="NAME|FILE",
            help="Scene to simulate (default: thesis_single, if the text above names no other).",
        ),
        option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench."),
        OUT,
    ):
        options = each(options)
    return cast("F", output_options(options))


@dataclass(frozen=True, slots=True)
class Output:
    """The form of the output.

    Attributes:
        as_json, quiet: one JSON object, or nothing; else it is for people.
        shown: what stderr shows during a run, BAR or EVENTS.
        budgets: whether the uncertainty budget of each result belongs to it.
        limits: file by which the result is judged; None: it is not.
        junit: file for the verdicts as JUnit XML; None: there is none.
        live: port of the live page, 0 for any free one; None: there is none.
        page: what a live page is told while it is served.
        control: what it may ask for.
    """

    as_json: bool
    quiet: bool
    shown: str = BAR
    budgets: bool = False
    limits: Path | None = None
    junit: Path | None = None
    live: int | None = None
    page: Feed | None = None
    control: PageControl | None = None

    @property
    def for_people(self) -> bool:
        return not self.as_json and not self.quiet

    def json(self, value: Mapping[str, object]) -> None:
        """Print the one JSON object on stdout, with null for NaN and infinities."""
        try:
            text = _text(value)
        except (TypeError, ValueError):
            from palpate.procedures.records.record_file import plain

            text = _text(cast("Mapping[str, object]", plain(value)))
        click.echo(text)

    def result(self, summary: Callable[[], Mapping[str, object]], show: Callable[[], object]) -> None:
        """Print a result: what `summary` gives as the one JSON object, or for people by `show`; nothing if quiet."""
        if self.as_json:
            self.json(summary())
        elif self.for_people:
            show()

    def line(self, text: str) -> None:
        if self.for_people:
            say(text)

    def prices(self) -> AbstractContextManager[None]:
        """A context in which people are told on stderr what a long computation costs, before it begins."""
        from palpate.instrument.notice import notices_to

        return nullcontext() if self.quiet else notices_to(lambda text: say(f"palpate: note: {text}", err=True))

    def progress(self, first: str = "opening the bench") -> AbstractContextManager[Progress]:
        """A progress bar on stderr if it is a terminal, else a line now and then, but none beside JSON."""
        return nullcontext(silent) if self.quiet else shown(first, lines=not self.as_json)

    @contextmanager
    def served(self, pausable: bool) -> Iterator[Output]:
        """This output with its live page, which is served meanwhile, if there shall be one. Raises as `serving`."""
        if self.live is None:
            yield self
            return
        from palpate.procedures.live.control import PageControl
        from palpate.procedures.live.feed import Feed
        from palpate.procedures.live.server import serving

        control = PageControl()
        feed = Feed(("pause", "stop") if pausable else ("stop",))
        with serving(feed, self.live, control) as address:
            if self.shown == EVENTS:
                say(json.dumps({"event": "page", "address": address, "token": control.token}), err=True)
            else:
                say(f"live page: {address}", err=True)
                say(f"  the same with pause and stop, for you alone: {address}#{control.token}", err=True)
            yield replace(self, page=feed, control=control)

    def pause(self, keyboard: Pause) -> Pause:
        """Pauses by the keyboard, and by the live page if there is one."""
        if self.control is None:
            return keyboard
        self.control.keyboard = keyboard
        return self.control

    @contextmanager
    def listener(self) -> Iterator[Listener]:
        """A listener that shows what happens in a run: on a live page, and on stderr as a bar or as lines of JSON."""
        from palpate.procedures.engine.listeners import Traced, steps, told_to

        heard: list[Listener] = [] if self.page is None else [Traced(self.page)]
        with nullcontext(silent) if self.shown == EVENTS else self.progress() as progress:
            if self.shown == EVENTS:
                heard.append(_event_line)
            elif progress is not silent:
                heard.append(steps(progress))
            with told_to(heard) as listener:
                yield listener


def _event_line(event: Event) -> None:
    say(event.line(), err=True)


def _text(value: Mapping[str, object]) -> str:
    """JSON of an object. A list of many entries has each on a line: Python indents ten times as slowly as it writes."""
    members = []
    for name, member in value.items():
        if isinstance(member, list) and len(member) > MANY:
            text = "[\n    " + ",\n    ".join(json.dumps(entry, allow_nan=False) for entry in member) + "\n  ]"
        else:
            text = json.dumps(member, indent=2, allow_nan=False).replace("\n", "\n  ")
        members.append(f"{json.dumps(name)}: {text}")
    return "{\n  " + ",\n  ".join(members) + "\n}" if members else "{}"
