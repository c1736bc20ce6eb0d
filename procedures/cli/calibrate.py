"""palpate calibrate."""

from __future__ import annotations

from dataclasses import asdict

import click

from procedures.cli.options import Choice, Output, bench_options


@click.group()
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
    "--positions", default="0", show_default=True, help="Of the cell about its axis, degrees; ISO 376: 0,120,240."
)
@click.option(
    "--degree",
    type=click.Choice(["auto", "1", "2"]),
    default="auto",
    show_default=True,
    help="Of the curve; auto: 2 where an F-test finds it better.",
)
@click.option("--creep", is_flag=True, help="Watch the greatest load for 300 s.")
@click.option("--valid-days", default=365, show_default=True, help="Until the calibration expires.")
@bench_options
def load_cell(
    loads: str, runs: int, positions: str, degree: str, creep: bool, valid_days: int, choice: Choice, output: Output
) -> None:
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line, or a curve where it is better, with uncertainty; classifies by ISO 376 and ASTM E74; writes a
    certificate; stores the calibration: later sweeps with the same indicator use and name it, until it expires and
    within its loads.
    """
    from instrument.calibration_file import write_calibration
    from procedures import load_cell as procedure
    from procedures.certificate import write_certificate
    from procedures.cli.session import calibration_path, conduct
    from procedures.load_plan import parse_loads
    from procedures.report.load_cell import plot_load_cell, print_load_cell
    from procedures.run import storing

    settings = procedure.LoadCellSettings(
        parse_loads(loads),
        runs,
        parse_positions(positions),
        None if degree == "auto" else int(degree),
        creep,
        valid_days,
    )
    session, result, outcome = conduct(
        procedure.PROCEDURE,
        choice,
        output,
        {**asdict(settings), "repeats": procedure.REPEATS},
        lambda bench: procedure.check(settings, bench.force_limit),
        lambda session, progress: procedure.run(session.bench, settings, session.record, progress, session.started),
        calibrating=True,
    )
    folder = session.record.folder
    write_calibration(folder / "calibration.toml", result.calibration)
    path = calibration_path(session.bench.indicator.serial)
    with storing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, result.calibration)
    certificate = write_certificate(folder, result.calibration)
    plot = plot_load_cell(result, session.bench.simulated, folder)
    outcome = {
        **outcome,
        "calibration": result.calibration.source,
        "calibration_file": str(path),
        "certificate": str(certificate),
    }
    if output.as_json:
        output.json({**outcome, "points": result.points, **result.summary(), "plot": str(plot)})
    elif output.for_people:
        print_load_cell(result, outcome, plot)


def parse_positions(text: str) -> tuple[float, ...]:
    """Degrees from "0,120,240".

    Raises:
        QuantityError: not a number.
    """
    from instrument.quantity import parse

    return tuple(parse(part, "") for part in text.split(","))
