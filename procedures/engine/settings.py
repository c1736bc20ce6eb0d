"""Settings that a script gives a procedure, held to the types of its fields before a bench is opened."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import get_type_hints

from pydantic import TypeAdapter, ValidationError

from palpate.instrument.errors import UsageError
from palpate.procedures.engine.procedure import P, Procedure, R, S


def check_settings(procedure: Procedure[S, P, R]) -> None:
    """Refuse a setting whose type is not that of its field; a list counts as a tuple.

    A setting that is empty is refused, too, unless that is its default.

    Raises:
        UsageError: a setting is wrong, or there is no procedure at all.
    """
    if not isinstance(procedure, Procedure):
        raise UsageError(f"{procedure!r} is no procedure; give an object of one, such as LoadSweep(loads=(2.0,))")
    types = get_type_hints(type(procedure))
    for field in fields(procedure):
        value = getattr(procedure, field.name)
        told = f"{procedure.name}: {field.name} = {value!r}"
        default = () if field.default is MISSING else field.default
        if isinstance(value, (tuple, list)) and not value and (default or field.default is MISSING):
            raise UsageError(f"{told}: nothing is given; give at least one")
        try:
            TypeAdapter(types[field.name]).validate_python(
                tuple(value) if isinstance(value, list) else value, strict=True
            )
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            raise UsageError(f"{told}: {_lowered(wrong['msg'])}; its type is {field.type}") from None


def _lowered(message: str) -> str:
    return message[:1].lower() + message[1:]
