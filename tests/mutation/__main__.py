"""Mutation testing: small mistakes are put into the code one by one, and tests must find them.

    python -m tests.mutation drivers policy contracts effects record   all mistakes in these parts
    python -m tests.mutation drivers --share 0.1                 one in ten of them
    python -m tests.mutation instrument/signals/noise.py         in one file
    python -m tests.mutation --since HEAD~3                      in the lines changed since a commit
    python -m tests.mutation FILE --tests 'tests/procedures/**/test_*.py'    by other tests than those that name it

It prints each mistake that no test finds, or that was found because the tests took too long (on a busy machine look
at these yourself), and for each file how many of a hundred are found. A file in
`campaigns/` (or in `$PALPATE_CAMPAIGN`) keeps what was found: given again, the command goes on, and tries again what
had survived. It takes 1 s a mistake, and `pytest-cov` (the group `coverage`).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant, mutants, mutated
from tests.mutation.reach import Reach, reach
from tests.mutation.tried import ENDLESS, KILLED, SURVIVED, import_libraries, tried

GOAL = 0.9
FOLDERS = ("instrument", "drivers", "simulators", "procedures")
SLOWER, AT_LEAST = 5.0, 20.0  # a mutant may take so many times as long as its tests, and so many seconds in any case


@dataclass(frozen=True)
class Part:
    """Files to mutate, and tests that are to find the mistakes: patterns of paths, or names of single tests."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


PARTS = {
    "drivers": Part(
        ("drivers/**/*.py",),
        ("tests/drivers/test_*.py", "tests/procedures/test_policy.py", "tests/procedures/test_bus_*.py"),
    ),
    "contracts": Part(
        ("instrument/contracts/*.py",),
        ("tests/instrument/test_contract*.py", "tests/instrument/test_export.py",
         "tests/drivers/test_golden_frames.py"),
    ),
    "effects": Part(
        ("simulators/effects/*.py",),
        ("tests/simulators/test_effects*.py", "tests/simulators/test_shares.py", "tests/simulators/test_omission.py"),
    ),
    "policy": Part(
        ("procedures/steps/policy.py",),
        (
            "tests/procedures/test_policy.py",
            "tests/procedures/test_documentation.py::test_the_table_of_incidents_is_that_of_the_policies",
        )
    ),
    "record": Part(
        ("procedures/records/record*.py", "procedures/records/chain.py"),
        ("tests/procedures/test_record*.py", "tests/procedures/test_chain*.py", "tests/procedures/test_check.py"),
    ),
}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", nargs="*", help=f"{', '.join(PARTS)}, or files")
    parser.add_argument("--since", metavar="COMMIT", help="only lines that were changed since")
    parser.add_argument(
        "--tests", metavar="PATTERN", help="tests that are to find them; those are run that reach the line (default: "
        "of a part its own, of another file those that name its module, though commands may reach it, too)",
    )  # fmt: skip
    parser.add_argument("--share", type=float, default=1.0, help="of the mistakes, drawn by chance")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    given = parser.parse_args()
    if not 0 < given.share <= 1:
        parser.error(f"a share of {given.share} is not above 0 and at most 1")
    changed = changed_lines(given.since) if given.since else None
    if not given.what and changed is None:
        parser.error(f"say what: {', '.join(PARTS)}, files, or --since COMMIT")
    if missing := [name for name in given.what if name not in PARTS and not Path(name).is_file()]:
        parser.error(f"{missing[0]!r} is neither a part ({', '.join(PARTS)}) nor a file")
    folder = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns"))
    folder.mkdir(parents=True, exist_ok=True)
    import_libraries()
    counts: dict[str, tuple[int, int]] = {}
    for part in parts_of(given.what or [str(file) for file in changed or {}], given.tests):
        for file, mutant, status in found(part, folder, given.share, given.seed, changed):
            killed, all_ = counts.get(str(file), (0, 0))
            counts[str(file)] = killed + (status != SURVIVED), all_ + 1
            if status != KILLED:
                say(f"{file}:{mutant.line}: {mutant.what}{' (found by its time-out alone)' * (status == ENDLESS)}")
    return report(counts)


def parts_of(names: Sequence[str], tests: str | None) -> Iterator[Part]:
    """A file that stands alone has the tests of its part, or else those that name its module.

    All files that are tried by tests of a pattern are one part: these tests run once to tell what they reach.
    """
    if tests:
        files = [file for name in names for file in (PARTS[name].files if name in PARTS else (name,))]
        yield Part(tuple(files), (tests,))
        return
    for name in names:
        if name in PARTS:
            yield PARTS[name]
            continue
        home = next((part for part in PARTS.values() if Path(name) in matching(part.files)), None)
        yield Part((name,), home.tests if home else tuple(naming(Path(name))))


def naming(file: Path) -> Iterator[str]:
    """Tests that import from a module, or are named after it."""
    module = re.compile(rf"\b{re.escape('.'.join(('palpate', *file.with_suffix('').parts)))}\b")
    for test in sorted(Path("tests").rglob("test_*.py")):
        if test.stem == f"test_{file.stem}" or module.search(test.read_text()):
            yield str(test)


def found(
    part: Part, folder: Path, share: float, seed: int, changed: dict[Path, set[int]] | None
) -> Iterator[tuple[Path, Mutant, str]]:
    """Every mutant of a part that is asked for, and what became of it."""
    files = matching(part.files)
    named = [test for test in part.tests if "::" in test]
    tests = [*named, *map(str, matching(test for test in part.tests if test not in named))]
    chosen = [
        (file, mutant)
        for file in files
        for mutant in mutants(file.read_text())
        if (changed is None or mutant.line in changed.get(file, ()))
        and random.Random(f"{seed} {file} {mutant.line} {mutant.column} {mutant.what}").random() < share
    ]
    if not chosen:
        return
    if not tests:
        raise SystemExit(f"no test names {', '.join(map(str, files))}: nothing could find a mistake in it")
    state = folder / "mutation.jsonl"
    known = killed_before(state)
    reached: Reach | None = None
    with state.open("a", encoding="utf-8") as out:
        for file, mutant in chosen:
            key = name_of(file, mutant)
            status = known.get(key)
            if status is None:
                if reached is None:
                    say(f"{len(chosen)} mistakes; first the tests without any: {' '.join(part.tests)}")
                    reached = reach(files, tests, folder / "reach.json")
                status = outcome(file, mutant, reached)
                out.write(json.dumps({"mutant": key, "status": status}) + "\n")
                out.flush()
            yield file, mutant, status


def outcome(file: Path, mutant: Mutant, reached: Reach) -> str:
    tests = reached.tests(file, mutant)
    if not tests:
        return SURVIVED
    seconds = AT_LEAST + SLOWER * sum(reached.seconds[test] for test in tests)
    source = file.read_text()
    return tried(file, lambda: mutated(source, mutant.number, str(file.resolve())), tests, seconds)


def killed_before(state: Path) -> dict[str, str]:
    """What need not be tried again."""
    if not state.exists():
        return {}
    rows = [json.loads(line) for line in state.read_text().splitlines()]
    return {row["mutant"]: row["status"] for row in rows if row["status"] != SURVIVED}


def name_of(file: Path, mutant: Mutant) -> str:
    """The key of this mistake in this version of the file."""
    version = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    return f"{file} {version} {mutant.line}:{mutant.column} {mutant.what}"


def matching(patterns: Iterable[str]) -> list[Path]:
    return sorted({path for pattern in patterns for path in Path().glob(pattern) if path.name != "__init__.py"})


def changed_lines(commit: str) -> dict[Path, set[int]]:
    """Lines of the code that stand otherwise than in a commit, or were not there."""
    command = ["git", "diff", "--unified=0", "--no-color", "--relative", commit, "--", *FOLDERS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"git does not know what has changed since {commit}: {done.stderr.strip()}")
    lines: dict[Path, set[int]] = {}
    file = None
    for row in done.stdout.splitlines():
        if row.startswith("+++ "):
            file = Path(row.removeprefix("+++ b/")) if row.endswith(".py") else None
        elif file and (hunk := re.match(r"@@ -\S+ \+(\d+)(?:,(\d+))? @@", row)):
            start, count = int(hunk[1]), int(hunk[2] or 1)
            lines.setdefault(file, set()).update(range(start, start + count))
    return lines


def report(counts: dict[str, tuple[int, int]]) -> int:
    """Prints the scores; 1 where the goal is missed."""
    width = max(map(len, counts), default=0)
    for name, (killed, all_) in sorted(counts.items()):
        say(f"{name:{width}}  {killed:5} of {all_:5}  {killed / all_:7.1%}")
    killed, all_ = (sum(count[place] for count in counts.values()) for place in (0, 1))
    if not all_:
        say("nothing to change")
        return 0
    met = killed / all_ >= GOAL
    say(
        f"{'all':{width}}  {killed:5} of {all_:5}  {killed / all_:7.1%}, goal {GOAL:.0%}: {'met' if met else 'NOT MET'}"
    )
    return 0 if met else 1


def say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
