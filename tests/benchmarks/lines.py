"""What a campaign that can be ended and gone on with has found: a line of JSON each."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def read(file: Path, kind: Callable[..., T]) -> Iterator[T]:
    """What a file holds, if there is one; `kind` makes each of its line's values."""
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        try:
            yield kind(**json.loads(line))
        except (ValueError, TypeError):
            continue  # cut off when the command was ended
