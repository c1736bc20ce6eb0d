"""The command palpate measure, which has a subcommand for each known procedure, and measure modulus."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

import click

from palpate.instrument.errors import ConfigError, PalpateError
from palpate.procedures.commands import calibrate, options, sweep, texts
from palpate.procedures.commands.characterise import characterise
from palpate.procedures.commands.options import LONGEST, StrictGroup, option
from palpate.procedures.commands.settings import SettingsCommand, conducting
from palpate.procedures.commands.softness import softness
from palpate.procedures.commands.test import modulus as test_modulus

if TYPE_CHECKING:
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.sensor.sample import Sample


# --- The command palpate measure modulus ---------------------------------------------------------------


@click.command(
    "modulus",
    cls=SettingsCommand,
    procedure="measure-modulus",
    optional=("object",),
    epilog="Examples:\n\n  palpate measure modulus --sample 4 --tolerance '5 %' --relative-to-model"
    "\n\n  palpate measure modulus --modulus '60 kPa' --time '2 min' --json"
    "\n\n  palpate measure modulus --bench lab.toml --tolerance '20 %' --dry-run",
)
@option(
    "--modulus",
    callback=texts.quantity("Pa", positive=True),
    help="Young modulus of an unknown object; on a real bench a guess.",
)
@options.thickness_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
def modulus(
    modulus: float | None,
    thickness: float | None,
    settings: Mapping[str, object],
    dry_run: bool,
    choice: options.BenchChoice,
    output: options.Output,
) -> object:
    """Measure the Young modulus of one object to a tolerance, or as well as a time allows.

    Before anything moves, a plan says how often the object is mounted, how many load sets there are, under which load
    and for how long, what that takes and what it is expected to give. A tolerance that no time reaches is refused, with
    the line that binds and other ways. On a real bench 50 kPa are expected of an object without --modulus.
    """
    from palpate.instrument.additions import check_ours
    from palpate.procedures.commands.procedures import chosen_by, measure, plan
    from palpate.procedures.engine.catalogue import GROUP, WHAT
    from palpate.procedures.engine.settings import made
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus

    check_ours(GROUP, WHAT, ["modulus"])  # the command's name is reserved
    design = chosen_by(choice).target.design
    sample = cast("Sample | None", settings.get("object"))
    touched = object_to_touch(design, sample, modulus, thickness, real=choice.bench is not None)
    return (plan if dry_run else measure)(made(ObjectModulus, {**settings, "object": touched}), choice, output)


def object_to_touch(
    design: Design, sample: Sample | None, modulus: float | None, thickness: float | None, real: bool
) -> Sample:
    """The object to mount.

    Raises UsageError: sample and modulus are both given, or neither for a simulated bench; or a sample and a thickness.
    """
    from palpate.instrument.errors import UsageError
    from palpate.procedures.measurements.object_modulus.procedure import UNKNOWN
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if sample is not None and modulus is not None:
        raise UsageError("--sample and --modulus: give either a sample or the modulus of an unknown object, not both")
    thick = options.unknown_thickness(thickness, sample)
    if sample is not None:
        return sample
    if modulus is None and not real:
        raise UsageError("--sample or --modulus is missing: name the object that the simulated bench touches")
    return unknown_object(design, thick, UNKNOWN if modulus is None else modulus, "unknown" if real else None)


# --- the group -----------------------------------------------------------------------------------------

# The commands of palpate's own procedures, which have names of their own, too.
OURS = {
    each.procedure: each
    for each in (
        sweep.loads, sweep.frequency, sweep.temperature, sweep.position, calibrate.load_cell, calibrate.films,
        calibrate.model, test_modulus, modulus, softness, characterise,
    )
}  # fmt: skip


class Known(StrictGroup):
    """A group with a command for each known procedure: palpate's own, and those of installed packages."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        from palpate.procedures.engine.catalogue import names

        return ["modulus", *(name for name in names() if name != modulus.procedure)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        try:
            return _command(cmd_name)
        except PalpateError:
            if ctx.resilient_parsing:  # a shell completes a line
                return None
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the procedures; for one that cannot be used, say why."""
        rows = []
        for name in self.list_commands(ctx):
            try:
                rows.append((name, _command(name).get_short_help_str(LONGEST)))
            except ConfigError as error:
                rows.append((name, f"Cannot be used: {error}."))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


@click.group(
    cls=Known,
    epilog="Examples:\n\n  palpate measure sweep-loads --help\n\n  palpate measure sweep-loads --loads '2 N, 3 N'",
)
def measure() -> None:
    """Carry out a procedure by its name: one that an installed package adds, or one of palpate's.

    Its settings are its options. A package adds procedures by entry points.
    """


def _command(name: str) -> SettingsCommand:
    """The command of a procedure.

    Raises:
        UnknownName: there is no procedure of that name.
        ConfigError: its package cannot be used, or one of its settings cannot be an option.
    """
    if ours := modulus if name == "modulus" else OURS.get(name):
        return ours
    from palpate.procedures.engine.catalogue import procedure_class
    from palpate.procedures.engine.settings import asked_of

    kind = procedure_class(name)
    written = inspect.cleandoc(vars(kind).get("__doc__") or "").partition("\n\n")[0]
    by_dataclass = written.startswith(f"{kind.__name__}(")  # the docstring that a dataclass makes if it has none
    needed = "".join(f" {each.option} ..." for each in asked_of(kind) if each.required)
    example = f"palpate measure {name}{needed}"
    made = conducting(
        name, name, f"Carry out {name}." if by_dataclass else written, example, f"{example} --scene ideal --dry-run"
    )
    made.make_options()
    return made
