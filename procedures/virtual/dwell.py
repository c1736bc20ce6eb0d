"""Measures uncertainty and bias against the dwell, on a long simulated record."""

from __future__ import annotations

from dataclasses import replace

from palpate.instrument.errors import RangeError
from palpate.instrument.signals.estimators import ESTIMATORS
from palpate.procedures.accuracy.dwell import DWELLS, FEWEST, DwellPrices, check, measure
from palpate.simulators.planning.long_record import is_followed, long_record
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene

RECORD, SHORT_RECORD = 400.0, 40.0  # s; the short one where each transition of a scene must be found
SAMPLES_PER_CYCLE = 25
MOST_SAMPLES = 10_000_000


def price(
    scene: str,
    seed: int | None,
    question: Question,
    rate: float,
    dwells: tuple[float, ...] | None = None,
    estimators: tuple[str, ...] = (),
) -> DwellPrices:
    """Simulate the record and measure it. Raises UsageError before anything is simulated."""
    chosen = read_scene(scene)
    if seed is not None:
        chosen = chosen.with_seed(seed)
    names = estimators or tuple(ESTIMATORS)
    check(dwells or (1 / question.frequency,), names, question.frequency, rate, float("inf"))
    duration = SHORT_RECORD if is_followed(chosen, question) else RECORD
    if dwells is None:
        cycle = 1 / question.frequency
        dwells = tuple(d for d in DWELLS if cycle * (1 - 1e-9) <= d <= duration / FEWEST) or (cycle, 10 * cycle)
    duration = max(duration, FEWEST * max(dwells))
    if not duration * rate <= MOST_SAMPLES:
        raise RangeError(
            f"a record of {duration:g} s at {rate:g} Hz has more than {MOST_SAMPLES:,} samples; take a shorter dwell"
            " or a lower rate"
        )
    record = long_record(chosen, replace(question, dwell=duration), rate)
    return measure(record, question.frequency, dwells, names)
