"""Sparse files: a hole of 200 GB takes no space on disk, but hours to read."""

from __future__ import annotations

import os
from pathlib import Path

from palpate.instrument.errors import RecordError

MOST = 1_000_000_000  # bytes of holes; a file of a run has none, a copy of it some MB


def check_holes(path: Path) -> None:
    """Refuse a file whose holes are too large. Raises RecordError. A path that is no file is left to its reader."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe would be waited for
    except OSError:
        return
    try:
        size = os.fstat(handle).st_size
        begins = _too_many(handle, size) if size > MOST else None
    finally:
        os.close(handle)
    if begins is not None:
        raise RecordError(
            f"{path} is damaged (it is {size} bytes long, and more than {MOST} of them were never written, a hole from "
            f"byte {begins} on); restore it from a copy, or cut it off there: truncate -s {begins}"
        )


def _too_many(handle: int, size: int) -> int | None:
    """Start of the hole with which all holes together become too large; None: they do not."""
    at = holes = 0
    while at < size:
        begins = os.lseek(handle, at, os.SEEK_HOLE)
        try:
            at = os.lseek(handle, begins, os.SEEK_DATA) if begins < size else size
        except OSError:  # no data follows
            at = size
        holes += at - begins
        if holes > MOST:
            return begins
    return None
