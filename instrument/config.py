"""TOML files checked against pydantic models: every problem of a file in one error, each with its key."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from instrument.errors import ConfigError, nearest

LARGEST_FILE = 1_000_000  # bytes; a bench, scene or calibration file has a few thousand


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
        ConfigError: the file is missing, unreadable, not TOML, or has missing, unknown or bad keys.
    """
    try:
        if path.exists() and not path.is_file():  # a device or pipe could be read for ever
            raise ConfigError(f"{path}: is no file; give the path of a TOML file")
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigError(f"{path}: larger than {LARGEST_FILE} bytes; this is no configuration file")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; give the path of a file that exists") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not text; a TOML file in UTF-8 belongs here") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:  # brackets without end nest too deep
        raise ConfigError(f"{path}: is not TOML: {error}") from None
    return check(data, model, str(path))


def check(data: dict[str, Any], model: type[M], where: str) -> M:
    """`data` as a `model`; ConfigError lists every problem, each with `where` and its key."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        problems = [f"{where}: {_describe(dict(e), model)}" for e in error.errors(include_url=False)]
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
