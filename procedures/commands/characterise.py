"""The command palpate characterise."""

from __future__ import annotations

from palpate.procedures.commands.settings import conducting

characterise = conducting(
    "characterise",
    "characterise",
    """Measure the sensor's characteristics (thesis 2.1), each with its standard uncertainty.

    Signal-to-noise ratio, force sensitivity, resolution, linearity, hysteresis, dynamic range and drift of every film,
    and the sensor's spatial resolution. The loads go up, then down; then the middle one is held.

    With --tolerance or --time a plan says, before anything moves, how often the loads go up, what that takes and how
    uncertain each figure will be. A tolerance that the load cell's calibration does not allow is refused.
    """,
    "palpate characterise",
    "palpate characterise --scene noisy_lab --drift-time '10 min'",
    "palpate characterise --tolerance '3 %' --drift-time '1 min' --dry-run",
    "palpate characterise --budget",
)
