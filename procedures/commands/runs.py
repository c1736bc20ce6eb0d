"""The commands palpate runs list, show, report, plot, export, check, repair, install and resume, and palpate judge."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import (
    FILE_NAME,
    JUNIT,
    PROGRESS,
    WHERE,
    Output,
    StrictCommand,
    StrictGroup,
    assume_option,
    check_junit,
    live_options,
    option,
    output_options,
    picture_option,
)
from palpate.procedures.commands.texts import RUN, complete_run
from palpate.procedures.lab.store import store

# --- The commands palpate runs check, runs repair and runs install -------------------------------------


@click.command(
    cls=StrictCommand, epilog="Examples:\n\n  palpate runs check first-day\n\n  palpate runs check first-day --json"
)
@RUN
@output_options
def check(run: str, as_json: bool, quiet: bool) -> int:
    """Check a run for damage without changing it. RUN is a folder or a name in runs/. Exit status 1: it is damaged.

    Every row has its own hash and the hash of the row before, and a second file holds the number of rows. So each lost
    or changed row is found. A run that has not ended is not damaged.
    """
    from palpate.procedures.records.damage import check as look_over
    from palpate.procedures.records.run import find_run
    from palpate.procedures.showing.runs import check_object, print_check

    output = Output(as_json, quiet)
    found = look_over(find_run(run, store()))
    output.result(lambda: check_object(found), lambda: print_check(found))
    return 1 if found.faults else 0


@click.command(cls=StrictCommand, epilog="Examples:\n\n  palpate runs repair first-day --out mended")
@RUN
@option("--out", required=True, type=FILE_NAME, metavar="DIR", help="Folder of the new run.")
@output_options
def repair(run: str, out: Path, as_json: bool, quiet: bool) -> None:
    """Salvage a damaged run into a new one, and say what is lost. RUN is a folder or a name; it is only read.

    All undamaged rows are found, wherever they lie in the damaged file. Header and last event of the new run say what
    is lost. A run that lost only its end can be resumed.
    """
    from palpate.procedures.records.damage import repair as salvage
    from palpate.procedures.records.run import find_run
    from palpate.procedures.showing.runs import print_repaired, repaired_object

    output = Output(as_json, quiet)
    done = salvage(find_run(run, store()), out)
    output.result(lambda: repaired_object(done), lambda: print_repaired(done))


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate runs install 20260102T030405Z-calibrate-load-cell"
    "\n\n  PALPATE_STORE=/other/store palpate runs install first-day --json",
)
@RUN
@output_options
def install(run: str, as_json: bool, quiet: bool) -> None:
    """Put the calibration of a run into the store, for later runs. RUN is a folder or a name in runs/.

    A run does this itself; it is left to you where the store was full or could not be written to. No bench is opened.
    What is in the store already stays as it is, and a newer calibration there is not replaced.
    """
    from datetime import UTC, datetime

    from palpate.procedures.lab.calibrations import install_of
    from palpate.procedures.records.run import Run, find_run

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, store()))
    path, done = install_of(opened, datetime.now(UTC).date())
    output.result(
        lambda: {"run": str(opened.folder), "calibration_file": str(path), "installed": done},
        lambda: output.line(f"{path}: {'is installed' if done else 'was installed already'}"),
    )


# --- The command palpate runs resume -------------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate runs resume 20260102T030405Z-sweep-loads"
    "\n\n  palpate runs resume first-day --bench moved.toml --accept-change --json",
)
@RUN
@option("--bench", type=FILE_NAME, metavar="FILE", help="Bench file of a real bench (default: the run's own).")
@option("--accept-change", is_flag=True, help="Go on although bench or software changed; the record lists changes.")
@assume_option
@live_options
@PROGRESS
@output_options
def resume(
    run: str,
    bench: Path | None,
    accept_change: bool,
    assume_mounted: bool,
    live: int | None,
    progress: str,
    as_json: bool,
    quiet: bool,
) -> int:
    """Go on with a run that was killed, stopped or failed. RUN is a folder or a name in runs/.

    The bench is opened again and compared with the record: settings, devices, contracts, calibrations, versions. No
    finished point is lost or stored twice. A real bench continues at the next point, with its sample mounted again; a
    simulated bench repeats everything up to there, so that the finished run equals one without an interruption. If
    another machine computed the stored points, they are compared to a relative 1e-6; the record says so.
    """
    from palpate.procedures.commands.procedures import tell
    from palpate.procedures.engine.catalogue import class_of
    from palpate.procedures.engine.resume import begun, go_on
    from palpate.procedures.lab.operator import keyboard
    from palpate.procedures.records.run import Run, find_run

    opened = Run.open(find_run(run, store()))
    output = Output(as_json, quiet, progress, live=live)
    procedure = begun(opened, class_of(opened, "resume"), bench)
    with output.served(procedure.pausable) as output:
        with keyboard() as keys, output.listener() as listener:
            done = go_on(
                procedure,
                opened,
                bench=bench,
                accept_change=accept_change,
                assume_mounted=assume_mounted,
                listener=listener,
                pause=output.pause(keys),
            )
        return tell(procedure, done, output)


# --- runs list, show, report, plot and export, and the group -------------------------------------------


@click.group(cls=StrictGroup)
def runs() -> None:
    """Look at recorded runs, report and compare them, resume them, repair them, install their calibrations."""


for command in (resume, check, repair, install):
    runs.add_command(command)


@runs.command(
    "list",
    epilog="Examples:\n\n  palpate runs list\n\n  palpate runs list --where 'batch = B7' --where 'points >= 10' --json",
)
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs.")
@WHERE
@output_options
def list_(out: Path | None, where: tuple[str, ...], as_json: bool, quiet: bool) -> None:
    """List the runs in runs/, newest first."""
    from palpate.instrument.errors import UsageError
    from palpate.procedures.lab.run_table import chosen
    from palpate.procedures.records.run import list_runs
    from palpate.procedures.showing.runs import print_runs, run_row

    output = Output(as_json, quiet)
    folder = out or store()
    if not folder.is_dir() and (out is not None or folder.exists()):
        raise UsageError(f"{folder} is no folder; name one that holds runs with --out")
    found = [run for run, _ in chosen(list_runs(folder), where)]
    output.result(lambda: {"runs": [run_row(run) for run in found]}, lambda: print_runs(found, folder, bool(where)))


@runs.command(
    epilog="Examples:\n\n  palpate runs show 20260102T030405Z-sweep-loads\n\n  palpate runs show first-day --json"
)
@RUN
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs.")
@output_options
def show(run: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Show a run: its settings, its points, its events. RUN is a folder or a name in runs/.

    Every row is checked against its hash. Runs with the same measured values have the same digest. The
    digest of signals counts settings, times and waveforms alone, and is the same by any arithmetic.
    """
    from palpate.procedures.records.run import Run, find_run, unfinished
    from palpate.procedures.showing.runs import print_run, run_object

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, out or store()))
    facts = opened.digest(), opened.signal_digest(), unfinished(opened)
    output.result(lambda: run_object(opened, *facts), lambda: print_run(opened, *facts))


@runs.command(
    epilog="Examples:\n\n  palpate runs report first-day\n\n  palpate runs report first-day second-day --out both.html"
    "\n\n  palpate runs report first-day --limits limits.toml --json"
)
@click.argument("run", nargs=-1, required=True, shell_complete=complete_run)
@option("--out", type=FILE_NAME, metavar="FILE", help="New file (default: report.html in the folder of the first run).")
@option(
    "--limits",
    type=FILE_NAME,
    metavar="FILE",
    help="Add verdicts by the limits in FILE, with the exit status of judge.",
)
@output_options
def report(run: tuple[str, ...], out: Path | None, limits: Path | None, as_json: bool, quiet: bool) -> int:
    """Write a report of a run as one page of HTML, which prints on A4. RUN is a folder or a name in runs/.

    The page needs no other file, no script and no network. Several runs of one procedure are compared: their results,
    with the uncertainty of each difference, then each run. A damaged run is shown as far as it is whole. No file is
    overwritten.
    """
    from palpate.instrument.errors import UsageError
    from palpate.procedures.engine.verdict import STATUS, read_limits
    from palpate.procedures.records.run import check_new, find_run
    from palpate.procedures.showing.run_report import PAGES, compared, report_page, reported, write_page

    output = Output(as_json, quiet)
    check_new(out, PAGES)
    asked, folders = None if limits is None else read_limits(limits), [find_run(name, store()) for name in run]
    places = [each.resolve() for each in folders]
    if twice := [name for name, place in zip(run, places, strict=True) if places.count(place) > 1]:
        raise UsageError(f"{' and '.join(twice)} are one run; name each run once")
    with reported(folders, asked) as found:
        comparisons = compared(found)
        file = write_page(report_page(found, comparisons), out, folders[0])
    if as_json:
        listed = [
            {"run": str(each.folder), "damaged": bool(each.faults), "warning": each.warning or None}
            | (each.judged.summary() if each.judged else {})
            for each in found
        ]
        gaps = [[each.summary() for each in one.results] for one in comparisons]
        points = [one.points and one.points.summary() for one in comparisons]
        simulated = any(each.run.simulated for each in found)
        output.json(
            {"report": str(file), "simulated": simulated, "runs": listed, "differences": gaps, "points": points}
        )
    warnings = [f"{each.folder}: {each.warning}" for each in found if each.warning]
    for line in (*warnings, str(file)):
        output.line(line)
    statuses = {each.judged.status for each in found if each.judged}
    return STATUS["fail"] if STATUS["fail"] in statuses else max(statuses, default=0)


@runs.command(
    epilog="Examples:\n\n  palpate runs plot first-day\n\n  palpate runs plot first-day --out first-day.svg --json"
)
@RUN
@picture_option("in runs/plots/")
@output_options
def plot(run: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Draw the figure of a run anew from its record. RUN is a folder or a name in runs/."""
    from palpate.procedures.commands.procedures import after
    from palpate.procedures.records.run import find_run
    from palpate.procedures.showing.figure import picture_file
    from palpate.procedures.showing.run_report import draw_run, reported

    output = Output(as_json, quiet)
    folder = find_run(run, store())
    file = picture_file(folder.name, out, store())
    with reported([folder]) as (found,), after(folder):
        draw_run(found, file)
    if as_json:
        head = {"run": str(found.folder), "simulated": found.run.simulated, "warning": found.warning or None}
        output.json({**head, "picture": str(file)})
    for line in (*([f"{found.folder}: {found.warning}"] if found.warning else []), str(file)):
        output.line(line)


@runs.command(
    epilog="Examples:\n\n  palpate runs export first-day\n\n  palpate runs export first-day --to parquet --out tables"
)
@RUN
@option("--to", type=click.Choice(["csv", "parquet"]), default="csv", help="Format.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the files (default: that of the run).")
@output_options
def export(run: str, to: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Export points and waveforms of a run as tables. RUN is a folder or a name in runs/."""
    from palpate.procedures.records.export import export as export_run
    from palpate.procedures.records.run import Run, find_run

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, store()))
    files = export_run(opened, to, out or opened.folder)
    if output.as_json:
        about = {"run": str(opened.folder), "simulated": opened.simulated}
        output.json({**about, "files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))


# --- The command palpate judge -------------------------------------------------------------------------


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
