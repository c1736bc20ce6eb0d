"""TOML files checked against pydantic models: every problem of a file in one error, each with its key."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from instrument.errors import ConfigError, nearest

LARGEST_FILE = 1_000_000  # bytes; a bench, scene or calibration file has a few thousand
MOST_VALUES = 100_000  # of a file; the films of an array of 64 teeth have 25 thousand
LONGEST_TEXT = 1000  # characters of a key or a value
DEEPEST = 8  # tables within tables
MOST_PROBLEMS = 20  # of a file that are told


class Config(BaseModel):
    """A section of a configuration file: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


M = TypeVar("M", bound=Config)


def _is_a_date(value: str) -> str:
    try:
        date.fromisoformat(value)
    except ValueError:
        raise ValueError(f"{value!r} is not a date such as 2027-11-21") from None
    return value


IsoDate = Annotated[str, AfterValidator(_is_a_date)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Name = Annotated[str, Field(min_length=1)]


def read(path: Path, model: type[M]) -> M:
    """Read and check one TOML file.

    Raises:
        ConfigError: the file is missing, unreadable, too large, not TOML, or has missing, unknown or bad keys.
    """
    try:
        if path.exists() and not path.is_file():  # a device or pipe could be read for ever
            raise ConfigError(f"{path}: is no file; give the path of a TOML file")
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigError(f"{path}: larger than {LARGEST_FILE} bytes; this is no configuration file")
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; give the path of a file that exists") from None
    return parse(content, model, str(path))


def parse(content: bytes, model: type[M], where: str) -> M:
    """The content of a TOML file as a `model`. Raises ConfigError as `read`, each with `where`."""
    try:
        data = tomllib.loads(content.decode())
    except UnicodeDecodeError:
        raise ConfigError(f"{where}: is not text; a TOML file in UTF-8 belongs here") from None
    except (ValueError, RecursionError) as error:  # also integers of thousands of digits, and brackets without end
        raise ConfigError(f"{where}: is not TOML: {error}") from None
    _hold_limits(data, where)
    return check(data, model, where)


def _hold_limits(data: dict[str, Any], where: str) -> None:
    """Raises ConfigError: more values, longer texts or deeper tables than a file may have."""
    left: list[tuple[Any, int]] = [(data, 0)]
    for count, (value, depth) in enumerate(left):  # grows meanwhile
        if count > MOST_VALUES:
            raise ConfigError(f"{where}: has more than {MOST_VALUES} values; leave some out")
        if depth > DEEPEST:
            raise ConfigError(f"{where}: its tables are more than {DEEPEST} deep; write them side by side")
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        texts = (*value, *inner) if isinstance(value, dict) else inner
        if any(isinstance(text, str) and len(text) > LONGEST_TEXT for text in texts):
            raise ConfigError(f"{where}: has a text of more than {LONGEST_TEXT} characters; shorten it")
        left.extend((each, depth + 1) for each in inner)


def check(data: dict[str, Any], model: type[M], where: str) -> M:
    """`data` as a `model`; ConfigError lists every problem, each with `where` and its key."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        problems = [f"{where}: {_describe(dict(e), model)}" for e in errors[:MOST_PROBLEMS]]
        if len(errors) > MOST_PROBLEMS:
            problems.append(f"{where}: and {len(errors) - MOST_PROBLEMS} more")
        raise ConfigError("\n".join(problems)) from None


def _describe(error: dict[str, Any], model: type[BaseModel]) -> str:
    path = [str(part) for part in error["loc"]]
    key = ".".join(path)
    match error["type"]:
        case "extra_forbidden":
            valid = _keys(model, path[:-1])
            return f"{key}: unknown key{nearest(path[-1], valid)}" + (f"; valid: {', '.join(valid)}" if valid else "")
        case "missing":
            return f"{key}: is missing"
    message = str(error["msg"]).removeprefix("Value error, ")
    return f"{key}: {message}" if error["type"] == "value_error" else f"{key}: {message} (got {error['input']!r})"


def _keys(model: type[BaseModel], path: list[str]) -> list[str]:
    """Valid keys of the table at `path` in `model`."""
    for part in path:
        info = model.model_fields.get(part)
        inner = info.annotation if info else None
        candidates = [inner, *getattr(inner, "__args__", ())]
        found = [c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)]
        if not found:
            return []
        model = found[0]
    return sorted(model.model_fields)
