"""Rates of serial lines and CAN buses [bit/s], alike in a map and in a bench file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

BITRATES = range(10_000, 1_000_001)  # of CAN buses
Baudrate = Annotated[int, Field(ge=300, le=4_000_000, strict=True)]
Bitrate = Annotated[int, Field(ge=BITRATES[0], le=BITRATES[-1], strict=True)]
