"""The commands palpate sweep loads, sweep frequency, sweep temperature and sweep position."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import StrictGroup
from palpate.procedures.commands.settings import conducting


@click.group(cls=StrictGroup)
def sweep() -> None:
    """Sweep a quantity and record the sensor's response. At a terminal `p` pauses between points, Ctrl-C stops."""


loads = conducting(
    "loads",
    "sweep-loads",
    """Load each sample with each load set and measure the force ratio.

    Prints for every point the load, indicator reading, film voltages, forces and the force ratio with its standard
    uncertainty, for each tooth if there are several; then the mean ratio and the softness order, with the thesis'
    values.
    """,
    "palpate sweep loads",
    "palpate sweep loads --samples 1,3 --loads '2 N, 3 N' --dwell '2 s'",
    "palpate sweep loads --scene thesis_common_base --tolerance '15 %'",
    "palpate sweep loads --loads '3 N' --tolerance '2 %'",
    "palpate sweep loads --model column --seed 7 --json",
    "palpate sweep loads --bench lab.toml --out first-day",
    model=True,
)
frequency = conducting(
    "frequency",
    "sweep-frequency",
    """Measure gain and phase of each film over frequency, the charge amplifiers' corner, and the resonance.

    The gain is film voltage over the load that the load cell measures. Exciter and sensor nodes have no common clock,
    so the phase is the lead over the first base film. The band of touch, up to 20 Hz, is marked.
    """,
    "palpate sweep frequency",
    "palpate sweep frequency --frequencies '0.2 Hz, 1 Hz, 10 Hz' --sample 6",
    "palpate sweep frequency --scene everything --dry-run",
    model=True,
)
temperature = conducting(
    "temperature",
    "sweep-temperature",
    """Measure what a change of temperature adds to the films' signals, and what a fitted trend leaves of it.

    A point is measured right after each change of the surroundings. The errors of a lock-in amplifier and of a
    voltmeter on the same record are shown next to the fit with a trend. The default scene is humid_body; only scenes
    with the effect pyroelectric have anything to show.
    """,
    "palpate sweep temperature",
    "palpate sweep temperature --scene long_drift",
    "palpate sweep temperature --temperatures '0 K, 5 K, 15 K, 10 K' --soak '10 min' --bench lab.toml",
    scene="humid_body",
    model=True,
)
position = conducting(
    "position",
    "sweep-position",
    """Move a point load along the base of two teeth, and find its place and size from the films.

    With --tolerance or --time a plan says, before anything moves, how many load sets there are at each position, what
    they take and how well the places will be known. A tolerance that some positions cannot have is refused with what
    binds there, and with the positions that can. The default scene is thesis_common_base. The thesis' Table A2.7 is
    shown next to it, with its doubts.
    """,
    "palpate sweep position",
    "palpate sweep position --positions '6 mm, 12 mm, 18 mm' --sample 6 --load '3 N'",
    "palpate sweep position --positions '2 mm, 12 mm' --tolerance '0.2 mm' --dry-run",
    scene="thesis_common_base",
)
for each in (loads, frequency, temperature, position):
    sweep.add_command(each)
