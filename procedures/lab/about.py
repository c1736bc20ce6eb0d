"""What a run says of itself: keys of the lab's own, said once for a bench, and the software it was taken with.

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

import functools
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Mapping
from importlib import metadata
from pathlib import Path

from palpate.instrument.additions import Addition, check_ours, packages
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import GROUP as kind_group
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.bench.kinds import WHAT as kind_what
from palpate.instrument.config import Config, check, read_data
from palpate.instrument.errors import ConfigError, UnknownName, UsageError, quoted
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.designs import GROUP as design_group
from palpate.instrument.sensor.designs import WHAT as design_what
from palpate.simulators.effects import EFFECTS
from palpate.simulators.effects import GROUP as effect_group
from palpate.simulators.effects import WHAT as effect_what
from palpate.simulators.scenes.scene import Scene

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


def completed(given: Mapping[str, str], folder: Path, ask: Ask | None = None) -> dict[str, str]:
    """What runs say about themselves: what is given, and what the lab's own file adds, in the order of that file.

    Args:
        given: the values by their keys.
        folder: where runs are kept, with the file or without.
        ask: asks a person a question and returns the answer; None: nobody can be asked.

    Raises:
        ConfigError: the file is wrong.
        UsageError, UnknownName: a key or value cannot be, the lab knows no such key or value, or a required one lacks.
    """
    schema = schema_in(folder)
    if len(given) > MOST:
        raise UsageError(f"a run says {len(given)} things about itself; {MOST} are the most: leave some out")
    for key, value in given.items():
        _check_key(key, "about")
        if schema is not None and key not in schema:
            raise UnknownName(f"key of {folder / FILE}", key, schema)
        if not isinstance(value, str):
            raise UsageError(f"about {key}: {quoted(value)} is no text; give one, such as {str(value)!r}")
        _check_value(key, value, (schema or {}).get(key), "about")
    if schema is None:
        return dict(given)
    return {key: value for key, asked in schema.items() if (value := _value(key, asked, given, folder, ask))}


def _value(key: str, asked: AboutKey, given: Mapping[str, str], folder: Path, ask: Ask | None) -> str:
    if key in given:
        return given[key]
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


# --- The software that a run was taken with, for its record --------------------------------------------

PACKAGES = ("palpate", "pymodbus", "python-can", "canopen", "numpy", "scipy")


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on, by name."""
    return {"python": platform.python_version(), **{package: metadata.version(package) for package in PACKAGES}}


def added_by(bench: BenchDescription, scene: Scene | None, procedure: Addition | None = None) -> dict[str, str]:
    """Versions of the installed packages that devices, the design, effects and the procedure come from."""
    kinds = {each.kind.name for each in bench.devices}
    return {
        **packages_of(kinds, {bench.design}, scene.effects if scene is not None else ()),
        **({procedure.package: procedure.version} if procedure is not None and procedure.version else {}),
    }


def packages_of(kinds: Iterable[str], designs: Iterable[str], effects: Iterable[str]) -> dict[str, str]:
    """Versions of the installed packages that add these kinds of devices, designs and effects.

    Raises ConfigError: several packages have one of a name, or a package has one of the name of palpate's own.
    """
    found: dict[str, str] = {}
    for group, what, names, ours in (
        (kind_group, kind_what, kinds, KINDS),
        (design_group, design_what, designs, DESIGNS),
        (effect_group, effect_what, effects, EFFECTS),
    ):
        check_ours(group, what, sorted(ours.keys() & set(names)))
        found |= packages(group, what, set(names) - ours.keys())
    return found


@functools.cache
def commit() -> str | None:
    """Git commit of the source tree, with `-dirty` if files were changed; None: palpate does not run from a clone."""
    tree = Path(__file__).resolve().parents[2]
    if not (tree / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(tree), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            capture_output=True, text=True, check=True, timeout=5,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
