"""Commands whose options are the settings of a procedure: what each option is stands at the procedure's field alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import ConfigError, UsageError
from palpate.procedures.commands import texts
from palpate.procedures.commands.options import (
    DRY_RUN,
    BenchChoice,
    Output,
    StrictCommand,
    bench_options,
    budget_option,
    option,
)

if TYPE_CHECKING:
    from palpate.procedures.engine.settings import SettingField

FIELD = "field_"  # prefix of a parameter for a field, so that no other parameter of the command has the same name
MODEL = option(
    "--model",
    shell_complete=texts.complete_model,
    metavar="NAME",
    help="Sensor model of the scene, as in `palpate model ratio`, or auto.",
)


class SettingsCommand(StrictCommand):
    """A command with an option for each setting of a procedure; its function gets those that are given as `settings`.

    The options come before --dry-run or --out. They are made when they are asked for: only then is the procedure
    imported, so that a group lists its commands at once.
    """

    def __init__(
        self,
        name: str | None,
        *,
        procedure: str,
        without: Sequence[str] = (),
        optional: Sequence[str] = (),
        callback: Callable[..., object],
        params: list[click.Parameter],
        help: str,  # noqa: A002  (click calls it so)
        epilog: str,
    ) -> None:
        """A command.

        Args:
            name: name of the command.
            procedure: name of the procedure.
            without: fields of the procedure that have no option here.
            optional: fields without a default that need not be given, because the function has another way to them.
            callback, params, help, epilog: as of every command of click; `params` are the options beside the settings.
        """
        self.procedure, self._without, self._optional = procedure, without, optional
        self._complete = False
        super().__init__(name, callback=callback, params=params, help=help, epilog=epilog)

    @property
    def params(self) -> list[click.Parameter]:
        """All options. Raises ConfigError: the procedure cannot be used, or one of its settings cannot be an option."""
        self.make_options()
        return self._params

    @params.setter
    def params(self, own: list[click.Parameter]) -> None:
        self._params = own

    def make_options(self) -> None:
        """Make the options of the settings. Raises as `params`."""
        if not self._complete:
            own = [_option(each, each.required and each.name not in self._optional) for each in self.settings()]
            _check_different(self.procedure, self._params, own)
            place = next(i for i, each in enumerate(self._params) if each.name in ("dry_run", "out"))
            self._params[place:place] = own
            self._complete = True

    def settings(self) -> list[SettingField]:
        """The settings that are options. Raises UnknownName, ConfigError: the procedure cannot be used."""
        from palpate.procedures.engine.catalogue import procedure_class
        from palpate.procedures.engine.settings import asked_of

        return [each for each in asked_of(procedure_class(self.procedure)) if each.name not in self._without]

    def invoke(self, ctx: click.Context) -> object:
        asked = {each.name: each for each in self.settings()}
        values = {name: ctx.params.pop(FIELD + name) for name in asked}
        given = {name: value for name, value in values.items() if value is not None}
        for name in given:
            if (other := asked[name].setting.determines) in given:
                raise UsageError(
                    f"{asked[other].option} and {asked[name].option}: the {name} determines the {other}; give only one"
                    " of them"
                )
        ctx.params["settings"] = given
        return super().invoke(ctx)


def conducting(
    name: str, procedure: str, text: str, *examples: str, scene: str | None = None, model: bool = False
) -> SettingsCommand:
    """A command that carries out a procedure on the bench of its options, or with --dry-run only plans it.

    Args:
        name: name of the command.
        procedure: name of the procedure.
        text: what the command does, for its help.
        examples: command lines, for its help.
        scene: scene that is simulated if the options name neither a scene nor a bench; None: the usual one.
        model: whether the scene's sensor model can be chosen.
    """

    def conduct(
        settings: Mapping[str, object], choice: BenchChoice, output: Output, dry_run: bool, model: str | None = None
    ) -> object:
        from palpate.procedures.commands.procedures import measure, plan
        from palpate.procedures.engine.catalogue import procedure_class
        from palpate.procedures.engine.settings import made

        chosen = choice if scene is None else choice.simulated_on(scene)
        return (plan if dry_run else measure)(made(procedure_class(procedure), settings), chosen, output, model)

    benched = bench_options(budget_option(conduct))
    epilog = "\n\n  ".join(("Examples:", *examples))
    decorate = click.command(name, cls=SettingsCommand, procedure=procedure, help=text, epilog=epilog)
    return decorate(DRY_RUN(MODEL(benched) if model else benched))


def _option(asked: SettingField, required: bool) -> click.Option:
    says = asked.setting.help
    if asked.default and asked.kind is not bool:
        says = f"{says}  [default: {asked.default}]".lstrip()
    given = partial(_read, asked)
    if asked.kind is bool:
        names = asked.option if asked.default == "no" else f"{asked.option}/--no-{asked.option.removeprefix('--')}"
        return click.Option([names, FIELD + asked.name], is_flag=True, default=None, callback=given, help=says)
    return click.Option(
        [asked.option, FIELD + asked.name],
        required=required,
        metavar=asked.metavar,
        multiple=asked.setting.repeated,
        shell_complete=texts.complete_model if asked.name == "model" else None,
        callback=given,
        help=says,
    )


def _read(
    asked: SettingField, _context: click.Context, _option: click.Parameter, given: str | bool | tuple[str, ...] | None
) -> object:
    return None if given is None or given == () else asked.value(given)


def _check_different(name: str, common: Sequence[click.Parameter], own: Sequence[click.Option]) -> None:
    """Raises ConfigError: two options of the command have the same name."""
    taken = {"--help", *(text for parameter in common for text in parameter.opts)}
    for each in own:
        texts = {*each.opts, *each.secondary_opts}
        if twice := texts & taken:
            field = str(each.name).removeprefix(FIELD)
            raise ConfigError(
                f"procedure {name!r}: field {field!r} cannot be the option {min(twice)}, which the command has "
                "already; give the field another name"
            )
        taken |= texts
