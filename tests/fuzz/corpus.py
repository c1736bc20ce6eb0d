"""Inputs that were met or thought of, kept for good; `<decoder>-<what>`."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

CORPUS = Path(__file__).with_name("corpus")


def keep(name: str, data: bytes) -> Path:
    path = CORPUS / f"{name}-{sha256(data).hexdigest()[:8]}"
    path.write_bytes(data)
    return path
