"""palpate reproduce."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from procedures.cli.options import FILE_NAME, Output, output_options, result_folder


@click.group()
def reproduce() -> None:
    """Set the thesis' tables and figures beside ours."""


@reproduce.command(
    epilog="Examples:\n\n  palpate reproduce models\n\n  palpate reproduce models --parameters identified"
    " --out compared\n\n  palpate reproduce models --json"
)
@click.option(
    "--parameters", default="both", show_default=True, help="Of the sensor models: physical, identified or both."
)
@click.option("--out", type=FILE_NAME, metavar="DIR", help="Where the files go (default: new in runs/).")
@output_options
def models(parameters: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Finite-element tables, theories of Table 5.8 and figures of chapter 4, beside the sensor models.

    Tables 4.1, 4.3, 4.5, A2.1, A2.3, A2.5, A2.7 and 5.8 cell by cell as CSV, repaired cells marked; Figures 4.4, 4.7,
    4.8 and 4.12 to 4.17 as PNG, what they show being inferred; a summary. Takes a minute or two.
    """
    from procedures.reproduce import models as against
    from procedures.reproduce.files import table_object
    from procedures.reproduce.show import print_reproduction

    output = Output(as_json, quiet)
    chosen = against.parameter_sets(parameters)
    with result_folder(out, against.PROCEDURE, datetime.now(UTC)) as folder:
        done = against.Reproduction(folder)
        try:
            with output.progress("solving") as progress:
                against.run(chosen, done, progress)
        except BaseException as error:
            if done.tables:
                error.add_note(f"{len(done.tables)} tables that were done are kept in {folder}")
            raise
    if output.as_json:
        output.json(
            {
                "parameters": list(chosen),
                "folder": str(folder),
                "summary": str(done.summary),
                "tables": [table_object(comparison, file) for comparison, file in done.tables],
                "figures": [
                    {"name": p.name, "content": p.content, "inferred_from": p.ground or None, "file": str(p.file)}
                    for p in done.pictures
                ],
            }
        )
    elif output.for_people:
        print_reproduction(done)
