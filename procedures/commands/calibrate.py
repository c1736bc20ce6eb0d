"""The commands palpate calibrate load-cell, calibrate films, calibrate model and calibrate accept."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands import options
from palpate.procedures.commands.settings import conducting


@click.group(cls=options.StrictGroup)
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
for each in (load_cell, films, model):
    calibrate.add_command(each)


@calibrate.command(epilog="Examples:\n\n  palpate calibrate accept runs/calibrations/load_cell-SI-0042.toml")
@click.argument("file", type=options.FILE_NAME)
@options.output_options
def accept(file: Path, as_json: bool, quiet: bool) -> None:
    """Accept a calibration that was edited by hand, after you have checked it.

    FILE holds a hash of its content, and runs refuse it once the content was changed. This command gives it a new hash
    and today's date, which every run that uses it reports.
    """
    from datetime import UTC, datetime

    from palpate.instrument.calibration.files import accept_calibration

    output = options.Output(as_json, quiet)
    found = accept_calibration(file, datetime.now(UTC).date())
    if output.as_json:
        output.json({"calibration_file": str(file), "accepted": found.accepted if found else None})
    output.line(f"{file}: {f'{found.source}{found.marks()}' if found else 'is as it was written, nothing to accept'}")
