"""Who measures what, and why: keys of the lab's own, said once for a bench and kept in the record of each of its runs.

`about.toml` in the folder of the runs says which keys there are; without that file every key is free:

    [operator]
    ask = "Who measures?"       # asked at a terminal where it is not given
    required = true

    [batch]
    values = ["B6", "B7"]       # no other value is taken

    [ticket]
    default = "none"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from palpate.instrument.config import Config, check, read_data
from palpate.instrument.errors import ConfigError, UnknownName, UsageError, quoted

FILE = "about.toml"
KEY = re.compile(r"[a-z][a-z0-9_]{0,39}")
LONGEST, MOST = 200, 50  # characters of a value, number of keys
# what palpate says of each run itself
OWN = frozenset(["run", "procedure", "started", "status", "simulated", "scene", "seed", "points", "fault"])

Ask = Callable[[str], str]


class AboutKey(Config):
    """A `[KEY]` table of `about.toml`."""

    ask: str = ""
    required: bool = False
    values: tuple[str, ...] = ()
    default: str = ""


def schema_in(folder: Path) -> dict[str, AboutKey] | None:
    """What the lab asks of each run, by key; None: it has no such file. Raises ConfigError: the file is wrong."""
    path = folder / FILE
    if not path.exists():
        return None
    found: dict[str, AboutKey] = {}
    for key, table in read_data(path).items():
        where = f"{path}: {key}"
        _check_key(key, where)
        if not isinstance(table, dict):
            raise ConfigError(f"{where}: is no table; write [{key}] on a line of its own")
        found[key] = check(table, AboutKey, where)
        if found[key].default:
            _check_value(f"default of {key} in {path}", found[key].default, found[key], str(path))
    return found


def given(texts: Iterable[str]) -> dict[str, str]:
    """What is told in texts such as "operator = AB". Raises UsageError: one is no such text, or a key comes twice."""
    found: dict[str, str] = {}
    for text in texts:
        key, sign, value = (part.strip() for part in text.partition("="))
        if not sign:
            raise UsageError(f"--about {quoted(text)}: give a key and a value, such as --about 'operator = AB'")
        if key in found:
            raise UsageError(f"--about: {key} is given twice, as {found[key]!r} and {value!r}; give it once")
        found[key] = value
    return found


def completed(told: Mapping[str, str], folder: Path, ask: Ask | None = None) -> dict[str, str]:
    """What runs say about themselves: what is told, and what the lab's own file adds, in the order of that file.

    Args:
        told: the values by their keys.
        folder: where runs are kept, with the file or without.
        ask: asks a person a question and returns the answer; None: nobody can be asked.

    Raises:
        ConfigError: the file is wrong.
        UsageError, UnknownName: a key or value cannot be, the lab knows no such key or value, or a required one lacks.
    """
    schema = schema_in(folder)
    if len(told) > MOST:
        raise UsageError(f"a run says {len(told)} things about itself; {MOST} are the most: leave some out")
    for key, value in told.items():
        _check_key(key, "about")
        if schema is not None and key not in schema:
            raise UnknownName(f"key of {folder / FILE}", key, schema)
        if not isinstance(value, str):
            raise UsageError(f"about {key}: {quoted(value)} is no text; give one, such as {str(value)!r}")
        _check_value(key, value, (schema or {}).get(key), "about")
    if schema is None:
        return dict(told)
    return {key: value for key, asked in schema.items() if (value := _value(key, asked, told, folder, ask))}


def _value(key: str, asked: AboutKey, told: Mapping[str, str], folder: Path, ask: Ask | None) -> str:
    if key in told:
        return told[key]
    if asked.ask and ask is not None:
        answer = ask(asked.ask + (f" ({', '.join(asked.values)})" if asked.values else "")).strip() or asked.default
        if answer:
            _check_value(key, answer, asked, "about")
            return answer
    if asked.required and not asked.default:
        raise UsageError(
            f"{folder / FILE} asks each run for {key}, which is not told; give --about '{key} = …', or about="
            f"{{{key!r}: …}} in a script"
        )
    return asked.default


def _check_key(key: str, where: str) -> None:
    if not KEY.fullmatch(key):
        raise UsageError(f"{where}: {quoted(key)} is no key; give small letters, digits and _, such as batch_2")
    if key in OWN:
        raise UsageError(f"{where}: palpate says {key} of each run itself; take another key")


def _check_value(key: str, value: str, asked: AboutKey | None, where: str) -> None:
    if not value or len(value) > LONGEST or not value.isprintable():
        raise UsageError(
            f"{where}: {key}: {quoted(value)} is no value; give 1 to {LONGEST} printable characters in one line"
        )
    if asked is not None and asked.values and value not in asked.values:
        raise UnknownName(f"{key}", value, asked.values)
