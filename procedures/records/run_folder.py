"""The folder of a run: the names of its files, and whether it holds a run."""

from __future__ import annotations

import contextlib
import fcntl
import os
from datetime import UTC, datetime
from pathlib import Path

from palpate.procedures.records.chain import read_head

RECORD, HEAD_FILE = "run.record", "run.head"


def is_run(folder: Path) -> bool:
    """Whether a folder holds a run or what is left of one; not if its writer was killed before the run had begun."""
    if _is_there(folder / RECORD):
        return True
    head = read_head(folder / HEAD_FILE)[0]
    return head is not None and head.frames > 0


def _is_there(path: Path) -> bool:
    """Whether anything has that name, even a broken link or a file that may not be read; its reader reports that."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def is_written(folder: Path) -> bool:
    """Whether a process is writing the run in a folder. It is asked for an instant only, so that none is kept out."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def last_modified(folder: Path) -> datetime:
    """Time of the last write to any file in a folder; to the folder itself where its files may not be listed."""
    times = [0.0]
    with contextlib.suppress(OSError):
        times = [folder.lstat().st_mtime]
        times = [path.lstat().st_mtime for path in folder.iterdir()] or times
    return datetime.fromtimestamp(max(times), UTC)
