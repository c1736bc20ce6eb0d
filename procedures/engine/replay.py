"""Repeats a recorded run from its bus log."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.errors import PalpateError
from palpate.procedures.console.progress import Progress, silent
from palpate.procedures.engine.known import class_of
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, Result, S
from palpate.procedures.engine.run import concluded, open_and_run
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.open import Chosen


def replay(log: str | Path, out: str | Path | None = None, *, progress: Progress = silent) -> Finished[Result]:
    """Repeat the run of a bus log: the drivers receive the logged answers, without devices, operator or waiting.

    Args:
        log: the .pcapng file of a log, or the CAN file beside it.
        out: folder of the new run; None: a new one in the store.

    Raises:
        UsageError: its procedure is not known.
        ConfigError: the log is damaged, or another version of palpate wrote it.
    """
    logged = LoggedRun(Path(log))
    procedure = class_of(logged.run, "replayed").recorded(logged.run)
    return concluded(procedure, do_again(procedure, logged, None if out is None else Path(out), progress))


def do_again(procedure: Procedure[S, P, R], logged: LoggedRun, out: Path | None, progress: Progress) -> Finished[R]:
    """Carry out the procedure of a bus log, with the logged answers.

    Raises:
        ConfigError: the procedure sends a request that the log does not have at this place.
    """
    try:
        return open_and_run(procedure, Chosen.of_log(logged), out=out, progress=progress)
    except PalpateError as error:
        error.__notes__ = []  # drops notes about outputs that could not be switched off, because a log has none
        raise
