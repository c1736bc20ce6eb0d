"""The commands palpate calibrate load-cell, calibrate films and calibrate accept."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import (
    FILE_NAME,
    Choice,
    Group,
    Output,
    bench_options,
    budget_option,
    dwell_option,
    extrapolate_option,
    output_options,
)


@click.group(cls=Group)
def calibrate() -> None:
    """Calibrate a part of the bench."""


@calibrate.command(
    "load-cell",
    epilog="Examples:\n\n  palpate calibrate load-cell\n\n  palpate calibrate load-cell --bench lab.toml"
    "\n\n  palpate calibrate load-cell --loads '100 gf:1000 gf:100 gf' --runs 2 --positions 0,120,240 --creep",
)
@click.option(
    "--loads", default="140 gf:740 gf:100 gf", show_default=True, help="Weights: first:last:step or a list, increasing."
)
@click.option("--runs", default=1, show_default=True, help="Runs up and down in each position; 2 give repeatability.")
@click.option(
    "--positions", default="0", show_default=True, help="Degrees about the cell's axis; ISO 376 has 0,120,240."
)
@click.option(
    "--degree",
    type=click.Choice(["auto", "1", "2"]),
    default="auto",
    show_default=True,
    help="Degree of the curve; auto: 2 if an F-test finds it better.",
)
@click.option("--creep", is_flag=True, help="Measure the creep under the greatest load for 300 s.")
@click.option("--valid-days", default=365, show_default=True, help="Days until the calibration expires.")
@bench_options
@budget_option
def load_cell(
    loads: str,
    runs: int,
    positions: str,
    degree: str,
    creep: bool,
    valid_days: int,
    choice: Choice,
    output: Output,
) -> None:
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line, or a curve if it is better, with its uncertainty; classifies the cell by ISO 376 and ASTM E74; writes a
    certificate; and stores the calibration. Later runs with the same indicator use and name it, within its loads and
    until it expires.
    """
    from palpate.instrument.quantity import parse_list
    from palpate.procedures.commands.procedures import measure
    from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
    from palpate.procedures.steps.checks import parse_loads

    series = LoadCellSeries(
        parse_loads(loads),
        runs,
        parse_list(positions, ""),
        None if degree == "auto" else int(degree),
        creep,
        valid_days,
    )
    measure(series, choice, output)


@calibrate.command(
    epilog="Examples:\n\n  palpate calibrate films --budget"
    "\n\n  palpate calibrate films --frequencies '5 Hz, 10 Hz, 20 Hz'"
    "\n\n  palpate calibrate films --scene array_16 --json\n\n  palpate calibrate films --bench lab.toml"
)
@click.option("--loads", default="1.5 N:4 N:0.5 N", show_default=True, help="first:last:step or a list; peak to peak.")
@click.option("--frequencies", default="10 Hz", show_default=True, help="Frequencies of the load, with commas.")
@dwell_option
@click.option("--valid-days", default=365, show_default=True, help="Days until the calibration expires.")
@extrapolate_option
@bench_options
@budget_option
def films(
    loads: str,
    frequencies: str,
    dwell: str,
    valid_days: int,
    extrapolate: bool,
    choice: Choice,
    output: Output,
) -> None:
    """Calibrate the films against the load cell, with each tooth pressed alone (thesis 5.4).

    Finds each film's sensitivity, linearity and clamping factor (sensitivity over the design's own) and, with several
    teeth, the crosstalk between them. Stores the calibration: later runs with the same sensor on the same node use and
    name it instead of the design's sensitivities.
    """
    from palpate.instrument.quantity import parse, parse_list
    from palpate.procedures.commands.procedures import measure
    from palpate.procedures.measurements.films.procedure import FilmSeries
    from palpate.procedures.steps.checks import parse_loads

    series = FilmSeries(parse_loads(loads), parse_list(frequencies, "Hz"), parse(dwell, "s"), valid_days, extrapolate)
    measure(series, choice, output)


@calibrate.command(epilog="Examples:\n\n  palpate calibrate accept runs/calibrations/load_cell-SI-0042.toml")
@click.argument("file", type=FILE_NAME)
@output_options
def accept(file: Path, as_json: bool, quiet: bool) -> None:
    """Accept a calibration that was edited by hand, after you have checked it.

    FILE holds a hash of its content, and runs refuse it once the content was changed. This command gives it a new hash
    and today's date, which every run that uses it reports. A file that is older than the hashes is accepted in the same
    way.
    """
    from datetime import UTC, datetime

    from palpate.instrument.calibration.files import accept_calibration

    output = Output(as_json, quiet)
    found = accept_calibration(file, datetime.now(UTC).date())
    if output.as_json:
        output.json({"calibration_file": str(file), "accepted": found.accepted if found else None})
    output.line(f"{file}: {f'{found.source}{found.marks()}' if found else 'is as it was written, nothing to accept'}")
