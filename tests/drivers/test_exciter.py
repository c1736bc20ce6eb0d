"""The usual exciter, a generator and an amplifier: how it is switched on and off, and what it drives with."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.devices.exciter import Amplified, Exciter
from palpate.drivers.safe_end import insist
from palpate.simulators.clock import VirtualClock


class Told:
    """A device that keeps what it is told."""

    def __init__(self, who: str, told: list[Any], fails: bool = False, watched: bool = True) -> None:
        self.who, self.told, self.fails = who, told, fails
        self.contract = SimpleNamespace(has=lambda name: watched and name == "watchdog")
        self.current = 2.0

    def __getattr__(self, name: str) -> Any:
        def tell(*given: Any) -> Any:
            self.told.append((self.who, name, *given))
            if self.fails:
                raise ZeroDivisionError(f"{self.who} {name}")
            return self if name == "check" else 3.5

        return tell


QUIET = ("source", "sine", 10.0, 0.0)


@pytest.mark.parametrize(
    ("action", "told"),
    [
        ("drive", [QUIET, ("amplifier", "enable"), ("source", "output", True)]),
        ("rest", [QUIET, ("source", "output", False), ("amplifier", "disable")]),
        ("quiet", [("source", "output", False), QUIET]),
        ("halt", [("amplifier", "disable")]),  # the source is not open yet
    ],
)
def test_an_exciter_is_switched_on_and_off_at_no_amplitude(action: str, told: list[Any]) -> None:
    seen = list[Any]()
    getattr(Amplified(Told("source", seen), Told("amplifier", seen)), action)()
    assert seen == told


def test_an_exciter_is_switched_off_by_every_means_there_is_the_safest_first() -> None:
    for fails in (False, True):
        told = list[Any]()
        exciter = Amplified(Told("source", told, fails), Told("amplifier", told, fails))
        failures = insist(exciter.means(), VirtualClock())
        assert told == [("amplifier", "disable"), ("source", "output", False), QUIET]
        assert failures == (["amplifier disable", "source output", "source sine"] if fails else [])


def test_an_exciter_that_is_one_device_is_its_only_member_and_is_switched_off_by_resting() -> None:
    told = list[str]()

    class Drive(Exciter):
        sine = drive = check = effort = effort_limit = lambda self, *_: None  # type: ignore[assignment]

        def rest(self) -> None:
            told.append("rest")

    drive = Drive()
    assert (drive.members, drive.guard, drive.largest, drive.unit) == ((drive,), None, 10.0, "A")
    drive.quiet()
    assert told == []
    drive.halt()
    assert insist(drive.means(), VirtualClock()) == []
    assert told == ["rest", "rest"]
