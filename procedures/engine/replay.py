"""Repeats a recorded run from its bus log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import overload

from palpate.instrument.errors import PalpateError
from palpate.procedures.engine.catalogue import class_of
from palpate.procedures.engine.listeners import told_to
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S
from palpate.procedures.engine.result import Result
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.records.events import Listener


@overload
def replay(
    log: str | Path, out: str | Path | None = None, kind: None = None, *, listeners: Sequence[Listener] = ()
) -> Finished[Result]: ...
@overload
def replay(
    log: str | Path, out: str | Path | None, kind: type[Procedure[S, P, R]], *, listeners: Sequence[Listener] = ()
) -> Finished[R]: ...
def replay(
    log: str | Path,
    out: str | Path | None = None,
    kind: type[Procedure[S, P, R]] | None = None,
    *,
    listeners: Sequence[Listener] = (),
) -> Finished[R] | Finished[Result]:
    """Repeat the run of a bus log: the drivers receive the logged answers, without devices, operator or waiting.

    Args:
        log: the .pcapng file of a log, or the CAN file beside it.
        out: folder of the new run; None: a new one in the store.
        kind: class of its procedure; None: the one of that name, ours or of an installed package.
        listeners: as for `run`.

    Raises:
        UsageError: its procedure is not known, or is another one than `kind`.
        ConfigError: the log is damaged, or another version of palpate wrote it.
    """
    logged, folder = LoggedRun(Path(log)), None if out is None else Path(out)
    if kind is None:
        return _replayed(class_of(logged.run, "replay"), logged, folder, listeners)
    return _replayed(kind, logged, folder, listeners)


def _replayed(
    kind: type[Procedure[S, P, R]], logged: LoggedRun, out: Path | None, listeners: Sequence[Listener]
) -> Finished[R]:
    procedure = kind.recorded(logged.run)
    with told_to(listeners) as listener:
        done = do_again(procedure, logged, out, listener)
    done.conclude()
    return done


def do_again(procedure: Procedure[S, P, R], logged: LoggedRun, out: Path | None, listener: Listener) -> Finished[R]:
    """Carry out the procedure of a bus log, with the logged answers.

    Raises:
        ConfigError: the procedure sends a request that the log does not have at this place.
    """
    try:
        return open_and_run(procedure, Chosen.of_log(logged), out=out, listener=listener)
    except PalpateError as error:
        error.__notes__ = []  # drops notes about outputs that could not be switched off, because a log has none
        raise
