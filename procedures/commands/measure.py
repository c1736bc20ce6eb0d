"""The command palpate measure, which has a subcommand for each known procedure."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import ConfigError, PalpateError, UsageError
from palpate.procedures.commands.measure_modulus import modulus
from palpate.procedures.commands.options import (
    DRY_RUN,
    LONGEST,
    Choice,
    Command,
    Group,
    Output,
    bench_options,
    budget_option,
)

if TYPE_CHECKING:
    from palpate.procedures.engine.settings import Asked

FIELD = "field_"  # prefix of a parameter for a field, so that no other parameter of the command has the same name
OWN = {"modulus": modulus}  # commands with other options than the settings of their procedure
SERVED = frozenset({"measure-modulus"})  # procedures of these commands, which the list does not have twice
PLAIN = {float: "NUMBER", int: "INTEGER", str: "TEXT"}
EXAMPLES = "Examples:\n\n  palpate measure {0}{1}\n\n  palpate measure {0}{1} --scene ideal --dry-run"


class Known(Group):
    """A group with a command for each known procedure: palpate's own, and those of installed packages."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        from palpate.procedures.engine.known import names

        return [*OWN, *(name for name in names() if name not in SERVED)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        try:
            return OWN.get(cmd_name) or command_of(cmd_name)
        except PalpateError:
            if ctx.resilient_parsing:  # a shell completes a line
                return None
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the procedures; for one that cannot be used, say why."""
        rows = []
        for name in self.list_commands(ctx):
            try:
                found = OWN.get(name) or command_of(name)
                rows.append((name, found.get_short_help_str(LONGEST)))
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


def command_of(name: str) -> click.Command:
    """The command of a procedure.

    Raises:
        UnknownName: there is no procedure of that name.
        ConfigError: its package cannot be used, or one of its settings cannot be an option.
    """
    from palpate.procedures.engine.known import procedure_class
    from palpate.procedures.engine.settings import asked_of, made

    kind = procedure_class(name)
    asked = asked_of(kind)

    def carry_out(choice: Choice, output: Output, dry_run: bool, **given: str | bool | None) -> None:
        from palpate.procedures.commands.procedures import measure, plan

        values = {each.name: _value(each, text) for each in asked if (text := given[FIELD + each.name]) is not None}
        (plan if dry_run else measure)(made(kind, values), choice, output)

    written = inspect.cleandoc(vars(kind).get("__doc__") or "").partition("\n\n")[0]
    by_dataclass = written.startswith(f"{kind.__name__}(")  # the docstring that a dataclass makes if it has none
    needed = "".join(f" {_text(each)} ..." for each in asked if each.required)
    command = click.command(
        name, cls=Command, help=f"Carry out {name}." if by_dataclass else written, epilog=EXAMPLES.format(name, needed)
    )(DRY_RUN(bench_options(budget_option(carry_out))))
    own = [_option(each) for each in asked]
    _check_different(name, command.params, own)
    command.params[:0] = own
    return command


def _text(asked: Asked) -> str:
    return "--" + asked.name.strip("_").replace("_", "-")


def _option(asked: Asked) -> click.Option:
    text, says = _text(asked), asked.setting.help
    if asked.default:
        says = f"{says}  [default: {asked.default}]".lstrip()
    if asked.kind is bool:
        return click.Option([f"{text}/--no-{text[2:]}", FIELD + asked.name], default=None, help=says)
    one = "|".join(asked.choices) or (f"<{asked.setting.unit}>" if asked.setting.unit else PLAIN[asked.kind])
    metavar = f"{one},..." if asked.many else one
    return click.Option([text, FIELD + asked.name], required=asked.required, metavar=metavar, help=says)


def _check_different(name: str, common: Sequence[click.Parameter], own: Sequence[click.Option]) -> None:
    """Raises ConfigError: two options of the command have the same name."""
    taken = {"--help", *(text for each in common for text in each.opts)}
    for option in own:
        texts = {*option.opts, *option.secondary_opts}
        if twice := texts & taken:
            field = str(option.name).removeprefix(FIELD)
            raise ConfigError(
                f"procedure {name!r}: field {field!r} cannot be the option {min(twice)}, which the command has "
                "already; give the field another name"
            )
        taken |= texts


def _value(asked: Asked, given: str | bool) -> object:
    if isinstance(given, bool):
        return given
    try:
        return asked.value(given)
    except PalpateError as error:
        raise UsageError(f"{_text(asked)}: {error}") from None
