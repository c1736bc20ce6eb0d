"""The person at the console of a real bench, who is told what to do by hand, and confirms it by typing a word."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Literal, get_args

from palpate.instrument.errors import BenchError, UsageError
from palpate.instrument.own_process import Ends
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.console.terminal import say, without_bar
from palpate.procedures.steps.pause import NOBODY, Pause

# --- Pauses a run at a terminal: the key `p` pauses it, and `p` again goes on --------------------------

KEY = b"p"


class Keyboard:
    """A `palpate.procedures.steps.pause.Pause` by keys; the terminal passes each key on at once.

    A terminal may close while the run goes on (nohup); from then on no key is pressed.
    """

    def __init__(self, terminal: int) -> None:
        self._terminal = terminal

    def asked(self) -> bool:
        """Whether `p` was pressed since the last call."""
        keys = b""
        while select.select([self._terminal], [], [], 0)[0]:
            read = self._read(1024)
            if not read:
                break
            keys += read
        return KEY in keys.lower()

    def wait(self) -> None:
        say("paused, outputs are off; press p to go on, Ctrl-C to stop", err=True)
        while (key := self._read(1)).lower() != KEY:
            if not key:
                return

    def _read(self, most: int) -> bytes:
        try:
            return os.read(self._terminal, most)
        except OSError:
            return b""


@contextmanager
def keyboard() -> Iterator[Pause]:
    """The keyboard if standard input is a terminal; else `NOBODY`, who never pauses."""
    if sys.stdin is None or not sys.stdin.isatty():  # None: a service manager has closed standard input
        yield NOBODY
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    with Ends() as ends:
        ends.callback(_restore, terminal, before)
        tty.setcbreak(terminal)
        yield Keyboard(terminal)


def _restore(terminal: int, before: list[Any]) -> None:
    with suppress(termios.error):  # the terminal has been closed
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


# --- the person at the console -------------------------------------------------------------------------

Ask = Callable[[str, str], None]
"""Gets a task done that a sentence describes; the second argument is the word that confirms it."""

Mounting = Literal["simulated", "sample changer", "confirmed", "assumed"]
"""How a run knows what was mounted or placed, from certain to uncertain; the record, the report and JSON name it."""

ASSUME = "--assume-mounted"


class ConsoleOperator:
    """An `Operator` at the console, who confirms each task by typing what was mounted or placed."""

    def __init__(self, ask: Ask | None = None) -> None:
        self._ask = ask or confirm

    def mount(self, sample: Sample) -> None:
        self._ask(f"Mount sample {_described(sample)}", sample.name)

    def mount_anew(self, sample: Sample) -> None:
        self._ask(f"Take sample {sample.name} off, if it lies there, and mount it anew", sample.name)

    def lay_on_support(self, sample: Sample | None) -> None:
        laid, word = ("bare", "bare") if sample is None else (f"with sample {_described(sample)} on it", sample.name)
        self._ask(f"Put the rigid support in the sensor's place, {laid}", word)

    def place_probe(self, x: float, y: float) -> None:
        place = f"{show(x, 'm')} along and {show(y, 'm')} across from the sensor's corner"
        self._ask(f"Set the point probe {place}", show(x, "m"))

    def press_tooth(self, tooth: int) -> None:
        self._ask(f"Stand the pin on tooth {tooth + 1} alone, under the probe", f"{tooth + 1}")

    def place_weight(self, mass: float) -> None:
        grams = f"{1e3 * mass:.6g}"
        self._ask(f"Place {grams} gf in total on the load cell" if mass else "Take all weights off", grams)

    def turn_load_cell(self, degrees: float) -> None:
        self._ask(f"Turn the load cell about its axis to {degrees:g} degrees", f"{degrees:g}")

    def set_temperature(self, kelvin: float) -> None:
        self._ask(f"Make the surroundings of the sensor {kelvin:g} K warmer than at the start", f"{kelvin:g}")

    def confirm_device(self, what: str, label: str) -> None:
        if self._ask is confirm and not at_terminal():
            raise BenchError(
                f"{what} tells nothing by which it is known, and nobody can confirm that it is {label}, because "
                "standard input is no terminal; look at its label, then write confirmed = true in its section of the "
                f"bench file, or run palpate in a terminal, or give {ASSUME}"
            )
        self._ask(f"Look that {what} is the device labelled {label}", label)


def _described(sample: Sample) -> str:
    return f"{sample.name} ({sample.material}, {show(sample.thickness, 'm')})"


def at_terminal() -> bool:
    """Whether somebody can answer at the console."""
    return sys.stdin is not None and sys.stdin.isatty()  # None: a service manager has closed standard input


def check_somebody(manual_work: str, changer: bool, assume: bool) -> Mounting:
    """Refuse a run with work by hand that nobody could confirm; returns how the run will know what is mounted.

    Args:
        manual_work: what a person does in addition to mounting samples, as "places the weights"; empty: nothing.
        changer: whether the bench has a sample changer.
        assume: whether --assume-mounted was given.

    Raises:
        UsageError: standard input is no terminal, and --assume-mounted was not given.
    """
    if changer and not manual_work:
        return "sample changer"
    if assume:
        return "assumed"
    if not at_terminal():
        raise UsageError(
            f"a person {manual_work or 'mounts the samples'} on this bench and has to confirm it, but standard input "
            f"is no terminal; run palpate in a terminal, or give {ASSUME} if something else makes sure of it, which "
            "the record then says"
        )
    return "confirmed"


def weaker(before: object, now: Mounting) -> Mounting:
    """How a resumed run knows what was mounted: as in its less certain part, where an unknown old part is "assumed"."""
    if now == "simulated":
        return now
    order: tuple[Mounting, ...] = get_args(Mounting)
    then = next((each for each in order if each == before), "assumed")
    return order[max(order.index(now), order.index(then))]


def confirm(what: str, word: str) -> None:
    """Ask until `word` is typed.

    This is not click's prompt, because that does not tell Ctrl-C from the end of the input.

    Raises BenchError: the input has ended.
    """
    with without_bar(), _by_lines():
        say(f"{what}; then type {word} and press Enter", err=True)
        while (typed := _typed(what)) != _plain(word):
            say(f"{typed!r} is not {word!r}: check the bench, then type {word}; Ctrl-C stops", err=True)


def answer(question: str) -> str:
    """What a person at the terminal types after a question. Raises BenchError: the input has ended."""
    with without_bar(), _by_lines():
        say(question, err=True)
        return _line(question).strip()


def assume(what: str, word: str) -> None:
    """Say what is assumed without a confirmation."""
    say(f"assumed, as {ASSUME} asks: {what}", err=True)


def _typed(what: str) -> str:
    return _plain(_line(what))


def _line(what: str) -> str:
    line = sys.stdin.readline() if at_terminal() else ""
    if not line:
        raise BenchError(f"nobody answers at the console ({what.lower()}); run palpate in a terminal")
    return line


def _plain(text: str) -> str:
    return "".join(text.split())


@contextmanager
def _by_lines() -> Iterator[None]:
    """Read whole lines from the terminal and echo them, which `keys` has switched off; earlier input is dropped."""
    try:
        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
    except (AttributeError, OSError, termios.error):  # no terminal
        yield
        return
    lines = [*before[:3], before[3] | termios.ICANON | termios.ECHO, *before[4:]]
    termios.tcsetattr(terminal, termios.TCSAFLUSH, lines)
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal has been closed
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
