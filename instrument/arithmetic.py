"""The last digits of a number: which kernels sum it, asked for in one place and told in each run.

OpenBLAS takes the kernels of the processor that it finds and a thread for each core, and each sums in another order, so
that fits differ by 1e-16 from machine to machine. numpy itself has sines and sums for AVX2 and AVX-512 that round
otherwise. Palpate asks for kernels that every processor has on which numpy runs (x86-64-v2), and for one thread, if it
is imported before numpy. Other libraries and processors are told apart by what a run says of them. What takes minutes
and goes into no record may ask for the processor's own kernels instead.
"""

from __future__ import annotations

import functools
import os
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

KERNELS = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",  # all that numpy 2.4 has above x86-64-v2
}
ALIKE = 1e-6  # relative difference of numbers that two arithmetics may give
NOTHING = 1e-12  # of the largest number beside it: what is smaller may be rounding alone


def same_everywhere() -> None:
    """Ask for the same kernels on every x86-64 processor, for this process and those that it starts.

    Call it before numpy is loaded: later it does nothing to this process.
    """
    if platform.machine() in ("x86_64", "AMD64"):
        os.environ.update(KERNELS)


def own_kernels() -> None:
    """Ask for the kernels of this processor, in half the time: for what takes long and goes into no record.

    Call it before numpy is loaded: later it does nothing to this process.
    """
    for name in KERNELS.keys() - {"OPENBLAS_NUM_THREADS"}:  # two threads take more time together than one
        os.environ.pop(name, None)


@functools.cache
def arithmetic() -> dict[str, str]:
    """The hardware and libraries on which the last digits of results depend.

    `processor` is only for people: two processors with the same other entries give the same digits.
    """
    import numpy as np
    from threadpoolctl import threadpool_info

    loaded = threadpool_info()
    blas = next((each for each in loaded if "numpy" in each["filepath"]), loaded[0] if loaded else {})
    parts = (blas.get(key) for key in ("internal_api", "version", "architecture"))
    config: Any = np.show_config(mode="dicts")
    vectors = config.get("SIMD Extensions", {})
    return {
        "machine": platform.machine(),
        "processor": _processor(),
        "blas": f"{' '.join(str(each) for each in parts if each)}, {blas.get('num_threads', 0)} threads",
        "vectors": " ".join([*vectors.get("baseline", []), *vectors.get("found", [])]),
        "libm": " ".join(platform.libc_ver()),
    }


def without_processor(of: Mapping[str, Any]) -> dict[str, Any]:
    """The entries on which last digits depend."""
    return {key: value for key, value in of.items() if key != "processor"}


def same_arithmetic(before: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Whether both give the same last digits."""
    return without_processor(before) == without_processor(now)


def alike(before: Any, now: Any) -> bool:
    """Whether two values, as JSON has them, are the same but for what two arithmetics make of their numbers."""
    largest = max((abs(number) for number in _numbers(before)), default=0.0)
    return _alike(before, now, NOTHING * largest)


def _alike(before: Any, now: Any, nothing: float) -> bool:
    if isinstance(before, dict) and isinstance(now, dict):
        return before.keys() == now.keys() and all(_alike(value, now[key], nothing) for key, value in before.items())
    if isinstance(before, list) and isinstance(now, list):
        return len(before) == len(now) and all(_alike(*pair, nothing) for pair in zip(before, now, strict=True))
    if isinstance(before, float) and isinstance(now, (float, int)):
        return abs(before - now) <= max(ALIKE * max(abs(before), abs(now)), nothing)
    return bool(before == now)


def _numbers(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [number for each in value.values() for number in _numbers(each)]
    if isinstance(value, list):
        return [number for each in value for number in _numbers(each)]
    return [value] if isinstance(value, float) else []


def _processor() -> str:
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8", errors="replace") as lines:
            names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
            return next(names, platform.processor())
    except OSError:
        return platform.processor()
