"""What must not change while the house is rebuilt: `python -m tests.frozen`, some two minutes of a core.

It does every procedure on every shipped scene, explains and settles the scenes, asks every command for its help and its
JSON, and reads old bench files, runs and logs. Of each cell it says whether what it finds is what `frozen.jsonl` holds,
and if not, what differs: exit status, names, or a value by its name.

    python -m tests.frozen                            all cells
    python -m tests.frozen "ideal softness" scene     those whose name has one of these texts
    python -m tests.frozen --kept found.jsonl         keeps what is found there; called again, it goes on
    python -m tests.frozen --accept help              takes what is found as what must not change from now on

Exit status 1: something differs. A help text that says the same options in other words is told, and is no failure.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.frozen.cells import CELLS
from tests.frozen.measure import WORDS, Found, answers, drawn_empty, made_with, options

FROZEN = Path(__file__).parent / "frozen.jsonl"
MADE_WITH = "made with"


def read(path: Path) -> dict[str, list[Found]]:
    """Cells as they are kept, one a line."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {each["cell"]: each["found"] for each in map(json.loads, lines)}


def line_of(name: str, found: list[Found]) -> str:
    """A cell as it is kept."""
    return json.dumps({"cell": name, "found": found}, ensure_ascii=False) + "\n"


def chosen(name: str, texts: list[str]) -> bool:
    """Whether a cell has one of the texts in its name; without texts any is."""
    return not texts or any(text in name for text in texts)


def measured(texts: list[str], known: dict[str, list[Found]]) -> Iterator[tuple[str, list[Found]]]:
    """The chosen cells; those that are known are not done again."""
    for name, lines in CELLS.items():
        if chosen(name, texts):
            yield name, known[name] if name in known else answers(name, lines)
    if not texts or "help" in " ".join(texts):
        yield from ((name, found) for name, found in options() if chosen(name, texts))


def differences(frozen: list[Found] | None, found: list[Found], *, values: bool = True) -> Iterator[str]:
    """What differs, in a sentence each; without `values` only statuses and names are compared."""
    if frozen is None:
        yield "is not frozen"
        return
    if len(frozen) != len(found):
        yield f"{len(found)} answers, not {len(frozen)}"
    for number, (before, now) in enumerate(zip(frozen, found, strict=False), 1):
        which = f"answer {number}: "
        if before["status"] != now["status"]:
            yield f"{which}exit status {now['status']}, not {before['status']} {now.get('said', '')}"
            continue
        yield from (which + text for text in _names(before.get("names", []), now.get("names", [])))
        if values:
            old, new = before.get("values", {}), now.get("values", {})
            yield from (f"{which}{name} has changed" for name in old if name in new and old[name] != new[name])
            yield from (f"{which}{name} is gone" for name in old.keys() - new.keys())
            yield from (f"{which}{name} is new" for name in new.keys() - old.keys())


def _names(before: Any, now: Any) -> Iterator[str]:
    if before == now:
        return
    if isinstance(before, str) or isinstance(now, str):
        yield "other names in JSON; those of scene thesis_single say which"
    elif gone := [name for name in before if name not in now]:
        yield f"without the names {', '.join(gone)}"
    elif new := [name for name in now if name not in before]:
        yield f"with the new names {', '.join(new)}"
    else:
        yield "the names come in another order"


def matters(told: list[str]) -> bool:
    """Whether more differs than the words of a help text."""
    return any(f": {WORDS} " not in each for each in told)


def main() -> int:
    """Measure, compare and tell."""
    parser = argparse.ArgumentParser(prog="python -m tests.frozen", description=str(__doc__).splitlines()[0])
    parser.add_argument("texts", nargs="*", help="only cells whose names have one of them")
    parser.add_argument("--kept", type=Path, metavar="FILE", help="keep what is found there, and go on with it")
    parser.add_argument("--accept", action="store_true", help="write what is found into frozen.jsonl")
    asked = parser.parse_args()
    os.environ["COLUMNS"] = "80"
    frozen, known = read(FROZEN), read(asked.kept) if asked.kept else {}
    before, now = frozen.get(MADE_WITH, [{}]), [made_with()]
    if before != now:
        print(f"values are not compared, only names: frozen with {before[0]}, this is {now[0]}")
    drawn_empty()
    different = 0
    for name, found in measured(asked.texts, known):
        if asked.kept and name not in known:
            with asked.kept.open("a", encoding="utf-8") as file:
                file.write(line_of(name, found))
        told = list(differences(frozen.get(name), found, values=before == now))
        different += matters(told)
        print(f"{time.process_time():6.1f} s  {name}: {'; '.join(told) or 'same'}", flush=True)
        frozen[name] = found
    if asked.accept:
        lines = [line_of(name, found) for name, found in {**frozen, MADE_WITH: now}.items()]
        FROZEN.write_text("".join(lines), encoding="utf-8")
    print(f"{different} cells differ")
    return 1 if different and not asked.accept else 0


if __name__ == "__main__":
    sys.exit(main())
