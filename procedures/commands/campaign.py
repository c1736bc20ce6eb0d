"""The command palpate campaign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate.procedures.commands.options import (
    FILE_NAME,
    PROGRESS,
    Output,
    StrictCommand,
    assume_option,
    option,
    output_options,
)
from palpate.procedures.lab.store import store

if TYPE_CHECKING:
    from palpate.procedures.campaign import PlannedStep


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate campaign nightly.toml --dry-run\n\n  palpate campaign nightly.toml --out tonight"
    "\n\n  palpate campaign nightly.toml --json",
)
@click.argument("campaign", type=FILE_NAME)
@option("--dry-run", is_flag=True, help="Print what is due, how long it takes and what a person does; send nothing.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder of its state; one that was begun there goes on.")
@assume_option
@PROGRESS
@output_options
def campaign(
    campaign: Path, dry_run: bool, out: Path | None, assume_mounted: bool, progress: str, as_json: bool, quiet: bool
) -> None:
    """Carry out the procedures in CAMPAIGN.toml in the order in which they need each other.

    A calibration that is not due is left out. A campaign that was killed goes on, with the same --out: what is complete
    stays, the run that was begun is resumed, the others follow.
    """
    from palpate.procedures.campaign import Campaign

    output = Output(as_json, quiet, progress)
    found = Campaign(campaign, store(), out, assume_mounted)
    planned = found.planned()
    told = {"campaign": found.file.name, "simulated": found.chosen.scene is not None, "folder": str(found.folder)}
    if dry_run:
        seconds = sum(step.seconds for step in planned)
        rows = [step.summary() for step in planned]
        told |= {"dry_run": True, "seconds": seconds, "steps": rows}
        output.result(lambda: told, lambda: _show(planned, {}))
        return
    rows = []
    with output.prices():
        for step, _ in found.carried_out(output.listener):
            folder = found.folder_of(step.name)
            rows.append({**step.summary(), "run": None if folder is None else str(folder)})
    output.result(lambda: {**told, "steps": rows}, lambda: _show(planned, {row["name"]: row["run"] for row in rows}))


def _show(planned: list[PlannedStep], runs: dict[str, Any]) -> None:
    """Print the steps: what each is expected to take before a campaign, where each is stored after it."""
    from palpate.procedures.showing.plan import duration
    from palpate.procedures.showing.text import new_table, print_all

    last = "run" if runs else "time"
    table = new_table(None, "step", "procedure", "due", "why", last)
    for step in planned:
        end = (runs.get(step.name) or "-") if runs else duration(step.seconds) if step.due else "-"
        table.add_row(step.name, step.procedure.name, "yes" if step.due else "no", step.why, end)
    person = [f"{step.name}: a person {step.person}" for step in planned if step.person]
    total = [] if runs else [f"all together   {duration(sum(step.seconds for step in planned))}"]
    print_all(table, *total, *person)
