"""What the command line answers, as short as it can be kept: statuses, names, and a digest of each value."""

from __future__ import annotations

import hashlib
import json
import lzma
import os
import platform
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from importlib.metadata import entry_points, version
from io import StringIO
from pathlib import Path
from typing import Any

OLD = Path(__file__).parent / "old"
# What the clock on the wall, this machine or the folder decides.
MOVING = {
    "arithmetic", "bench_file", "build_s", "calibration_file", "certificate", "commit", "created", "expires",
    "film_calibration_file", "machine", "processor_s", "processor_u", "seconds", "sha256", "solve_s", "started", "time",
    "versions", "wall_seconds",
}  # fmt: skip
# Ports, terminals and channels are any that are free.
ADDRESS = re.compile(
    r"(?<=127\.0\.0\.1:)\d+|(?<=port = )\d+|(?<=/dev/pts/)\d+|(?<=palpate-)\d+-\d+|(?<=replay-)\d+-\d+"
)
# What a printed text says of the clock on the wall and of the day.
PRINTED = re.compile(
    r"[\d.]+ s here|\(x [\d.]+\)|\d{8}T\d{6}Z|\d{4}-\d\d-\d\d(?:[T ][\d:]+Z?)?|\b[0-9a-f]{12,64}\b|"
    r"[\d.]+ s of processor time"
)
ENDED = (129, 130, 143)  # by a closed terminal, Ctrl-C or SIGTERM: so does the comparison
SPELLED = ("thesis_single", "sweep position")  # other runs have a digest of their names alone
WORDS = "text"  # of help
Found = dict[str, Any]


def palpate(line: str) -> tuple[object, str, str]:
    """Exit status, stdout and stderr of a command line, done in this process."""
    (main,) = (point.load() for point in entry_points(group="console_scripts", name="palpate"))
    before, out, err = sys.argv, StringIO(), StringIO()
    sys.argv = ["palpate", *shlex.split(line)]
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main()
    except SystemExit as ended:
        if ended.code in ENDED:
            raise
        return ended.code, out.getvalue(), err.getvalue()
    except Exception as error:  # the cells after it are compared all the same
        return "crashed", "", f"{type(error).__name__}: {error}"
    finally:
        sys.argv = before
    raise AssertionError(f"palpate {line} has no exit status")


def drawn_empty() -> None:
    """From now on an empty file stands for each plot: drawing takes longer than measuring."""
    from matplotlib.figure import Figure

    Figure.savefig = lambda _figure, path, **_: Path(path).touch()  # type: ignore[method-assign]


def made_with() -> Found:
    """What the last digits rest on: the kernels of numpy, and what computes beside it.

    Call it before numpy is loaded: palpate chooses the kernels when it is started.
    """
    palpate("--version")
    import numpy  # noqa: F401
    from threadpoolctl import threadpool_info

    loaded = (each for each in threadpool_info() if "numpy" in each["filepath"])
    kernels = [f"{each['internal_api']} {each['version']} {each.get('architecture')}" for each in loaded]
    versions = {name: version(name) for name in ("numpy", "scipy")}
    return {**versions, "blas": ", ".join(kernels), "libm": platform.libc_ver()[1]}


def answers(name: str, lines: tuple[str, ...]) -> list[Found]:
    """What a cell finds, a dictionary for each of its lines; its store is a folder of its own."""
    os.environ.pop("PALPATE_STORE", None)  # calibrations that lie there would change the answers
    with tempfile.TemporaryDirectory(prefix="palpate-frozen-") as folder, chdir(folder):
        if any("old/" in line for line in lines):
            shutil.copytree(OLD, "old")
            for packed in Path("old").glob("*.xz"):
                packed.with_suffix("").write_bytes(lzma.decompress(packed.read_bytes()))
        spelled = not name.startswith(("run ", "old run")) or any(word in name for word in SPELLED)
        found = [_answer(line, Path(folder), spelled) for line in lines]
    if name.startswith("target "):
        return [{key: value for key, value in each.items() if key != "values"} for each in found]
    return found


def _answer(line: str, folder: Path, spelled: bool) -> Found:
    status, out, err = palpate(line)
    if status != 0:
        lines = err.strip().splitlines() or [""]
        said = next((each for each in lines if each.startswith("palpate: error")), lines[-1])
        return {"status": status, "said": "" if out else ADDRESS.sub("*", said.replace(str(folder), "."))[:200]}
    if "--json" not in line.split():
        text = PRINTED.sub("*", ADDRESS.sub("*", out.replace(str(folder), ".")))
        parts = [part for part in text.split("\n\n") if part.strip()]
        return {"status": status, "values": {f"{i} {part.strip()[:40]}": digest(part) for i, part in enumerate(parts)}}
    told = json.loads(ADDRESS.sub("*", out.replace(str(folder), ".")))
    if line.startswith("bus show"):
        told = {"traffic": _traffic(told["messages"])}
    names = sorted(set(_names(told)))
    return {"status": status, "names": names if spelled else digest(names), "values": dict(_values(_still(told)))}


def _traffic(messages: list[Found]) -> Found:
    """What went to and from each device, in order; of a sensor node not what: a thread of its own hears it."""
    each: dict[str, list[str]] = {}
    for message in messages:
        each.setdefault(message["who"], []).append(message["raw"])
    return each


def _names(value: Any, path: str = "") -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield f"{path}.{key}".lstrip(".")
            yield from _names(each, f"{path}.{key}")
    elif isinstance(value, list):
        for each in value:
            yield from _names(each, f"{path}[]")


def _values(told: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for key, value in told.items():
        if isinstance(value, dict):
            yield from ((f"{key}.{inner}", digest(each)) for inner, each in value.items())
        else:
            yield key, digest(value)


def _moves(key: str, value: object) -> bool:
    """Whether the clock on the wall, this machine or the folder decides; `front` of a method follows its time."""
    return key in MOVING or key.startswith("node ") or (key == "front" and isinstance(value, bool))


def _still(value: Any) -> Any:
    """A value without what moves."""
    if isinstance(value, dict):
        return {key: _still(each) for key, each in value.items() if not _moves(key, each)}
    return [_still(each) for each in value] if isinstance(value, list) else value


def digest(value: object) -> str:
    """Eight hexadecimal digits: enough to see that it has changed."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:8]


def options() -> Iterator[tuple[str, list[Found]]]:
    """The options of every command, as `--help` has them, and a digest of the whole text."""
    waiting = [""]
    while waiting:
        path = waiting.pop(0)
        status, text, _ = palpate(f"{path} --help")
        commands = text.partition("\nCommands:\n")[2].partition("\n\n")[0]
        waiting += [f"{path} {line.split()[0]}".strip() for line in commands.splitlines() if re.match(r"  \S", line)]
        told = text.partition("\nOptions:\n")[2].partition("\n\n")[0].splitlines()
        named = [re.split(r"  +", line.strip())[0] for line in told if line.startswith("  -")]
        yield f"help {path}".strip(), [{"status": status, "names": named, "values": {WORDS: digest(text)}}]
