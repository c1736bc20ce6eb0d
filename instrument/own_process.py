"""What belongs to the process that began it: a forked child takes no part in it.

A child of `os.fork`, as `multiprocessing` makes it, is a copy of its parent, in the middle of the parent's open bench.
Its end is not the end of the bench. So in the child, at the fork, everything that would have been done at the end is
forgotten, and every descriptor of the bench leads to /dev/null: nothing is sent, written or unlocked there, and no
thread is waited for that a fork does not copy. What is used there nevertheless is refused.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from selectors import DefaultSelector
from typing import Any, Self, TypeVar
from weakref import WeakKeyDictionary, WeakSet

from palpate.instrument.errors import BenchError

# --- what belongs to the process -----------------------------------------------------------------------


ELSEWHERE = (
    "the bench belongs to the process that opened it, and this one is a child that was forked from it; use the bench "
    "in that process, or open one in this process"
)

T = TypeVar("T")

_own: WeakSet[Own] = WeakSet()
_open: WeakKeyDictionary[Any, Callable[[Any], Iterable[int]]] = WeakKeyDictionary()


def close_in_child(what: T, descriptors: Callable[[T], Iterable[int]]) -> None:
    """At each fork from now on, close these descriptors in the child, which finds them by `descriptors(what)`.

    Once `what` is closed there must be none, or negative ones.
    """
    _open[what] = descriptors


def watched(selector: DefaultSelector) -> list[int]:
    """Descriptors of a selector and of all that it watches."""
    return [*(key.fd for key in selector.get_map().values()), selector.fileno()]


class Own:
    """Something of the process that made it.

    Attributes:
        elsewhere: whether this process is a child that was forked after it was made.
    """

    def __init__(self) -> None:
        super().__init__()
        self.elsewhere = False
        _own.add(self)

    def check(self) -> None:
        """Raises BenchError: this process is a child that was forked after it was made."""
        if self.elsewhere:
            raise BenchError(ELSEWHERE)

    def leave_to_parent(self) -> None:
        """Called in a child just after the fork."""
        self.elsewhere = True


class Ends(Own, ExitStack):
    """An ExitStack that is empty in a forked child.

    A generator-based context on it is closed there at the fork, so it may undo only what each process has for itself.
    """

    def leave_to_parent(self) -> None:
        super().leave_to_parent()
        self.pop_all()

    def close_in_child(self, *descriptors: int) -> None:
        """As the function of this name, until this place of the stack is reached at its end."""

        def numbers() -> tuple[int, ...]:
            return descriptors

        close_in_child(numbers, lambda found: found())
        self.callback(numbers)  # does nothing, but keeps them in the list of open ones


class OwnLock(Own):
    """A lock, which its holder may take again. Taking it in a child that was forked meanwhile raises BenchError."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()

    def __enter__(self) -> Self:
        self.check()
        self._lock.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def _leave_to_parent() -> None:
    """Called in a child just after the fork."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for what, descriptors in list(_open.items()):
        with suppress(Exception):  # it may be half closed
            for descriptor in descriptors(what):
                if descriptor >= 0:
                    os.dup2(nowhere, descriptor, inheritable=False)
    os.close(nowhere)
    _open.clear()
    for each in list(_own):
        each.leave_to_parent()
    _own.clear()


os.register_at_fork(after_in_child=_leave_to_parent)


# --- what no signal breaks off -------------------------------------------------------------------------

# Python runs the handler of a signal in the main thread between any two steps of it. A handler that raises there leaves
# half done whatever is being done.


_hurries: list[Callable[[], object]] = []  # of the work that is being done
_due: list[Callable[[], object]] = []  # handlers of signals that came meanwhile


class Whole:
    """A context at whose end the handler of a signal runs that came inside; another thread than the main one gets none.

    Args:
        hurry: called at once when a signal comes.
    """

    def __init__(self, hurry: Callable[[], object]) -> None:
        self._hurry = hurry

    def __enter__(self) -> None:
        if _in_main():
            _hurries.append(self._hurry)

    def __exit__(self, *_: object) -> None:
        if _in_main():
            _hurries.pop()
            if _due and not _hurries:
                first = _due[0]
                _due.clear()
                first()


def _in_main() -> bool:
    return threading.get_ident() == threading.main_thread().ident


def when_whole(handler: Callable[[], object]) -> None:
    """Run the handler of a signal: now, or at the end of the work that is being done."""
    if not _hurries:
        handler()
        return
    _due.append(handler)
    _hurries[-1]()
