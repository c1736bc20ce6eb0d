"""The commands palpate reproduce and reproduce models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, option, output_options
from palpate.procedures.lab.store import result_folder


@click.group(
    cls=StrictGroup,
    invoke_without_command=True,
    epilog="Examples:\n\n  palpate reproduce\n\n  palpate reproduce --out compared --json",
)
@option("--seed", type=click.IntRange(0, 2**63 - 1), help="Seed of the simulated scenes.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the files (default: new in runs/).")
@output_options
@click.pass_context
def reproduce(context: click.Context, seed: int | None, out: Path | None, as_json: bool, quiet: bool) -> int:
    """Compare every table and figure of the thesis' chapters 4 and 5 with the models and simulated experiments.

    Runs and records sweeps of the three arrangements, a load-cell calibration and compressions of samples. The models'
    tables come from stored finite-element solutions. Writes one HTML page with plots, and a CSV file for each table:
    the thesis' value as printed and as repaired, palpate's value, their difference, the error in percent of theory and
    of experiment, and what a match is worth.

    Each row is input (the thesis' number itself was used), fitted (parameters were chosen to meet this table) or
    predicted (neither); each class is counted separately. Exit status 1 if a class fails: input rows all need an
    answer, 93 % of them within twice their stated scatter, and no table or arrangement may have a mean error that
    chance does not explain; fitted rows must all meet the goal of the fit; predicted rows all need an answer, whatever
    its error; and the orders of softness must be right.
    """
    if context.invoked_subcommand is not None:
        return 0
    from palpate.instrument.notice import price
    from palpate.procedures.reproduce import everything
    from palpate.procedures.reproduce.models import Reproduction, table_object
    from palpate.procedures.reproduce.page import Everything, print_everything

    output = Output(as_json, quiet)
    with result_folder(out, everything.PROCEDURE, datetime.now(UTC)) as folder:
        done = Everything(Reproduction(folder))
        with _kept(done.tables, folder), output.prices(), output.progress() as progress:
            price("measuring every experiment and drawing every figure", everything.SECONDS)
            everything.run(done, seed, progress)
    if output.as_json:
        output.json(
            {
                "folder": str(folder),
                "page": str(done.page),
                **done.summary(),
                "tables": [table.summary(file) for table, file in done.tables],
                "models": [table_object(comparison, file) for comparison, file in done.models.tables],
            }
        )
    elif output.for_people:
        print_everything(done)
    return 0 if done.met() else 1


@contextmanager
def _kept(tables: Sequence[object], folder: Path) -> Iterator[None]:
    """A context in which every error says how many tables are finished."""
    try:
        yield
    except BaseException as error:
        if tables:
            error.add_note(f"{len(tables)} tables that were done are kept in {folder}")
        raise


@reproduce.command(
    epilog="Examples:\n\n  palpate reproduce models\n\n  palpate reproduce models --parameters identified"
    " --out compared\n\n  palpate reproduce models --json"
)
@option("--parameters", default="both", help="Sets of the sensor models: physical, identified or both.")
@option("--fresh", is_flag=True, help="Solve everything anew, and write the solutions.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the files (default: new in runs/).")
@output_options
def models(parameters: str, fresh: bool, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Compare the thesis' finite-element tables, theories and figures of chapter 4 with the sensor models.

    Writes Tables 4.1 to 4.6, A2.1 to A2.7 and 5.8 cell by cell as CSV, with repaired cells marked; what
    chapter 4 draws from numbers as PNG, with the thesis' values as marks and palpate's as curves; and a summary.
    """
    from palpate.instrument.notice import price
    from palpate.procedures.reproduce import models as against
    from palpate.procedures.reproduce.models import table_object
    from palpate.procedures.reproduce.page import print_reproduction

    output = Output(as_json, quiet)
    chosen = against.parameter_sets(parameters)
    with result_folder(out, against.PROCEDURE, datetime.now(UTC)) as folder:
        done = against.Reproduction(folder)
        with _kept(done.tables, folder), output.prices(), output.progress("solving") as progress:
            if fresh:
                price("solving everything anew", against.FRESH * len(chosen) / len(against.SETS))
            else:
                price("drawing every figure", against.SECONDS)
            against.run(chosen, done, progress, fresh)
    if output.as_json:
        output.json(
            {
                "parameters": list(chosen),
                "folder": str(folder),
                "summary": str(done.summary),
                "tables": [table_object(comparison, file) for comparison, file in done.tables],
                "figures": [
                    {"name": p.number, "content": p.shows, "caption": p.caption, "file": str(p.file)}
                    for p in done.pictures
                ],
            }
        )
    elif output.for_people:
        print_reproduction(done)
