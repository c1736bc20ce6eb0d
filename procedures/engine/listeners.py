"""Who hears what happens in a run: listeners of one's own, each in a thread of its own, and the bar of a terminal."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from palpate.procedures.console.terminal import Progress, Shown, say
from palpate.procedures.lab.store import store
from palpate.procedures.records.events import Event, Listener, followed, unheard
from palpate.procedures.records.run import find_run

WAITING = 10_000  # events that a listener may not have taken yet
PATIENCE = 2.0  # s that a listener may take for one event once the run has ended
LOOK = 0.05  # s between two looks of a listener for events: the run stands still a moment whenever a thread wakes


def watch(run: str | Path) -> Iterator[Event]:
    """All events of a run, also of one that another process carries out, from its beginning; see `Event`.

    Those that the record holds come at once, then each within a tenth of a second. It ends once the run has ended, or
    with the status "killed" once the process that wrote it is gone. The run takes no notice.

    Args:
        run: its folder, or its name in the store.

    Raises:
        UnknownName: there is no such run. RecordError: it is damaged.
    """
    return followed(find_run(str(run), store()))


@dataclass(frozen=True, slots=True)
class InStep:
    """A listener that is called in the thread of the run, which waits for it; what it raises ends the run."""

    listener: Listener

    def __call__(self, event: Event) -> None:
        self.listener(event)


@dataclass(frozen=True, slots=True)
class Traced(InStep):
    """Such a listener that also hears of traces."""


def steps(progress: Progress) -> InStep:
    """A listener that calls a function with the number of finished points, of all points, and what is done now."""
    number, points, what, by_plan = 0, 0, "", False

    def listen(event: Event) -> None:
        nonlocal number, points, what, by_plan
        match event.kind:
            case "begun":
                by_plan = event.data["scene"] is None  # else the bench's time is not that of whoever waits
            case "step":
                number, points, what = (event.data[name] for name in ("number", "points", "what"))
                progress(number, points, what)
            case "point" if what:
                progress(number + 1, points, what)
            case "promise" if by_plan and isinstance(progress, Shown):
                progress.promised(event.data["seconds"])

    return InStep(listen)


@contextmanager
def told_to(listeners: Sequence[Listener]) -> Iterator[Listener]:
    """A listener that hands each event to all of these; at the end of the block each has taken what was told it.

    The run waits for none of them. One that raises, that has left too many events untaken, or that is still busy with
    one some time after the run ended is dropped, which is told on stderr.
    """
    threads = [_Thread(each) for each in listeners if not isinstance(each, InStep)]
    heard: list[InStep | _Thread] = [*(each for each in listeners if isinstance(each, InStep)), *threads]
    traced = [each for each in listeners if isinstance(each, Traced)]
    if not heard:
        yield unheard
        return

    def tell(event: Event) -> None:
        for each in traced if event.kind == "trace" else heard:
            each(event)

    try:
        yield tell
    finally:
        for thread in threads:
            thread.end()


class _Thread:
    """A listener with its thread, and the events that it has not taken yet."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._events: deque[Event] = deque()
        self._ending = threading.Event()
        self._dropped = ""
        self._busy, self._since = False, monotonic()  # with an event, and when it began or ended one
        self._thread = threading.Thread(target=self._listen, name=f"listener {self._name}", daemon=True)
        self._thread.start()

    def __call__(self, event: Event) -> None:
        if self._dropped:
            return
        if len(self._events) == WAITING:
            self._drop(f"it left {WAITING:,} events untaken")
        else:
            self._events.append(event)

    def end(self) -> None:
        """Wait until it has taken all events, but no longer than PATIENCE for one of them."""
        self._ending.set()
        ended = monotonic()
        while self._thread.is_alive() and not self._dropped:
            left = (self._since if self._busy else max(self._since, ended)) + PATIENCE - monotonic()
            if left <= 0:
                self._drop(f"it was busy with one event for more than {PATIENCE:g} s when the run had ended")
            else:
                self._thread.join(left)

    def _listen(self) -> None:
        ending = False
        while not ending:
            ending = self._ending.wait(LOOK)
            while self._events:
                if self._dropped:
                    return
                self._since, self._busy = monotonic(), True
                try:
                    self._listener(self._events.popleft())
                except BaseException as error:
                    self._drop(f"it failed: {type(error).__name__}: {error}")
                    return
                self._since, self._busy = monotonic(), False

    def _drop(self, why: str) -> None:
        self._dropped = why
        say(f"palpate: note: the listener {self._name} hears no more of this run: {why}", err=True)

    @property
    def _name(self) -> str:
        return getattr(self._listener, "__qualname__", type(self._listener).__qualname__)
