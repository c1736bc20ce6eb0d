"""The folder in which runs and calibrations are kept, and the folder of a new run in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from palpate.instrument.errors import UsageError, check_path

STORE = "PALPATE_STORE"  # environment variable


def store() -> Path:
    """Folder of runs and calibrations: $PALPATE_STORE, or runs/ in the current folder."""
    return Path(os.environ.get(STORE, "runs"))


@contextmanager
def result_folder(out: Path | None, procedure: str, started: datetime) -> Iterator[Path]:
    """A writable folder for results: `out`, which must be new or empty, or else a new one in the store.

    Folders that were made for it and are still empty in the end are removed.

    Raises:
        UsageError: `out` holds a run or other files.
        RecordError: the folder cannot be made or written to.
    """
    import tempfile

    from palpate.procedures.records.chain import is_run
    from palpate.procedures.records.record import new_run_folder
    from palpate.procedures.records.run import storing

    folder = store() if out is None else out
    check_path(folder)
    made: list[Path] = []
    try:
        with storing(folder):
            made += [path for path in (folder, *folder.parents) if not path.exists()]
            if out is None:
                folder = new_run_folder(folder, procedure, started)
                made.insert(0, folder)
            elif is_run(folder):
                raise UsageError(f"{out} already holds a run; choose another --out")
            else:
                folder.mkdir(parents=True, exist_ok=True)
                if any(folder.iterdir()):
                    raise UsageError(f"{out} holds other files; choose a new or empty folder with --out")
            with tempfile.TemporaryFile(dir=folder):
                pass
        yield folder
    finally:
        for path in made:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
