"""The command palpate campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.procedures.commands.options import (
    FILE_NAME,
    PROGRESS,
    Output,
    StrictCommand,
    assume_option,
    live_options,
    option,
    output_options,
)
from palpate.procedures.lab.store import store

if TYPE_CHECKING:
    from palpate.procedures.campaign import PlannedStep
    from palpate.procedures.engine.verdict import Judgement

BY_WEIGHT = (0, 4, 3)  # exit statuses, the heaviest last


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate campaign nightly.toml --dry-run\n\n  palpate campaign nightly.toml --out tonight"
    "\n\n  palpate campaign nightly.toml --json",
)
@click.argument("campaign", type=FILE_NAME)
@option("--dry-run", is_flag=True, help="Print what is due, how long it takes and what a person does; send nothing.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder of its state; one that was begun there goes on.")
@assume_option
@live_options
@PROGRESS
@output_options
def campaign(
    campaign: Path,
    dry_run: bool,
    out: Path | None,
    assume_mounted: bool,
    live: int | None,
    progress: str,
    as_json: bool,
    quiet: bool,
) -> int:
    """Carry out the procedures in CAMPAIGN.toml in the order in which they need each other.

    A calibration that is not due is left out. A campaign that was killed goes on, with the same --out: what is complete
    stays, the run that was begun is resumed, the others follow. A step may have limits: if its result does not pass,
    the steps that need it are left out. Exit status 3: a limit fails; 4: one is undecided, and none fails. The page of
    --live goes from one run to the next.
    """
    from palpate.procedures.campaign import Campaign

    output = Output(as_json, quiet, progress, live=live)
    found = Campaign(campaign, store(), out, assume_mounted)
    planned = found.planned()
    head = {"campaign": found.file.name, "simulated": found.chosen.scene is not None}
    if dry_run:
        seconds = sum(step.seconds for step in planned)
        rows = [step.summary() for step in planned]
        head |= {"folder": None if out is None else str(out), "dry_run": True, "seconds": seconds, "steps": rows}
        output.result(lambda: head, lambda: _show_ahead(planned))
        return 0
    rows, judged = [], []
    with output.prices(), output.served(pausable=False) as output:
        _tell_page(output, head, rows, planned)
        for step, verdicts in found.carried_out(output.listener):
            folder = found.folder_of(step.name) if step.due else None
            told_of = {} if verdicts is None else verdicts.summary()
            rows.append({**step.summary(), "run": None if folder is None else str(folder), **told_of})
            judged.append((step, verdicts))
            _tell_page(output, head, rows, planned)
    output.result(lambda: {**head, "folder": str(found.folder), "steps": rows}, lambda: _show_done(head, rows, judged))
    return max((verdicts.status for _, verdicts in judged if verdicts is not None), key=BY_WEIGHT.index, default=0)


def _tell_page(
    output: Output, head: Mapping[str, object], rows: Sequence[Mapping[str, object]], planned: Sequence[PlannedStep]
) -> None:
    """Tell a live page which steps are done, which is next, and what a person does for it."""
    if output.page is not None:
        ahead = [step.summary() for step in planned[len(rows) :]]
        output.page.tell("campaign", {**head, "done": len(rows), "steps": [*rows, *ahead]})


def _show_ahead(planned: Sequence[PlannedStep]) -> None:
    """Print what is due, how long that takes, and what a person does for it."""
    from palpate.procedures.showing.plan import duration
    from palpate.procedures.showing.text import new_table, print_all

    table = new_table(None, "step", "procedure", "due", "why", "time")
    for step in planned:
        time = duration(step.seconds) if step.due else "-"
        table.add_row(step.name, step.procedure.name, "yes" if step.due else "no", step.why, time)
    person = [f"{step.name}: a person {step.person}" for step in planned if step.person]
    print_all(table, f"all together   {duration(sum(step.seconds for step in planned))}", *person)


def _show_done(
    head: Mapping[str, object],
    rows: Sequence[Mapping[str, object]],
    judged: Sequence[tuple[PlannedStep, Judgement | None]],
) -> None:
    """Print the runs, and why limits do not pass."""
    from palpate.procedures.showing.text import new_table, print_all, stamped

    title = stamped(bool(head["simulated"]), f"Campaign {head['campaign']}")
    table = new_table(title, "step", "procedure", "why", "run", "verdict")
    for row in rows:
        table.add_row(*(str(row.get(column) or "-") for column in ("name", "procedure", "why", "run", "verdict")))
    print_all(
        table,
        *(
            f"{step.name}: {each.quantity}: {each.outcome}: {each.reason}"
            for step, verdicts in judged
            for each in (() if verdicts is None else verdicts.verdicts)
            if each.outcome != "pass"
        ),
    )
