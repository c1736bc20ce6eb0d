"""Running a study on any executor: cells that are not stored yet are computed, in any order.

with Store(folder, asked) as store, ProcessPoolExecutor() as executor:
    run(study, evaluate, executor, store, progress, ahead=8)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait

from palpate.instrument.errors import BenchError, PalpateError
from palpate.procedures.console.progress import Progress
from palpate.procedures.records.record_file import as_json
from palpate.procedures.study.description import Study, Value
from palpate.procedures.study.store import CellOutcome, Store

Points = Iterable[Mapping[str, object]]
Evaluate = Callable[[Mapping[str, Value]], Points]


def run(study: Study, evaluate: Evaluate, executor: Executor, store: Store, progress: Progress, ahead: int) -> None:
    """Compute the missing cells. Each cell is on disk before `progress` is told of it.

    On Ctrl-C no further cell is begun; cells that are being computed are waited for and stored.

    Args:
        study: the study.
        evaluate: function from a cell's values to its points, which must be the same for the same cell. The executor
            must be able to send it to a worker. If it raises, the cell fails for that reason and the others go on.
        executor: where cells are computed.
        store: where they are stored.
        progress: is told of each cell.
        ahead: number of cells that the executor is given at a time.

    Raises:
        BenchError: the executor lost a worker.
        RecordError: a cell cannot be stored.
    """
    total = len(study)
    missing = (number for number in range(total) if number not in store.done)
    begun: set[Future[CellOutcome]] = set()
    progress(len(store.done), total, "")
    try:
        while True:
            for number in itertools.islice(missing, ahead - len(begun)):
                begun.add(executor.submit(attempt, evaluate, number, study.cell(number)))
            if not begun:
                return
            done = wait(begun, return_when=FIRST_COMPLETED).done
            outcomes = [future.result() for future in done]
            store.add(outcomes)
            begun -= done
            failed = [outcome for outcome in outcomes if outcome.reason]
            progress(len(store.done), total, f"cell {failed[-1].cell} failed" if failed else "")
    except BaseException as error:
        kept = [future for future in begun if not future.cancel()]
        store.add(future.result() for future in wait(kept).done if not _lost(future))
        stand = f"{len(store.done)} of {total} cells are kept in {store.folder}; give the command again to go on"
        if isinstance(error, Exception) and not isinstance(
            error, PalpateError
        ):  # errors of cells are in their outcomes
            raise BenchError(
                f"a worker ended without an answer ({error}), perhaps for lack of memory; {stand}"
            ) from error
        error.add_note(stand)
        raise


def attempt(evaluate: Evaluate, number: int, cell: Mapping[str, Value]) -> CellOutcome:
    """Outcome of a cell; called in whatever process computes it."""
    try:
        return CellOutcome(number, "", as_json(list(evaluate(cell))))
    except PalpateError as error:
        return CellOutcome(number, str(error), "[]")
    except Exception as error:  # a defect in one cell must not take the others with it
        return CellOutcome(number, f"{type(error).__name__}: {error}", "[]")


def _lost(future: Future[CellOutcome]) -> bool:
    try:
        return future.exception() is not None
    except CancelledError:
        return True
