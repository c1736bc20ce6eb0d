"""Tables of a map file, whose keys are the attributes of the declarations that they describe."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any, get_type_hints

from pydantic import BeforeValidator, PlainValidator, Strict, create_model

from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Command, Condition, Field, Manners, Mark, Pdo, Scaling, Value, sdo

OBJECT = re.compile(r"([0-9A-Fa-f]{4}):([0-9A-Fa-f]{1,2})")


def _raw(value: Any) -> Any:
    """A raw value, whole or not, as it stands in the file. Raises ValueError: it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is no number; give one without quotes")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value!r} is not finite; give its bits, as 0x7F800000")
    return value


EXACT: dict[Any, Any] = {  # a text or `true` is no number
    int: Annotated[int, Strict()],
    float: Annotated[float, Strict()],
    float | None: Annotated[float, Strict()] | None,
    int | None: Annotated[int, Strict()] | None,
    Value: Annotated[float, Strict()] | Annotated[str, Strict()],
    tuple[int, int]: tuple[Annotated[int, Strict()], Annotated[int, Strict()]],
    tuple[int, int] | None: tuple[Annotated[int, Strict()], Annotated[int, Strict()]] | None,
    tuple[int, ...]: tuple[Annotated[int, Strict()], ...],
    tuple[float, ...]: tuple[Annotated[Any, PlainValidator(_raw)], ...],
    Mapping[str, int]: Mapping[str, Annotated[int, Strict()]],
}
MADE: dict[type[Config], type] = {}  # for each model of a table, the class of the declaration


def address_of(value: Any) -> Any:
    """An address of a map file: a number, or the index and subindex of an object in hexadecimal, as "6401:1".

    Raises ValueError: it is a text of another form.
    """
    if not isinstance(value, str):
        return value
    found = OBJECT.fullmatch(value)
    if found is None:
        raise ValueError(f'{value!r} is no address; give a number, or index and subindex of an object as "6401:1"')
    return sdo(int(found[1], 16), int(found[2], 16))


def _table(declared: type, **instead: Any) -> type[Config]:
    """A model whose keys are the attributes of a declaration but its name, which is that of the table."""
    hints = get_type_hints(declared)
    keys: dict[str, Any] = {}
    for each in fields(declared):
        if each.name == "name" or not each.init:
            continue
        default = each.default if each.default is not MISSING else ...
        if each.default_factory is not MISSING:
            default = each.default_factory()
        keys[each.name] = (instead.get(each.name, EXACT.get(hints[each.name], hints[each.name])), default)
    model: type[Config] = create_model(f"{declared.__name__}Table", __base__=Config, **keys)
    MADE[model] = declared
    return model


SCALING = _table(Scaling)
CONDITION = _table(Condition)
FIELD = _table(Field, address=Annotated[int, Strict(), BeforeValidator(address_of)], scaling=SCALING | None)
COMMAND = _table(Command, done=CONDITION | None, failed=CONDITION | None)
MANNERS = _table(Manners)
MARK = _table(Mark)
PDO = _table(Pdo)


def made(table: Config, **more: Any) -> Any:
    """The declaration that a checked table describes. Raises ConfigError: it makes no sense."""
    given: Mapping[str, Any] = {key: getattr(table, key) for key in table.model_fields_set}
    inner = {key: made(value) if type(value) in MADE else value for key, value in given.items()}
    return MADE[type(table)](**inner, **more)
