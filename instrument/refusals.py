"""What is wrong with a value of a file or setting, in palpate's words: pydantic's speak of "input"."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from palpate.instrument.errors import nearest, quoted
from palpate.instrument.quantity import Unit, counted, show

NUMBER = "is no number; give one without quotes"
WHOLE = "is no whole number; give one without quotes"
BOOL = "is neither true nor false; give one of them without quotes"
TEXT = "is no text; put it in quotes"
LIST = "is no list; put its values in square brackets"
TABLE = "is no table; give its keys, each with its value"
OF_TYPE = {  # by pydantic's type of the error
    "finite_number": "is not finite; give a number",
    "float_type": NUMBER,
    "float_parsing": NUMBER,
    "int_type": WHOLE,
    "int_parsing": WHOLE,
    "int_from_float": WHOLE,
    "int_parsing_size": "has too many digits; give a smaller number",
    "bool_type": BOOL,
    "bool_parsing": BOOL,
    "string_type": TEXT,
    "list_type": LIST,
    "tuple_type": LIST,
    "dict_type": TABLE,
    "model_type": TABLE,
    "model_attributes_type": TABLE,
    "dataclass_type": TABLE,
}
LIMITS = {  # by pydantic's type of the error: key of the limit, what the value is, and what to give
    "greater_than": ("gt", "is too small", "more than"),
    "greater_than_equal": ("ge", "is too small", "at least"),
    "less_than": ("lt", "is too large", "less than"),
    "less_than_equal": ("le", "is too large", "at most"),
}


def refusal_text(error: Mapping[str, Any], model: type[BaseModel], beside: Iterable[str] = ()) -> str:
    """One of pydantic's errors about a table: key, value, what is allowed and what to do.

    Args:
        error: as `ValidationError.errors` lists it.
        model: class of the table.
        beside: keys that the table can have, too.
    """
    path = [str(part) for part in error["loc"]]
    key = ".".join(path)
    match error["type"]:
        case "extra_forbidden":
            inner = _model_at(model, path[:-1])
            valid = sorted({*inner.model_fields, *(beside if len(path) == 1 else ())}) if inner else []
            return f"{key}: unknown key{nearest(path[-1], valid)}" + (f"; valid: {', '.join(valid)}" if valid else "")
        case "missing":
            described = _described(model, path)
            return f"{key}: is missing" + (f"; give {described}" if described else "")
        case "value_error":
            message = str(error["msg"]).removeprefix("Value error, ")
            return f"{key}: {message}" if key else message
    value, problem = quoted(error["input"]), wrong(error, _field_at(model, path))
    if described := _described(model, path):
        problem = f"{problem.partition(';')[0]}; give" if error["type"] in OF_TYPE else f"{problem}:"
        problem = f"{problem} {described}"
    return f"{key}: {value} {problem}"


def wrong(error: Mapping[str, Any], field: FieldInfo | None = None) -> str:
    """What is wrong with a value, to follow it in a message.

    Args:
        error: as `ValidationError.errors` lists it.
        field: the field of the value, which tells the unit of its limits; None: it has no unit.
    """
    kind, context = error["type"], error.get("ctx", {})
    if kind in OF_TYPE:
        return OF_TYPE[kind]
    if kind in LIMITS:
        limit, says, give = LIMITS[kind]
        return f"{says}; give {give} {_with_unit(context[limit], field)}"
    match kind:
        case "literal_error":
            return f"is not known{nearest(str(error['input']), _choices(context))}; valid: {context['expected']}"
        case "string_too_short":
            least = context["min_length"]
            return "is empty; give a text" if least == 1 else f"is too short; give at least {least} characters"
        case "string_too_long":
            return f"is too long; give at most {context['max_length']} characters"
        case "too_short":
            return f"has too few values; give at least {counted(context['min_length'], 'value')}"
        case "too_long":
            return f"has too many values; give at most {counted(context['max_length'], 'value')}"
        case "string_pattern_mismatch":
            return f"does not have the form {context['pattern']}"
    return f"is not allowed: {error['msg']}"


def _choices(context: Mapping[str, Any]) -> Sequence[str]:
    return [each.strip("' ") for each in str(context["expected"]).replace(" or ", ", ").split(",")]


def _with_unit(limit: float, field: FieldInfo | None) -> str:
    unit = next((each.unit for each in _metadata(field) if isinstance(each, Unit)), "")
    return show(limit, unit) if unit else f"{limit:g}" if isinstance(limit, float) else f"{limit}"


def _metadata(field: FieldInfo | None) -> list[Any]:
    """What a field's type is annotated with, also that of `Annotated[...] | None`."""
    if field is None:
        return []
    return [*field.metadata, *(each for arg in get_args(field.annotation) for each in getattr(arg, "__metadata__", ()))]


def _described(model: type[BaseModel], path: list[str]) -> str:
    """What a key of `model` itself is, for people; empty: its class does not say."""
    info = model.model_fields.get(path[0]) if len(path) == 1 else None
    return (info.description or "") if info else ""


def _field_at(model: type[BaseModel], path: list[str]) -> FieldInfo | None:
    """The field of a key; None: it is not known."""
    inner = _model_at(model, path[:-1])
    return inner.model_fields.get(path[-1]) if inner and path else None


def _model_at(model: type[BaseModel], path: list[str]) -> type[BaseModel] | None:
    """Class of the table at `path` in `model`; None: it is not known."""
    for part in path:
        info = model.model_fields.get(part)
        inner = info.annotation if info else None
        candidates = [inner, *getattr(inner, "__args__", ())]
        found = [c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)]
        if not found:
            return None
        model = found[0]
    return model
