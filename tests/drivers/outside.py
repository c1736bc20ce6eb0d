"""Packages in `tests/examples`, as if they were installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from palpate.instrument import additions as modules
from palpate.instrument.bench import kinds

EXAMPLES = Path(__file__).parents[1] / "examples"


@contextmanager
def installed(*names: str) -> Iterator[list[EntryPoint]]:
    """Inside, the devices of these examples are known: "oven" is acme-oven."""
    entries = [EntryPoint(f"acme-{name}", f"acme_{name}:KIND", kinds.GROUP) for name in names]
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.syspath_prepend(str(EXAMPLES / name))
        patch.setattr(metadata, "entry_points", lambda group: entries if group == kinds.GROUP else [])
        modules.additions.cache_clear()
        yield entries
    modules.additions.cache_clear()
