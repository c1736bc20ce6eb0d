"""The command palpate study."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, option, output_options
from palpate.procedures.lab.store import store

AHEAD = 4  # blocks of cells that are handed out in advance for each worker, so that none has to wait
FOLDER = "studies"
EXPORTED = 100_000  # cells; of more, a table as text takes longer than the cells


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate study study.toml\n\n  palpate study study.toml --workers 8 --to parquet"
    "\n\n  palpate study study.toml --dask tcp://cluster:8786 --json",
)
@click.argument("study", type=FILE_NAME)
@option("--workers", type=click.IntRange(1, 1000), help="Number of processes (default: one for each core).")
@option("--dask", metavar="ADDRESS", help="Compute on this dask scheduler instead.")
@option(
    "--to",
    type=click.Choice(["csv", "parquet"]),
    help=f"Format of the table of points (default: csv; beyond {EXPORTED:,} cells no table is written by default).",
)
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder of the study (default: runs/studies/<file's name>).")
@output_options
def study(
    study: Path, workers: int | None, dask: str | None, to: str | None, out: Path | None, as_json: bool, quiet: bool
) -> int:
    """Sweep the loads on many simulated scenes: a grid or random draws over the axes in STUDY.toml.

    Stored cells are not computed again: after Ctrl-C or a kill, give the command again. If a cell fails, its reason is
    stored, the others go on, and the exit status is 1. The results do not depend on the workers that compute them.
    """
    from dataclasses import asdict
    from importlib import metadata

    from palpate.instrument.errors import EstimateError, UsageError
    from palpate.procedures.records.chain import check_holes
    from palpate.procedures.records.export import FORMATS, check_format
    from palpate.procedures.study.description import read_study
    from palpate.procedures.study.results import plot_study, print_study, read_results
    from palpate.procedures.study.run import RECORD, Store, run
    from palpate.procedures.virtual.study_cell import StudyComputation, executor_of

    output = Output(as_json, quiet)
    if workers is not None and dask is not None:
        raise UsageError("--workers and --dask: the scheduler has workers of its own; leave one option out")
    check_format(to or FORMATS[0])
    asked = read_study(study)
    sweep = StudyComputation.of(asked, str(study))
    folder = store() / FOLDER / study.stem if out is None else out
    described = {
        "palpate": metadata.version("palpate"),
        "study": asked.file.model_dump(mode="json"),
        "order of axes": list(asked.axes),  # it determines the numbers of the cells
        "scenes": {name: file.model_dump(mode="json") for name, file in sweep.scenes.items()},
    }
    if packages := sweep.packages(asked):
        described["packages"] = packages
    check_holes(folder / RECORD)
    with Store(folder, described) as opened:
        if opened.done < len(asked):
            with output.progress("starting") as progress, executor_of(workers, dask) as (executor, count):
                run(asked, sweep.block, executor, opened, progress, AHEAD * count)
        results = read_results(folder)
        tally = results.tally()
        failed = [{"cell": cell, "reason": reason} for cell, reason in tally.failed.items()]
        exported = to is not None or tally.cells <= EXPORTED
        outcome = {
            "simulated": True,
            "study": str(folder),
            "name": asked.file.name,
            "how": asked.file.how,
            "cells": len(asked),
            "done": tally.cells,
            "one_by_one": dict(tally.one_by_one),
            "failed": failed,
            "digest": results.digest(),
            "points": str(results.export(to or FORMATS[0], folder)) if exported else None,
            "plot": str(plot_study(results, folder)),
        }
    output.result(
        lambda: {**outcome, "results": [asdict(mean) for mean in results.means()] if exported else None},
        lambda: print_study(results, outcome),
    )
    if not failed and not tally.with_mean:
        raise EstimateError(
            f"none of the points of the {outcome['done']} cells is valid, so there is no result; their flags are in "
            f"{outcome['points'] or 'the table that --to csv writes'}"
        )
    return 1 if failed else 0
