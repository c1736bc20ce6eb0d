"""TOML files that are checked against pydantic models. One error lists every problem of a file, each with its key."""

from __future__ import annotations

import codecs
import hashlib
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from palpate.instrument.errors import ConfigError, check_path
from palpate.instrument.refusals import refusal_text

LARGEST_FILE = 1_000_000  # greatest number of bytes; a bench, scene or calibration file has a few thousand
MOST_VALUES = 100_000  # greatest number of values in a file; a calibration of the films of 64 teeth has 25 thousand
LONGEST_TEXT = 1000  # greatest number of characters of a key or a value
DEEPEST = 8  # tables within tables
MOST_PROBLEMS = 20  # listed in one error
LEAST_WRONG, MOST_NAMED = 3, 4  # keys of a file of another kind: least number, and how many its error names
ACCEPT = "palpate calibrate accept"  # the command


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


class Config(BaseModel):
    """A section of a configuration file: frozen, and unknown keys are errors.

    Its validator is built when it is first used: a command reads a few kinds of files, and imports them all.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    file: ClassVar[str] = ""  # what a file with these keys is called; empty: it is a part of a file


class Hashed(Config):
    """Content that palpate writes into a file and reads back, with its SHA-256.

    `accepted` is the day on which somebody accepted an edit by hand, ISO 8601.
    """

    model_config = ConfigDict(defer_build=False)  # calibrations are public: their signatures show without a use

    accepted: IsoDate | None = None

    def sha256(self) -> str:
        """SHA-256 of the content, hexadecimal. Keys that are left out do not count."""
        return _sha256(self.model_dump(mode="json", exclude_none=True))

    def about(self) -> dict[str, Any]:
        """What the record of a run says about this file."""
        return {"sha256": self.sha256(), "accepted": self.accepted}

    def marks(self) -> str:
        """Remark to be shown behind the file's name; "" where the file is as it was written."""
        return f" (edited by hand, accepted on {self.accepted})" if self.accepted else ""


def _sha256(content: Mapping[str, Any]) -> str:
    """SHA-256 of a file's content without its hash, hexadecimal."""
    written = json.dumps(content, sort_keys=True, separators=(",", ":"), default=str)  # TOML may have dates
    return hashlib.sha256(written.encode()).hexdigest()


M = TypeVar("M", bound=Config)
H = TypeVar("H", bound=Hashed)


def read(path: Path, model: type[M]) -> M:
    """Read and check one TOML file.

    Raises:
        ConfigError: the file is missing, unreadable, too large, not TOML, or has missing, unknown or bad keys.
    """
    return check(read_data(path), model, str(path))


def read_hashed(path: Path, model: type[H], *, edited: bool = False) -> H:
    """Read a file that palpate wrote.

    Args:
        path: the file.
        model: class of its content.
        edited: whether the file may have been changed since it was written.

    Raises:
        ConfigError: as in `read`, or the file was changed after it was written, its hash is gone, or another version
            wrote it.
    """
    data = read_data(path)
    digest = data.pop("sha256", None)
    try:
        found = check(data, model, str(path))
    except ConfigError as error:
        if digest is None or digest != _sha256(data):
            raise
        raise ConfigError(
            f"{path}: is as another version of palpate wrote it, with other keys; remove it, and measure anew what it"
            f" holds\n{error}"
        ) from None
    if not edited and digest != found.sha256():
        how = "is gone" if digest is None else f"= {str(digest)[:12]}… belongs to other values"
        raise ConfigError(
            f"{path}: was changed after it was written: its sha256 {how}; "
            f"restore it from the folder of its run or, if the change is intended, accept it: {ACCEPT} {path}"
        )
    return found


def read_data(path: Path) -> dict[str, Any]:
    """Content of a TOML file, not checked against a model. Raises ConfigError."""
    return parse_data(read_bytes(path), str(path))


def read_bytes(path: Path) -> bytes:
    """Content of a configuration file. Raises ConfigError: it is missing, unreadable or too large."""
    check_path(path)
    try:
        if path.exists() and not path.is_file():  # reading a device or a pipe might never end
            raise ConfigError(f"{path}: is no file; give the path of a TOML file")
        if path.stat().st_size > LARGEST_FILE:
            raise ConfigError(f"{path}: larger than {LARGEST_FILE} bytes; this is no configuration file")
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; give a readable file") from None


def parse(content: bytes, model: type[M], where: str) -> M:
    """Read the text of a TOML file as a `model`. Raises ConfigError as `read` does, beginning with `where`."""
    return check(parse_data(content, where), model, where)


def parse_data(content: bytes, where: str) -> dict[str, Any]:
    """Content of the text of a TOML file, not checked against a model. Raises ConfigError, beginning with `where`."""
    try:
        data = tomllib.loads(content.decode("utf-8-sig"))  # some editors put a byte order mark before UTF-8
    except UnicodeDecodeError as error:
        wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        line = content[: error.start].count(b"\n") + 1
        found = "but in UTF-16" if wide else f"(line {line} has the byte 0x{content[error.start]:02X})"
        raise ConfigError(f"{where}: is not text in UTF-8, as TOML must be, {found}; save it in UTF-8") from None
    except (ValueError, RecursionError) as error:  # for integers of thousands of digits, and for deeply nested brackets
        raise ConfigError(f"{where}: is not TOML: {error}") from None
    _hold_limits(data, where)
    return data


def _hold_limits(data: dict[str, Any], where: str) -> None:
    """Check that a file has not too many values, too long texts or too deep tables. Raises ConfigError."""
    left: list[tuple[Any, int]] = [(data, 0)]
    for count, (value, depth) in enumerate(left):  # the loop appends to it
        if count > MOST_VALUES:
            raise ConfigError(f"{where}: has more than {MOST_VALUES} values; leave some out")
        if depth > DEEPEST:
            raise ConfigError(f"{where}: its tables are more than {DEEPEST} deep; write them side by side")
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        texts = (*value, *inner) if isinstance(value, dict) else inner
        if any(isinstance(text, str) and len(text) > LONGEST_TEXT for text in texts):
            raise ConfigError(f"{where}: has a text of more than {LONGEST_TEXT} characters; shorten it")
        left.extend((each, depth + 1) for each in inner)


def check(data: dict[str, Any], model: type[M], where: str, beside: Iterable[str] = ()) -> M:
    """Turn `data` into a `model`.

    Args:
        data: the content of a table.
        model: class of its keys.
        where: what messages begin with.
        beside: keys that the table can have, too, and that were taken out of `data`.

    Raises:
        ConfigError: lists every problem with `where` and its key.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        if model.file and (why := _of_another_kind(data, model)):
            raise ConfigError(f"{where}: is no {model.file}: {why}; give the file of a {model.file}") from None
        errors = error.errors(include_url=False)
        inside = {e["loc"][:-1] for e in errors}  # pydantic counts wrong values of a list as missing ones
        errors = [e for e in errors if e["type"] != "too_short" or e["loc"] not in inside]
        problems = [
            f"{where}: {line}"
            for e in errors[:MOST_PROBLEMS]
            for line in refusal_text(dict(e), model, beside).splitlines()
        ]
        if len(errors) > MOST_PROBLEMS:
            problems.append(f"{where}: and {len(errors) - MOST_PROBLEMS} more")
        raise ConfigError("\n".join(problems)) from None


def _of_another_kind(data: dict[str, Any], model: type[Config]) -> str:
    """Why a file is of another kind, and not only has a few wrong keys; empty if it has mostly right keys."""
    unknown = sorted(data.keys() - model.model_fields.keys())
    missing = [name for name, field in model.model_fields.items() if field.is_required() and name not in data]
    if len(unknown) + len(missing) < LEAST_WRONG or len(unknown) <= len(data) - len(unknown):
        return ""
    parts = [f"it {does} {few(names)}" for does, names in (("has", unknown), ("lacks", missing)) if names]
    return ", and ".join(parts)


def few(names: Sequence[str]) -> str:
    """The first names of a list, and how many more there are."""
    named = ", ".join(names[:MOST_NAMED])
    return named if len(names) <= MOST_NAMED else f"{named} and {len(names) - MOST_NAMED} more"
