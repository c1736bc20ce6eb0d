"""Executors that compute the cells of a study: processes on this machine, or a dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager

from palpate.instrument.additions import library
from palpate.procedures.console.terminal import say


@contextmanager
def executor_of(workers: int | None, dask: str | None) -> Iterator[tuple[Executor, int]]:
    """An executor, and the number of its workers.

    Args:
        workers: number of processes; None: one for each core. Where there can be none, a thread computes the cells.
        dask: address of a dask scheduler to use instead of processes; None: processes.

    Raises:
        UsageError: dask.distributed is not installed.
        OSError: no scheduler answers.
    """
    if dask is not None:
        with library("distributed", "dask").Client(dask) as client:
            yield client.get_executor(), max(1, sum(client.ncores().values()))
        return
    os.environ["OMP_NUM_THREADS"] = "1"  # one core for each worker, and a fixed order of summation
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["palpate.procedures.virtual.study_cell"])  # imported once for all workers
    executor: Executor
    try:
        executor = ProcessPoolExecutor(count, context, _begin_worker)
    except (OSError, ImportError, NotImplementedError) as error:  # without semaphores
        say(
            f"palpate: note: cells are computed one by one, because processes cannot work together here ({error}); "
            "make /dev/shm writable: mount -t tmpfs tmpfs /dev/shm",
            err=True,
        )
        executor, count = ThreadPoolExecutor(1), 1
    with executor:
        yield executor, count


def _begin_worker() -> None:
    """Ignore Ctrl-C, which the parent process handles; and end with the parent, which may be killed without notice."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
