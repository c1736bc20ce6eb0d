"""The command palpate judge."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.completion import RUN
from palpate.procedures.commands.options import FILE_NAME, JUNIT, Output, StrictCommand, check_junit, output_options


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate judge first-day limits.toml"
    "\n\n  palpate judge runs/20260102T030405Z-sweep-loads limits.toml --junit verdicts.xml --json",
)
@RUN
@click.argument("limits", type=FILE_NAME)
@JUNIT
@output_options
def judge(run: str, limits: Path, junit: Path | None, as_json: bool, quiet: bool) -> int:
    """Judge a run by limits: does its result lie within? RUN is a folder or a name in runs/, LIMITS a TOML file.

    A limit passes if the value lies outside with at most the stated risk, and fails if it lies beyond the limit with
    all but that risk (JCGM 106). Else it is undecided, and the reason says which uncertainty would decide it. Exit
    status 3: a limit fails; 4: one is undecided, and none fails. Each procedure judges its result with --limits, too.
    """
    from palpate.procedures.commands.procedures import tell_verdicts
    from palpate.procedures.engine.verdict import judge as judged_by
    from palpate.procedures.engine.verdict import read_limits
    from palpate.procedures.lab.store import store
    from palpate.procedures.records.run import Run, find_run

    check_junit(junit)
    output = Output(as_json, quiet, limits=limits, junit=junit)
    asked, opened = read_limits(limits), Run.open(find_run(run, store()))
    found = judged_by(opened, asked)
    if as_json:
        about = {"run": str(opened.folder), "procedure": opened.procedure, "simulated": opened.simulated}
        output.json({**about, **found.summary()})
    return tell_verdicts(found, opened, output)
