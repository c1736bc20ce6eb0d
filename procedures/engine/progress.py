"""How a long job tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""Is called with the points that are done, the points in all, and what is done now."""


def silent(_done: int, _total: int, _what: str) -> None:
    """Hears of progress and does nothing."""
