"""Trying a mutant: its module is imported with the mistake in it, and the tests that reach the line are run.

Each try is a process of its own, forked from one that has imported the libraries, so that it begins at once. No file
is changed: the mistake is made on the way from the source to the code of the module.
"""

from __future__ import annotations

import gc
import importlib
import os
import select
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

LIBRARIES = (
    "numpy", "numpy.testing", "scipy.special", "scipy.linalg", "pydantic", "pymodbus.client", "pymodbus.server", "can",
    "canopen", "serial", "pint", "click", "rich.console", "pandas", "pyarrow", "tomli_w", "matplotlib.figure",
)  # fmt: skip
# Rewritten assertions would make the code of modules, too, by a way of its own.
PYTEST = ("-n0", "-x", "-q", "--no-header", "-p", "no:cacheprovider", "--assert=plain", "-m", "not slow")
KILLED, SURVIVED, ENDLESS = "killed", "survived", "timed out"


def import_libraries() -> None:
    """What takes long and is not to be mutated."""
    os.environ["OMP_NUM_THREADS"] = "1"  # a process of one thread may be forked
    importlib.import_module("palpate")  # asks for its kernels before numpy is loaded
    for name in [each for each in sys.modules if each.partition(".")[0] == "palpate"]:
        del sys.modules[name]  # a child imports it anew, with a mistake
    for name in LIBRARIES:
        importlib.import_module(name)
    gc.freeze()  # a child need not look through all of that


def tried(file: Path, code: Callable[[], CodeType], tests: Sequence[str], seconds: float) -> str:
    """Run tests while a module has a mistake in it, for so many seconds at most."""
    return {0: SURVIVED, None: ENDLESS}.get(in_child(lambda: _survives(file, code, tests), seconds), KILLED)


def in_child(work: Callable[[], int], seconds: float) -> int | None:
    """What `work` returns in a process of its own, as its exit status; None: it did not end in time."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.setsid()  # what the tests start ends with it
        status = 70
        try:
            status = work()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(status)
    ended = os.pidfd_open(child)  # readable once the child has ended
    try:
        in_time = bool(select.select([ended], [], [], seconds)[0])
    finally:
        os.close(ended)
    _kill(child)  # what it has left running, too
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) if in_time else None


def _kill(child: int) -> None:
    """It and all that it started; a child that has not yet begun has no group of its own."""
    for kill in (os.killpg, os.kill):
        with suppress(ProcessLookupError):
            kill(child, signal.SIGKILL)


def _survives(file: Path, code: Callable[[], CodeType], tests: Sequence[str]) -> int:
    """0 where all tests pass."""
    import pytest

    silence()
    original, place = SourceFileLoader.get_code, file.resolve()  # before a test goes into another folder

    def get_code(self: SourceFileLoader, name: str) -> CodeType | None:
        return code() if Path(self.path).resolve() == place else original(self, name)

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    return int(pytest.main([*PYTEST, *tests]))


def silence(said: Path = Path(os.devnull)) -> None:
    """What is printed from here on goes into a file, or is lost."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for descriptor in (1, 2):
        os.dup2(out, descriptor)
