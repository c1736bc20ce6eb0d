"""Hostile scenes: each number of a scene, of every effect and of every fault in turn at values that no bench has.

A case is a sweep of one point on such a scene, by the command line, in a process of its own. It is held if it ends with
a result, or with one message within `LIMIT` seconds.
"""

from __future__ import annotations

import importlib
import io
import math
import os
import select
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import tomli_w
from pydantic.fields import FieldInfo

from palpate.instrument.quantity import Unit
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.scenes.scene import RigParameters, SceneFile

HOSTILE = (0.0, -1.0, 1e-308, -1e-308, 1e308, -1e308, math.nan, math.inf)
STEEP = tuple(sign * 10.0**power for power in (-100, -30, -12, -6, -3, 3, 6, 12, 30, 100) for sign in (1, -1))
LIMIT = 2.0  # s of the processor until a message comes; a result may take longer
PATIENCE = 60.0  # s of the wall, after which a case counts as hanging
WRONG = ("Traceback", "Warning:", "Exception ignored", "exception was never retrieved")
TOGETHER = {"g": ("tau", ["1 s"]), "tau": ("g", [0.3])}  # keys of an effect that stand together, and a value
RIVALS = {"charge_amplifier", "voltage_amplifier"}  # effects that exclude each other
BASE = "thesis_single"
SWEEP = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Case:
    """A scene whose number at `key` is `value`."""

    scene: str
    key: Key
    value: float
    content: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.scene}: {'.'.join(map(str, self.key))} = {self.value!r}"


@dataclass(frozen=True)
class Came:
    """What came of a case: exit status, or None if it had to be killed; what it said; seconds of processor and wall."""

    status: int | None
    said: str
    seconds: float
    wall: float

    @property
    def bad(self) -> str:
        """What is wrong with it; empty: it is held."""
        if self.status is None:
            return "hangs"
        if self.status and self.seconds > LIMIT:
            return f"takes {self.seconds:.1f} s"
        if self.status not in (0, 1, 2) or any(each in self.said for each in WRONG):
            return "is no message"
        if self.status and self.said.count("palpate: ") != 1:
            return "is not one message"
        return ""


def scenes() -> dict[str, dict[str, Any]]:
    """The shipped scenes, and one for each effect and each fault that none of them has, by name."""
    found = {name: tomllib.loads(path.read_text()) for name, path in shipped().items()}
    base = found[BASE]
    for name in EFFECTS:
        if not any(name in scene.get("effects", {}) for scene in found.values()):
            others = {key: of for key, of in base["effects"].items() if not {name, key} <= RIVALS}
            found[f"with {name}"] = {**base, "effects": {**others, name: {}}}
    for kind in FAULTS:
        on = next(iter(struck(fault_class(kind).targets, places(1))))
        found[f"fault {kind}"] = {**base, "fault": [{"kind": kind, "on": on, "at": "5 s"}]}
    return found


def cases(values: tuple[float, ...] = HOSTILE, ends: bool = False) -> Iterator[Case]:
    """Every number of every scene at each of these values; `ends`: also at the ends of what it may be."""
    for name, scene in scenes().items():
        for key, info, length in _numbers(name, scene):
            for value in (*values, *(_ends(info) if ends else ())):
                written = _written(info, value)
                content = deepcopy(scene)
                _put(content, key, [written] * length if length else written)
                if key[-1] in TOGETHER:
                    other, beside = TOGETHER[str(key[-1])]
                    _put(content, (*key[:-1], other), beside)
                yield Case(name, key, value, content)


def _numbers(name: str, scene: Mapping[str, Any]) -> Iterator[tuple[Key, FieldInfo, int]]:
    """Key, declaration and (of a list) number of values of each number that a scene has or could have."""
    tables: list[tuple[Key, Any]] = []
    if "fault" in scene:
        kind = scene["fault"][0]["kind"]
        tables.append((("fault", 0), fault_class(kind)))
    elif not name.startswith("with "):
        tables += [((), SceneFile), (("rig",), RigParameters)]
    if "fault" not in scene:
        tables += [(("effects", effect), effect_class(effect)) for effect in scene.get("effects", {})]
    for key, table in tables:
        for own, info in table.model_fields.items():
            if _numeric(info.annotation):
                default = info.default
                listed = own in TOGETHER or isinstance(default, tuple)
                yield (*key, own), info, len(default or (0,)) if listed else 0


def _numeric(annotation: Any) -> bool:
    return annotation in (int, float) or any(map(_numeric, get_args(annotation)))


def _ends(info: Any) -> list[float]:
    """The least and the greatest value that a number may have, where its declaration says so."""
    found = [getattr(each, end) for each in getattr(info, "metadata", ()) for end in ("ge", "le") if hasattr(each, end)]
    annotation = getattr(info, "annotation", info)
    for inner in get_args(annotation):
        found += [*_ends(inner), *(_ends(each)[0] for each in getattr(inner, "__metadata__", ()) if _ends(each))]
    return [int(value) if annotation in (int, int | None) else float(value) for value in found]


def _unit(info: Any) -> str:
    """The unit in which a number is written; "": it is a plain number."""
    found = [each for each in getattr(info, "metadata", ()) if isinstance(each, Unit)]
    annotation = getattr(info, "annotation", info)
    inner = [*getattr(annotation, "__metadata__", ()), *getattr(annotation, "__args__", ())]
    found += [each for each in inner if isinstance(each, Unit)]
    return found[0].unit if found else next(filter(None, map(_unit, get_args(annotation))), "")


def _written(info: FieldInfo, value: float) -> Any:
    return f"{value!r} {unit}" if (unit := _unit(info)) else value


def _put(content: Any, key: Key, value: Any) -> None:
    for part in key[:-1]:
        if isinstance(content, dict):
            given = content.setdefault(part, {})
            if isinstance(given, str):  # "on" or "auto"
                content[part] = {"when": given}
        content = content[part]
    if "fault" not in key and key[-1] in ("at", "transaction", "probability"):
        raise KeyError(key)
    content[key[-1]] = value
    if isinstance(content, dict) and "kind" in content and key[-1] in ("transaction", "probability"):
        content.pop("at", None)


def ready() -> None:
    """Import what a sweep needs, so that the processes that are forked from this one need not."""
    for name in ("procedures.commands.root", "procedures.measurements.loads", "simulators.bench"):
        importlib.import_module(f"palpate.{name}")
    importlib.import_module("matplotlib.pyplot")
    swept(scenes()[BASE])


def swept(content: Mapping[str, Any]) -> Came:
    """What comes of a sweep of one point on a scene, in a forked process."""
    with tempfile.TemporaryDirectory() as folder:
        file, said = Path(folder, "scene.toml"), Path(folder, "said")
        file.write_bytes(tomli_w.dumps(dict(content)).encode())
        begun = time.monotonic()
        child = os.fork()
        if not child:
            _child(folder, said, *SWEEP, "--scene", str(file), "--out", str(Path(folder, "run")))
        ended = os.pidfd_open(child)
        try:
            within = bool(select.select([ended], [], [], PATIENCE)[0])
        finally:
            os.close(ended)
        if not within:
            os.kill(child, signal.SIGKILL)
        _, how, used = os.wait4(child, 0)
        status = os.waitstatus_to_exitcode(how) if within else None
        return Came(status, said.read_text(), used.ru_utime + used.ru_stime, time.monotonic() - begun)


def _child(folder: str, said: Path, *command: str) -> None:
    """Give a command in this process, and end it."""
    os.environ["PALPATE_STORE"] = folder
    out = os.open(said, os.O_CREAT | os.O_WRONLY, 0o600)
    os.dup2(out, 1)
    os.dup2(out, 2)
    sys.stdout, sys.stderr = (io.TextIOWrapper(os.fdopen(number, "wb", 0), write_through=True) for number in (1, 2))
    status = 70
    with suppress(BaseException):
        status = _main(command)
    os._exit(status)


def _main(command: tuple[str, ...]) -> int:
    import traceback

    from palpate.procedures.commands import main

    sys.argv = ["palpate", *command]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
        return 70
    return 0
