"""What a point is on disk: canonical JSON, and float32 samples."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

import numpy as np

from instrument.errors import RangeError

Waveforms = Mapping[str, tuple[float, np.ndarray]]
_OWN_COLUMNS = frozenset({"id", "bench_ns", "simulated"})


def encoded(data: Mapping[str, object], waveforms: Waveforms) -> tuple[str, list[tuple[str, float, np.ndarray]]]:
    """A point as it is stored: its text, and name, rate and float32 samples of each waveform. Raises RangeError."""
    if taken := _OWN_COLUMNS & data.keys():
        raise RangeError(f"a point may not have a value {', '.join(sorted(taken))}: the record sets it")
    stored = [(name, rate, _float32(name, rate, samples)) for name, (rate, samples) in waveforms.items()]
    return as_json(data), stored


def as_json(value: object) -> str:
    """One text for one value: keys sorted, no spaces, ASCII, null for NaN and infinities."""
    return json.dumps(_plain(value), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    return value


def _float32(name: str, rate: float, samples: np.ndarray) -> np.ndarray:
    if not (math.isfinite(rate) and rate > 0):
        raise RangeError(f"waveform {name!r}: the sample rate is {rate} Hz; it must be positive and finite")
    if samples.ndim != 1:
        raise RangeError(f"waveform {name!r}: the samples have shape {samples.shape}; they must be (n,)")
    try:
        with np.errstate(over="raise"):
            return np.ascontiguousarray(samples, dtype="<f4")
    except FloatingPointError:
        limit = float(np.finfo(np.float32).max)
        raise RangeError(f"waveform {name!r}: a sample is beyond float32 (±{limit:.3g})") from None
