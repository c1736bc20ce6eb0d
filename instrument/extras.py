"""Libraries that come with an extra, not with palpate itself."""

from __future__ import annotations

import importlib
from typing import Any

from palpate.instrument.errors import UsageError


def library(name: str, extra: str) -> Any:
    """The module `name`, which `palpate[extra]` brings. Raises UsageError: it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise UsageError(f"{name} cannot be imported ({error}); give: pip install 'palpate[{extra}]'") from None
