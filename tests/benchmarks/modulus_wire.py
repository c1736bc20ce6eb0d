"""The share of `modulus_budget.py` that runs on the wire: drawn ratios are the bench's, and so is the time."""

from __future__ import annotations

import math
from collections.abc import Iterator

from tests.benchmarks.modulus_bench import Truth, differences, fast, on_the_wire
from tests.benchmarks.modulus_budget import KINDS, asked
from tests.benchmarks.row import Row

# kind of truth, tolerance, object [Pa], seed
RUNS = (
    ("scatter learned", 0.05, 15e3, 1),
    ("scatter learned", 0.05, 60e3, 2),
    ("scatter learned", 0.05, 500e3, 2),
    ("scatter learned", 0.02, 120e3, 3),
    ("scatter x 1.5", 0.05, 500e3, 4),
    ("mounting scatter 1 %", 0.03, 60e3, 5),
    ("moving cables", 0.1, 30e3, 6),
    ("off the model's curve by a drawn distance", 0.1, 250e3, 7),
)
ALIKE, SECONDS, QUICK = (0.8, 1.25), 0.1, 85.0
FIVE = 0.05


def compared(kind: str, tolerance: float, modulus: float, seed: int) -> tuple[list[float], float, float]:
    """Ratios on the wire less drawn ones in standard deviations of noise; bench times on the wire and drawn [s]."""
    truth: Truth = KINDS[kind].truth(modulus, seed)
    measuring = asked(KINDS[kind], tolerance, truth)
    done = on_the_wire(measuring, truth)
    steps = len(done.points)
    drawn = fast(measuring, truth, steps)
    return list(differences(done, truth)), done.seconds, drawn.seconds


def measure() -> Iterator[Row]:
    far, ratios, five = [], [], []
    for kind, tolerance, modulus, seed in RUNS:
        deviates, seconds, drawn = compared(kind, tolerance, modulus, seed)
        far += deviates
        ratios.append(seconds / drawn)
        if tolerance == FIVE and kind == "scatter learned":
            five.append(seconds)
    rms = math.sqrt(math.fsum(z * z for z in far) / len(far))
    yield Row(
        f"ratios of {len(RUNS)} runs on the wire less drawn ones / their noise, rms of {len(far)}",
        f"{rms:.2f}, {max(map(abs, far)):.1f} at most",
        f"{ALIKE[0]} to {ALIKE[1]}",
        ALIKE[0] <= rms <= ALIKE[1],
    )
    low, high = min(ratios), max(ratios)
    met = low >= 1 - SECONDS and high <= 1 + SECONDS
    yield Row("bench time of as many sets on the wire / drawn", f"{low:.2f} to {high:.2f}", "0.9 to 1.1", met)
    worst = max(five)
    told = f"{min(five):.1f} to {worst:.1f} s"
    yield Row(
        "5 % on the scale, 15 to 500 kPa: bench time with the person's 60 s", told, f"<= {QUICK:g} s", worst <= QUICK
    )
