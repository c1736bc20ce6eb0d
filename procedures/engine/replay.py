"""A recorded run that is done again on the traffic of its log."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.errors import PalpateError
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S
from palpate.procedures.engine.progress import Progress
from palpate.procedures.engine.run import open_and_run
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.open import Chosen


def do_again(procedure: Procedure[S, P, R], logged: LoggedRun, out: Path | None, progress: Progress) -> Finished[R]:
    """Carry out the procedure of a log on its traffic.

    Raises:
        ConfigError: the procedure asks for what the log does not hold at that place.
    """
    try:
        return open_and_run(procedure, Chosen.of_log(logged), out=out, progress=progress)
    except PalpateError as error:
        error.__notes__ = []  # on outputs that cannot be switched off: there are none
        raise
