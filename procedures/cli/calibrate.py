"""palpate calibrate."""

from __future__ import annotations

from pathlib import Path

import click

from procedures.cli.options import Output, bench_options


@click.group()
def calibrate() -> None:
    """Calibrate a part of the bench."""


@calibrate.command(
    "load-cell",
    epilog="Examples:\n\n  palpate calibrate load-cell\n\n  palpate calibrate load-cell --bench lab.toml",
)
@bench_options
def load_cell(
    bench: Path | None,
    scene: str | None,
    seed: int | None,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Calibrate the load cell with dead weights, 140 to 740 gf up and down (thesis Table 5.1).

    Fits a line with uncertainty and stores it; later sweeps with the same indicator use and name it.
    linearity and reversibility are fractions of the span, resolution is in mV.
    """
    from instrument.calibration import write_calibration
    from procedures import load_cell as procedure
    from procedures import report
    from procedures.cli.session import calibration_path, open_session
    from procedures.run import storing

    output = Output(as_json, quiet)
    with (
        output.progress() as progress,
        open_session(
            procedure.PROCEDURE,
            bench=bench,
            scene=scene,
            seed=seed,
            model=None,
            out=out,
            settings={"masses_kg": procedure.MASSES, "repeats": procedure.REPEATS},
            check=lambda _: None,
            calibrating=True,
        ) as session,
    ):
        created = session.started.isoformat(timespec="seconds")
        result = procedure.run(session.bench, session.record, progress, created)
        outcome = session.outcome()
        session.record.finish("complete", {**result.summary(), "bench_seconds": outcome["bench_seconds"]})
    write_calibration(session.record.folder / "calibration.toml", result.calibration)
    path = calibration_path(session.bench.indicator.serial)
    with storing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_calibration(path, result.calibration)
    plot = report.plot_load_cell(result, session.bench.simulated, session.record.folder)
    outcome = {**outcome, "calibration": result.calibration.source, "calibration_file": str(path)}
    if output.as_json:
        output.json({**outcome, "points": result.points, **result.summary(), "plot": str(plot)})
    elif output.for_people:
        report.print_load_cell(result, outcome, plot)
