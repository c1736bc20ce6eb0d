"""The short commands of procedures: palpate sweep, calibrate, test and characterise."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, output_options
from palpate.procedures.commands.settings import conducting


@click.group(cls=StrictGroup)
def sweep() -> None:
    """Sweep a quantity and record the sensor's response. At a terminal `p` pauses between points, Ctrl-C stops."""


loads = conducting(
    "loads",
    "sweep-loads",
    """Load each sample with each load and measure the force ratio.

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


@click.group(cls=StrictGroup)
def calibrate() -> None:
    """Calibrate a part of the bench."""


load_cell = conducting(
    "load-cell",
    "calibrate-load-cell",
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line, or a curve if it is better, with its uncertainty; classifies the cell by ISO 376 and ASTM E74; writes a
    certificate; and stores the calibration. Later runs with the same indicator use and name it, within its loads and
    until it expires.

    With --tolerance the plan takes as many of the weights and runs as are needed, and refuses beforehand what they
    cannot give; --runs are then the fewest. With --class a calibration that is not of that class or better is stored
    all the same, and the command says what binds.
    """,
    "palpate calibrate load-cell",
    "palpate calibrate load-cell --bench lab.toml",
    "palpate calibrate load-cell --tolerance '0.3 %' --dry-run",
    "palpate calibrate load-cell --loads '100 gf:1000 gf:100 gf' --runs 2 --positions 0,120,240 --class 1",
)
films = conducting(
    "films",
    "calibrate-films",
    """Calibrate the films against the load cell, with each tooth pressed alone (thesis 5.4).

    Finds each film's sensitivity, linearity and clamping factor (sensitivity over the design's own) and, with several
    teeth, the crosstalk between them. Stores the calibration: later runs with the same sensor on the same node use and
    name it instead of the design's sensitivities.
    """,
    "palpate calibrate films --budget",
    "palpate calibrate films --frequencies '5 Hz, 10 Hz, 20 Hz'",
    "palpate calibrate films --tolerance 2%",
    "palpate calibrate films --scene array_16 --json",
    "palpate calibrate films --bench lab.toml",
)
model = conducting(
    "model",
    "calibrate-model",
    """Calibrate a sensor model by references, objects of known Young modulus.

    Mounts each reference and measures its force ratio. Finds the constant between the model's curve and the measured
    ratios, and how much objects differ about it; the spread is pooled with that of the thesis' samples, unless the
    references refute it. Stores the calibration: later runs of this sensor with this model use and name it for absolute
    uncertainties. References that contradict each other or the curve are refused by name. Tells what another reference
    would buy.
    """,
    "palpate calibrate model --reference 'A: 48 kPa ± 4 %' --reference 'B: 90 kPa ± 6 %'",
    "palpate calibrate model --reference 'A: runs/20261123T101500Z-test-modulus' --bench lab.toml",
)


@calibrate.command(epilog="Examples:\n\n  palpate calibrate accept runs/calibrations/load_cell-SI-0042.toml")
@click.argument("file", type=FILE_NAME)
@output_options
def accept(file: Path, as_json: bool, quiet: bool) -> None:
    """Accept a calibration that was edited by hand, after you have checked it.

    FILE holds a hash of its content, and runs refuse it once the content was changed. This command gives it a new hash
    and today's date, which every run that uses it reports.
    """
    from datetime import UTC, datetime

    from palpate.instrument.calibration.files import accept_calibration

    output = Output(as_json, quiet)
    found = accept_calibration(file, datetime.now(UTC).date())
    if output.as_json:
        output.json({"calibration_file": str(file), "accepted": found.accepted if found else None})
    output.line(f"{file}: {f'{found.source}{found.marks()}' if found else 'is as it was written, nothing to accept'}")


@click.group(cls=StrictGroup)
def test() -> None:
    """Test a sample on the bench, without the sensor."""


modulus = conducting(
    "modulus",
    "test-modulus",
    """Compress a sample with the micro-positioner and find its Young modulus (thesis 5.3, Tables 5.2 and 5.3).

    A rigid support takes the sensor's place. Pressing the bare support gives the compliance of suspension and load
    cell, which is corrected for. Pressing the sample on it gives stress and strain, tangent and secant modulus, for
    loading and unloading, each with its standard uncertainty. Loads below the calibrated range are marked.
    """,
    "palpate test modulus --sample 1",
    "palpate test modulus --sample 6 --strain '20 %' --steps 20 --budget",
    "palpate test modulus --sample 2 --bench lab.toml --json",
)


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

GROUPS = {sweep: (loads, frequency, temperature, position), calibrate: (load_cell, films, model), test: (modulus,)}
for group, commands in GROUPS.items():
    for command in commands:
        group.add_command(command)
SHORT = (*(command for commands in GROUPS.values() for command in commands), characterise)
