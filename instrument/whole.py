"""Work of the main thread that no signal breaks off in its middle, such as what a simulated device does for a request.

Python runs the handler of a signal in the main thread between any two steps of it. A handler that raises there leaves
half done whatever is being done.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

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
