"""Writing the files of what is measured once and shipped: prices of models and validation."""

from __future__ import annotations

from pathlib import Path

from palpate.procedures.records.run import storing


def keep(text: str, path: Path) -> None:
    """Replace a file at once, so that an interruption leaves the old one.

    Raises:
        RecordError: it cannot be written.
    """
    fresh = path.with_suffix(".new")
    with storing(path):
        fresh.write_text(text, encoding="utf-8")
        fresh.replace(path)
