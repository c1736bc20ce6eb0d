"""Rates of serial lines and CAN buses [bit/s], alike in a map and in a bench file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

Baudrate = Annotated[int, Field(ge=300, le=4_000_000, strict=True)]
Bitrate = Annotated[int, Field(ge=10_000, le=1_000_000, strict=True)]
