"""palpate calibrate."""

from __future__ import annotations

import click

from procedures.cli.options import Choice, Output, bench_options


@click.group()
def calibrate() -> None:
    """Calibrate a part of the bench."""


@calibrate.command(
    "load-cell",
    epilog="Examples:\n\n  palpate calibrate load-cell\n\n  palpate calibrate load-cell --bench lab.toml",
)
@bench_options
def load_cell(choice: Choice, output: Output) -> None:
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line with uncertainty and stores it; later sweeps with the same indicator use and name it.
    linearity and reversibility are fractions of the span, resolution is in mV.
    """
    from instrument.calibration import write_calibration
    from procedures import load_cell as procedure
    from procedures.cli.session import calibration_path, conduct
    from procedures.report.load_cell import plot_load_cell, print_load_cell
    from procedures.run import storing

    session, result, outcome = conduct(
        procedure.PROCEDURE,
        choice,
        output,
        {"masses_kg": procedure.MASSES, "repeats": procedure.REPEATS},
        lambda _: None,
        lambda session, progress: procedure.run(
            session.bench, session.record, progress, session.started.isoformat(timespec="seconds")
        ),
        calibrating=True,
    )
    write_calibration(session.record.folder / "calibration.toml", result.calibration)
    path = calibration_path(session.bench.indicator.serial)
    with storing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, result.calibration)
    plot = plot_load_cell(result, session.bench.simulated, session.record.folder)
    outcome = {**outcome, "calibration": result.calibration.source, "calibration_file": str(path)}
    if output.as_json:
        output.json({**outcome, "points": result.points, **result.summary(), "plot": str(plot)})
    elif output.for_people:
        print_load_cell(result, outcome, plot)
