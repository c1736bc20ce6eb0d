"""JSON files that come with palpate: frozen dataclasses, written as they are and read with every type checked.

    read(path, PriceList, "price list", "measure it anew: ...")

Commands that answer at once read them. Importing pydantic would take such a command longer than all else that it does.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from palpate.instrument.errors import ConfigError

D = TypeVar("D")

LARGEST = 1_000_000  # greatest number of bytes


def read(path: Path, kind: type[D], what: str, remedy: str) -> D:
    """Read a JSON file.

    Args:
        path: the file.
        kind: the dataclass that it holds.
        what: the file holds, for the error.
        remedy: how to make the file anew, for the error.

    Raises:
        ConfigError: the file is missing, too large, or has other content.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError
        found: D = _made(kind, json.loads(path.read_bytes()))
    except (OSError, ValueError, RecursionError):
        raise ConfigError(f"{path}: is missing or no {what}; {remedy}") from None
    return found


def text(content: Any) -> str:
    """The text of the file of a dataclass."""
    return json.dumps(asdict(content), indent=1) + "\n"


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _made(kind: Any, value: Any) -> Any:
    """What JSON gives, as a type. Raises ValueError: it is of another type, or a number is not finite."""
    made, inner = get_origin(kind), get_args(kind)
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, dict):
        hints = _hints(kind)
        if value.keys() <= hints.keys() and {each.name for each in fields(kind)} >= value.keys():
            try:
                return kind(**{name: _made(hints[name], each) for name, each in value.items()})
            except TypeError as missing:
                raise ValueError(str(missing)) from None
    elif made is tuple and isinstance(value, list):
        return tuple(_made(inner[0], each) for each in value)
    elif made is dict and isinstance(value, dict):
        return {name: _made(inner[1], each) for name, each in value.items()}
    elif made is UnionType:
        return None if value is None else _made(next(each for each in inner if each is not NoneType), value)
    elif made is Literal and value in inner:
        return value
    elif kind is float and type(value) in {int, float} and math.isfinite(value):
        return float(value)
    elif kind in {str, int} and type(value) is kind:
        return value
    raise ValueError(f"{value!r} is no {kind}")
