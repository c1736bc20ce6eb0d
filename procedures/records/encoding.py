"""A point on disk: canonical JSON, float32 samples, and a CRC-32 over each row."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping

import numpy as np

from palpate.instrument.errors import RangeError

Waveforms = Mapping[str, tuple[float, np.ndarray]]
SAMPLE = np.dtype("<f4")
REAL = "fiub"  # kinds of numpy types: real numbers, and true and false
LONGEST = 100  # characters of a value in a message
LARGEST_ROW = 40_000_000  # bytes; a point has some thousand
_OWN_COLUMNS = frozenset({"id", "bench_ns", "simulated"})
_ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


def encoded(data: Mapping[str, object], waveforms: Waveforms) -> tuple[str, list[tuple[str, float, np.ndarray]]]:
    """Encode a point: its text, and name, rate and float32 samples of each waveform. Raises RangeError."""
    if taken := _OWN_COLUMNS & data.keys():
        raise RangeError(f"a point may not have a value {', '.join(sorted(taken))}: the record sets it")
    stored = [(name, float(rate), _float32(name, rate, samples)) for name, (rate, samples) in waveforms.items()]
    return as_json(data), stored


def as_json(value: object) -> str:
    """Canonical JSON of a value: keys sorted, no spaces, ASCII, null for NaN and infinities. Raises as `plain` does."""
    try:
        return _ENCODER.encode(value)
    except (TypeError, ValueError):  # numpy's values, NaN, or what is no JSON at all
        return _ENCODER.encode(plain(value))


def row_crc32(*values: object) -> int:
    """CRC-32 of the values in a row."""
    return zlib.crc32(json.dumps(values).encode())


def waveform_crc32(point_id: int, name: str, rate: float, samples: np.ndarray) -> int:
    """CRC-32 of a row and its samples, (n,) float32."""
    return zlib.crc32(samples.view(np.uint8).data, row_crc32(point_id, name, rate, samples.size))


def verify(what: str, crc32: int, *values: object) -> None:
    """Check the CRC-32 of a row. Raises ValueError: the row is damaged."""
    if row_crc32(*values) != crc32:
        raise ValueError(f"{what} is not as it was written, CRC-32 differs")


def plain(value: object, where: str = "") -> object:
    """A value of which JSON can be made: numpy's values as numbers and lists, and null for NaN and infinities.

    Raises RangeError: it holds something else than numbers, texts, true, false, null, and lists and tables of these;
    `where` names its place in the message.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (str, int, float)):
        return value
    if isinstance(value, Mapping):
        return {_name(key, where): plain(item, f"{where}.{key}" if where else str(key)) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item, where) for item in value]
    raise RangeError(
        f"{where or 'it'}: {str(value)[:LONGEST]} is of type {type(value).__name__}, which a record cannot hold; give "
        "numbers, texts, true or false, or lists and tables of these"
    )


def _name(key: object, where: str) -> str:
    """A key of a table as text."""
    if isinstance(key, (str, int)):
        return str(key)
    raise RangeError(f"{where or 'it'}: {key!r} names a value; a name must be a text")


def _float32(name: str, rate: float, samples: np.ndarray) -> np.ndarray:
    if not (math.isfinite(rate) and rate > 0):
        raise RangeError(f"waveform {name!r}: the sample rate is {rate} Hz; it must be positive and finite")
    samples = np.asarray(samples)
    if samples.dtype.kind not in REAL:
        raise RangeError(f"waveform {name!r}: the samples are {samples.dtype}; they must be numbers")
    if samples.ndim != 1:
        raise RangeError(f"waveform {name!r}: the samples have shape {samples.shape}; they must be (n,)")
    try:
        with np.errstate(over="raise"):
            return np.ascontiguousarray(samples, dtype=SAMPLE)
    except FloatingPointError:
        limit = float(np.finfo(SAMPLE).max)
        raise RangeError(f"waveform {name!r}: a sample is beyond float32 (±{limit:.3g})") from None
