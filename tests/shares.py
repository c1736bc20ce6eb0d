"""Parametrised tests of which one case always runs, and the others with the slow tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest


def first_of(cases: Sequence[Any]) -> list[Any]:
    """The cases, as `pytest.mark.parametrize` takes them; all but the first are slow."""
    more = [each if isinstance(each, tuple) else (each,) for each in cases[1:]]
    return [cases[0], *(pytest.param(*each, marks=pytest.mark.slow) for each in more)]
