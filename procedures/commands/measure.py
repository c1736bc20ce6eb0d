"""The command palpate measure, which has a subcommand for each known procedure."""

from __future__ import annotations

import inspect

import click

from palpate.instrument.errors import ConfigError, PalpateError
from palpate.procedures.commands import calibrate, sweep
from palpate.procedures.commands.characterise import characterise
from palpate.procedures.commands.measure_modulus import modulus
from palpate.procedures.commands.options import LONGEST, StrictGroup
from palpate.procedures.commands.settings import SettingsCommand, conducting
from palpate.procedures.commands.softness import softness
from palpate.procedures.commands.test import modulus as test_modulus

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
