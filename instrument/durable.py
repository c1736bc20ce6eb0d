"""Files that are on disk, also after a power cut, before the caller goes on."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

from palpate.instrument.errors import check_path


def sync(path: Path) -> None:
    """Sync a file to disk; or a folder, whose names are not on disk before although its files are. Raises OSError."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def numbered(name: str) -> Iterator[str]:
    """The name, then `name`-2, `name`-3, and so on: for a folder or a file whose name may be taken."""
    yield name
    for count in itertools.count(2):
        yield f"{name}-{count}"


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing. Raises OSError."""
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in made:
        sync(path.parent)


def put_whole(path: Path, text: str) -> None:
    """Write a text file; after a crash it is the old one or the new one, never a part.

    Raises OSError: the folder is missing, full or read-only.
    """
    check_path(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        with draft.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    sync(path.parent)
