"""The base of all tables of a scene: no number of theirs is of a size with which nothing can be computed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pydantic import model_validator

from palpate.instrument.config import Config

LEAST, GREATEST = 1e-30, 1e30  # in SI units; products of a few such numbers neither vanish nor overflow


class Numbers(Config):
    """A table of a scene. A key says by its own limits what is physical; beyond these it is refused anyway."""

    @model_validator(mode="after")
    def _computable(self) -> Numbers:
        """Raises ValueError: a number is neither 0 nor of a size that can be computed with."""
        for key in type(self).model_fields:
            for value in _floats(getattr(self, key)):
                if value and not LEAST <= abs(value) <= GREATEST:
                    raise ValueError(
                        f"{key} = {value:g} is no size that can be computed with; give 0, or {LEAST:g} to {GREATEST:g} "
                        "of either sign"
                    )
        return self


def _floats(value: Any) -> Iterator[float]:
    if isinstance(value, float) and math.isfinite(value):  # others are refused by `Config`
        yield value
    elif isinstance(value, tuple):
        for each in value:
            yield from _floats(each)
