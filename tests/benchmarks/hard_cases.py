"""Digits of agreement of the hard cases, each beside a reference that shares no solver with it, the hardest first."""

from __future__ import annotations

import math
from collections.abc import Iterator

from tests.benchmarks.row import Row
from tests.hard_cases import CASES


def measure() -> Iterator[Row]:
    found = [(-math.log10(case.error()), case) for case in CASES.values()]
    for digits, case in sorted(found, key=lambda each: each[0]):
        told = f"{digits:.1f} digits beside {case.reference}; predicted: {case.predicted}"
        yield Row(case.name, told, f">= {case.least:g}", digits >= case.least)
