"""The settings of a procedure: their units and descriptions, checks of their types, and reading them from texts.

load: Annotated[float, Setting("N", "Load, peak to peak.")] = 2.0

In a script and in a record a setting is a number in this unit; on the command line it is a text, such as "200 gf". Its
option is made from its field alone (`commands/settings.py`).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from itertools import pairwise
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from palpate.instrument.errors import ConfigError, PalpateError, QuantityError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import parse, show
from palpate.instrument.refusals import wrong
from palpate.procedures.engine.procedure import P, Procedure, R, S
from palpate.procedures.steps.checks import parse_steps

SHOWN = 6  # greatest number of values of a default in a help text
EXAMPLE = "1 {0}:3 {0}:0.5 {0}"
PLAIN = {float: "NUMBER", int: "INTEGER"}
KINDS = "a float, int, bool, str, Literal of texts, a tuple[..., ...] of one of them, or one of them or None"

T = TypeVar("T", bound="Procedure[Any, Any, Any]")


@dataclass(frozen=True, slots=True)
class Setting:
    """The meaning of a procedure's field.

    Attributes:
        unit: unit of its numbers; empty: plain numbers.
        help: a sentence that describes it, for people.
        read: makes from a text what is annotated: in `Annotated[tuple[X, ...], Setting(...)]` the whole list, in
            `tuple[Annotated[X, Setting(...)], ...]` each of its values. Needed for values that are no text, number or
            bool.
        option: its option, where that is not named as the field, such as "--class"; empty: "--" and the field's name.
        metavar: what stands for its text in help; empty: its unit or kind.
        default: its default as people write it; empty: made from its value.
        example: a text that would be right, for messages; empty: its default, or any of that unit.
        repeated: whether each value of a list is given by an option of its own; False: with commas, in one option.
        determines: the field that it determines, which can then not be given as text beside it; empty: none.
    """

    unit: str = ""
    help: str = ""
    read: Callable[[str], object] | None = None
    option: str = ""
    metavar: str = ""
    default: str = ""
    example: str = ""
    repeated: bool = False
    determines: str = ""


@dataclass(frozen=True, slots=True)
class SettingField:
    """A field of a procedure that can be given as text.

    Attributes:
        name: name of the field.
        option: its option.
        kind: type of its value, or of each value of a list; `str` if the setting reads it.
        many: whether the texts of several values are read one by one.
        metavar: what stands for its text in help.
        choices: the allowed texts; empty: any.
        setting: its unit and description.
        default: its default as a text for people; empty: it has none.
        required: whether it must be given.
    """

    name: str
    option: str
    kind: type[float] | type[int] | type[str] | type[bool]
    many: bool
    metavar: str
    choices: tuple[str, ...]
    setting: Setting
    default: str
    required: bool

    def value(self, given: str | bool | tuple[str, ...]) -> object:
        """The value that a text stands for; of a repeated option, its texts; of a flag, whether it is given.

        Raises UsageError, which names the option: a text is not allowed.
        """
        if isinstance(given, bool):
            return given
        try:
            if isinstance(given, tuple):
                return tuple(self._one(text) for text in given)
            return self._read(given)
        except PalpateError as error:
            raise error if self.option in str(error) else UsageError(f"{self.option}: {error}") from None

    def _read(self, text: str) -> object:
        if not self.many:
            return self._one(text)
        if self.kind is float and ":" in text:
            return parse_steps(text, self.setting.unit, self.name, EXAMPLE.format(self.setting.unit))
        return tuple(self._one(part.strip()) for part in text.split(","))

    def _one(self, text: str) -> object:
        if self.setting.read is not None:
            try:
                return self.setting.read(text)
            except PalpateError:
                raise
            except (TypeError, ValueError) as error:  # a package's own function need not know palpate's errors
                raise UsageError(f"{text[:100]!r}: {error}") from error
        if self.kind is float:
            return parse(text, self.setting.unit, self.setting.example or ("" if self.many else self.default))
        if self.kind is int:
            try:
                return int(text)
            except ValueError:
                raise QuantityError(f"{text[:100]!r} is no whole number; write for example '3'") from None
        if self.choices and text not in self.choices:
            raise UnknownName(self.name, text, self.choices)
        return text


def check_settings(procedure: Procedure[S, P, R]) -> None:
    """Check that each setting has the type of its field (a list counts as a tuple), and is not empty by mistake.

    Raises:
        UsageError: a setting has a wrong type, or is empty although its default is not; or `procedure` is no procedure.
    """
    if not isinstance(procedure, Procedure):
        raise UsageError(f"{quoted(procedure)} is no procedure; give an object of one, such as LoadSweep(loads=(2.0,))")
    types = get_type_hints(type(procedure))
    for field in fields(procedure):
        value = getattr(procedure, field.name)
        what = f"{procedure.name}: {field.name} = {quoted(value)}"
        if isinstance(value, (tuple, list)) and not value and _default(field) not in ((), []):
            raise UsageError(f"{what}: nothing is given; give at least one")
        try:
            TypeAdapter(types[field.name]).validate_python(
                tuple(value) if isinstance(value, list) else value, strict=True
            )
        except ValidationError as error:
            kind = inspect.formatannotation(types[field.name])
            first = dict(error.errors(include_url=False)[0])
            inside = f": {quoted(first['input'])}" if first["loc"] else ""
            raise UsageError(f"{what}{inside} {wrong(first)}; its type is {kind}") from None


def asked_of(kind: type[Procedure[S, P, R]]) -> tuple[SettingField, ...]:
    """The settings of a procedure, in the order in which its class takes them.

    Raises ConfigError: one cannot be given as text.
    """
    who = f"procedure {kind.name!r} ({kind.__module__}.{kind.__qualname__})"
    try:
        hints = get_type_hints(kind, include_extras=True)
    except Exception as error:  # evaluating an annotation can raise anything
        raise ConfigError(
            f"{who}: its annotations cannot be read ({error}); import what they name at the top of its module"
        ) from error
    named = {each.name: each for each in sorted(fields(kind), key=lambda each: bool(each.kw_only))}
    for name, hint in hints.items():
        if name not in named and get_origin(hint) is not ClassVar and hint is not ClassVar:
            raise ConfigError(
                f"{who}: {name!r} is no field of a dataclass; put @dataclass(frozen=True) above the class"
            )
    return tuple(_asked(each, hints[name], who) for name, each in named.items() if each.init)


def made(kind: type[T], values: Mapping[str, object]) -> T:
    """A procedure with these settings, and defaults for the others. Raises UsageError: it refuses them."""
    make: Callable[..., T] = kind
    try:
        return make(**values)
    except PalpateError:
        raise
    except (TypeError, ValueError) as error:
        raise UsageError(f"procedure {kind.name!r}: {error}") from error


def _asked(field: Field[object], hint: object, who: str) -> SettingField:
    where = f"{who}: field {field.name!r}"
    bare, setting = _unwrapped(hint)
    listed = get_origin(bare) is tuple
    many = listed and (setting is None or setting.read is None)  # else it reads the whole list
    if listed:
        each, *rest = get_args(bare)
        bare, own = _unwrapped(each) if rest == [...] else (None, None)
        setting = setting or own
    choices = get_args(bare) if get_origin(bare) is Literal else ()
    read = setting is not None and setting.read is not None
    kind = str if read or (choices and all(isinstance(each, str) for each in choices)) else bare
    if not (kind is float or kind is int or kind is str or (kind is bool and not many)):
        raise ConfigError(
            f"{where} is of kind {inspect.formatannotation(hint)}, which `palpate measure` cannot ask for; make it"
            f" {KINDS}, or run the procedure from a script"
        )
    if kind is float and setting is None:
        raise ConfigError(
            f'{where} has no unit; write Annotated[float, Setting("N", "what it is")], with the unit "" for a'
            " plain number"
        )
    setting = setting or Setting()
    if setting.unit and bare is not float:
        raise ConfigError(f"{where} is of kind {kind.__name__} and has the unit {setting.unit!r}; make it a float")
    try:
        default = _default(field)
    except Exception as error:  # whatever a package does there
        raise ConfigError(f"{where} has no default: its factory fails ({type(error).__name__}: {error})") from error
    required = default is MISSING
    one = "|".join(choices) or (f"<{setting.unit}>" if setting.unit else PLAIN.get(kind, "TEXT"))
    return SettingField(
        field.name,
        setting.option or "--" + field.name.strip("_").replace("_", "-"),
        kind,
        many,
        setting.metavar or (f"{one},..." if listed and not setting.repeated else one),
        choices,
        setting,
        "" if required else setting.default or shown(default, setting.unit),
        required,
    )


def _default(field: Field[object]) -> object:
    """The default of a field; MISSING: it has none."""
    return field.default if field.default_factory is MISSING else field.default_factory()


def _unwrapped(hint: object) -> tuple[object, Setting | None]:
    """A type without `| None` and annotations, and the first Setting among its annotations."""
    if get_origin(hint) is Annotated:
        inner, *notes = get_args(hint)
        bare, own = _unwrapped(inner)
        return bare, next((note for note in notes if isinstance(note, Setting)), own)
    if get_origin(hint) in (Union, UnionType):
        others = [each for each in get_args(hint) if each is not type(None)]
        if len(others) == 1:
            return _unwrapped(others[0])
    return hint, None


def shown(value: object, unit: str, most: int = SHOWN) -> str:
    """A setting for people, of a list no more values than `most`; empty: it is not given."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        if unit and len(value) > 2 and _evenly(value):
            return ":".join(f"{each:.9g} {unit}" for each in (value[0], value[-1], value[1] - value[0]))
        texts = [shown(each, unit) for each in value]
        return ", ".join(texts if len(texts) <= most else [*texts[: most - 2], "...", texts[-1]])
    return show(value, unit) if isinstance(value, float) or (unit and isinstance(value, int)) else str(value)


def _evenly(values: tuple[float, ...]) -> bool:
    steps = [after - before for before, after in pairwise(values)]
    return steps[0] > 0 and all(math.isclose(step, steps[0]) for step in steps)
