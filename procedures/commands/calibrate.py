"""The commands palpate calibrate load-cell, calibrate films, calibrate model and calibrate accept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.conducts import conducts
from palpate.procedures.commands.options import option

if TYPE_CHECKING:
    from palpate.procedures.measurements.films.procedure import FilmSeries
    from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
    from palpate.procedures.measurements.references.procedure import ReferenceSeries
    from palpate.procedures.measurements.references.reference import Reference


@click.group(cls=options.Group)
def calibrate() -> None:
    """Calibrate a part of the bench."""


@calibrate.command(
    "load-cell",
    epilog="Examples:\n\n  palpate calibrate load-cell\n\n  palpate calibrate load-cell --bench lab.toml"
    "\n\n  palpate calibrate load-cell --tolerance '0.3 %' --dry-run"
    "\n\n  palpate calibrate load-cell --loads '100 gf:1000 gf:100 gf' --runs 2 --positions 0,120,240 --class 1",
)
@option(
    "--loads",
    callback=texts.loads,
    default="140 gf:740 gf:100 gf",
    help="Weights: first:last:step or a list, increasing.",
)
@option("--runs", default=1, help="Runs up and down in each position; 2 give repeatability.")
@option(
    "--positions",
    callback=texts.quantities("", "120"),
    default="0",
    help="Degrees about the cell's axis; ISO 376 has 0,120,240.",
)
@option(
    "--degree",
    type=click.Choice(["auto", "1", "2"]),
    default="auto",
    help="Degree of the curve; auto: 2 if an F-test finds it better.",
)
@option(
    "--class",
    "iso_class",
    metavar="CLASS",
    help="Class of ISO 376 that shall be reached, 00, 0.5, 1 or 2; if it is not, the exit status is 1.",
)
@option(
    "--tolerance",
    callback=texts.share,
    help="Relative standard uncertainty of the sensitivity: the series is planned for it, of --loads at hand.",
)
@option(
    "--loads-u",
    callback=texts.quantity("", "0.02 %"),
    help="Relative standard uncertainty of all loads together: weights and local gravity (default: exact).",
)
@option("--creep", is_flag=True, help="Measure the creep under the greatest load for 300 s.")
@option("--valid-days", default=365, help="Days until the calibration expires.")
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def load_cell(
    loads: tuple[float, ...],
    runs: int,
    positions: tuple[float, ...],
    degree: str,
    iso_class: str | None,
    tolerance: float | None,
    loads_u: float | None,
    creep: bool,
    valid_days: int,
) -> LoadCellSeries:
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line, or a curve if it is better, with its uncertainty; classifies the cell by ISO 376 and ASTM E74; writes a
    certificate; and stores the calibration. Later runs with the same indicator use and name it, within its loads and
    until it expires.

    With --tolerance the plan takes as many of the weights and runs as are needed, and refuses beforehand what they
    cannot give; --runs are then the fewest. With --class a calibration that is not of that class or better is stored
    all the same, and the command says what binds.
    """
    from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries

    curve = None if degree == "auto" else int(degree)
    asked = iso_class, tolerance, loads_u or 0.0
    return LoadCellSeries(loads, runs, positions, curve, creep, valid_days, *asked)


@calibrate.command(
    epilog="Examples:\n\n  palpate calibrate films --budget"
    "\n\n  palpate calibrate films --frequencies '5 Hz, 10 Hz, 20 Hz'"
    "\n\n  palpate calibrate films --tolerance 1%"
    "\n\n  palpate calibrate films --scene array_16 --json\n\n  palpate calibrate films --bench lab.toml"
)
@options.loads_option("1.5 N:4 N:0.5 N")
@option("--frequencies", callback=texts.quantities("Hz"), default="10 Hz", help="Frequencies of the load, with commas.")
@options.dwell_option
@option("--valid-days", default=365, help="Days until the calibration expires.")
@option(
    "--tolerance",
    callback=texts.share,
    help="Relative standard uncertainty of each film's sensitivity: --loads are repeated until it is reached.",
)
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def films(
    loads: tuple[float, ...],
    frequencies: tuple[float, ...],
    dwell: float,
    valid_days: int,
    extrapolate: bool,
    tolerance: float | None,
) -> FilmSeries:
    """Calibrate the films against the load cell, with each tooth pressed alone (thesis 5.4).

    Finds each film's sensitivity, linearity and clamping factor (sensitivity over the design's own) and, with several
    teeth, the crosstalk between them. Stores the calibration: later runs with the same sensor on the same node use and
    name it instead of the design's sensitivities.
    """
    from palpate.procedures.measurements.films.procedure import FilmSeries

    return FilmSeries(loads, frequencies, dwell, valid_days, extrapolate, tolerance)


@calibrate.command(
    epilog="Examples:\n\n  palpate calibrate model --reference 'A: 48 kPa ± 2 %' --reference 'B: 90 kPa ± 3 %'"
    "\n\n  palpate calibrate model --reference 'A: runs/20261123T101500Z-test-modulus' --bench lab.toml"
)
@option(
    "--reference",
    "references",
    callback=texts.references,
    required=True,
    multiple=True,
    metavar="'NAME: MODULUS ± U'",
    help="Object of known modulus with its standard uncertainty, or 'NAME: RUN' of palpate test modulus; repeatable.",
)
@options.loads_option("1.5 N:4 N:0.5 N")
@options.dwell_option
@options.frequency_option
@option("--model", "answering", metavar="NAME", default="auto", help="Sensor model that is calibrated.")
@option("--parameters", default="physical", help="Its parameter set: thesis, physical, identified or capped.")
@option("--thickness", callback=texts.quantity("m", positive=True), default="3 mm", help="Thickness of the references.")
@option("--valid-days", default=365, help="Days until the calibration expires.")
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def model(
    references: tuple[Reference, ...],
    loads: tuple[float, ...],
    dwell: float,
    frequency: float,
    answering: str,
    parameters: str,
    thickness: float,
    valid_days: int,
) -> ReferenceSeries:
    """Calibrate a sensor model by references, objects of known Young modulus.

    Mounts each reference and measures its force ratio. Finds the constant between the model's curve and the measured
    ratios, and how much objects differ about it; the spread is pooled with that of the thesis' samples, unless the
    references refute it. Stores the calibration: later runs of this sensor with this model use and name it for absolute
    uncertainties. References that contradict each other or the curve are refused by name. Tells what another reference
    would buy.
    """
    from palpate.procedures.measurements.references.procedure import ReferenceSeries

    return ReferenceSeries(references, loads, dwell, frequency, answering, parameters, thickness, valid_days)


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
