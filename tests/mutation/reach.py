"""Which tests reach which line of a module, and how long each takes: measured once, by coverage.py."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.mutation.mutants import Mutant
from tests.mutation.tried import PYTEST, in_child, silence

LONGEST = 900  # s, for all tests without a mistake
ENOUGH = 12.0  # s of a processor for one mutant
BEFORE = ""  # coverage.py's name for what runs before any test


@dataclass(frozen=True)
class Reach:
    """Tests that pass without a mistake.

    Attributes:
        seconds: that each test takes, its fixtures included.
        work: processor time of each test [s], which is the same on a busy machine.
        lines: for each file, by its path from here, the tests that run a line of it; "" stands for what runs before
            any test, as when a module is imported.
    """

    seconds: dict[str, float]
    work: dict[str, float]
    lines: dict[str, dict[int, list[str]]]

    def tests(self, file: Path, mutant: Mutant) -> list[str]:
        """Those that may find a mistake, the fastest first; before all others, those in files named after the module.

        Where the line runs before any test, all tests may find it; first come those that run the line, too, then those
        that run another line of the file.
        """
        lines = self.lines.get(str(file), {})
        near = {test for line in lines.values() for test in line}
        reaching = set(lines.get(mutant.line, ()))
        found = self.work.keys() if mutant.runs_at_import or BEFORE in reaching else reaching
        own = f"/test_{file.stem}"

        def order(test: str) -> tuple[object, ...]:
            return own not in test, test not in reaching, test not in near, self.work[test], test

        chosen, spent = [], 0.0
        for test in sorted(found, key=order):
            spent += self.work[test]
            if spent > ENOUGH and chosen:
                break
            chosen.append(test)
        return chosen


def reach(files: Sequence[Path], tests: Sequence[str], kept: Path) -> Reach:
    """Run the tests once, in a process of its own. SystemExit where one of them fails."""
    log = kept.with_suffix(".log")
    status = in_child(lambda: _measured(files, tests, kept, log), LONGEST)
    if status != 0:
        raise SystemExit(f"the tests do not pass as they stand (pytest ended with {status}); see {log}")
    found = json.loads(kept.read_text())
    lines = {file: {int(line): names for line, names in by.items()} for file, by in found["lines"].items()}
    return Reach(found["seconds"], found["work"], lines)


class _Contexts:
    """Tells coverage.py which test runs."""

    def __init__(self, coverage: object) -> None:
        self.coverage = coverage
        self.seconds: dict[str, float] = {}
        self.work: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.coverage.switch_context(item.nodeid)  # type: ignore[attr-defined]
        begun = time.process_time()
        try:
            return (yield)
        finally:
            self.work[item.nodeid] = time.process_time() - begun

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration


def _measured(files: Sequence[Path], tests: Sequence[str], kept: Path, log: Path) -> int:
    from coverage import Coverage

    silence(log)
    measured = Coverage(data_file=None, config_file=False, include=[str(file.resolve()) for file in files])
    measured.start()
    contexts = _Contexts(measured)
    status = int(pytest.main([*PYTEST, *tests], plugins=[contexts]))
    measured.stop()
    data = measured.get_data()
    known = {str(file.resolve()): str(file) for file in files}
    lines = {known[name]: data.contexts_by_lineno(name) for name in data.measured_files() if name in known}
    kept.write_text(json.dumps({"seconds": contexts.seconds, "work": contexts.work, "lines": lines}))
    return status
