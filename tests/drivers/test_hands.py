"""What devices of a bench can do is asked of them, everything else of a person."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.bench import Hands
from palpate.drivers.roles import Chamber, ProbeStage, SampleChanger
from palpate.instrument.sensor.sample import SAMPLES

ROLES = {SampleChanger: "changer", Chamber: "chamber", ProbeStage: "stage"}


class Recorder:
    """A device or a person; keeps what it is asked for."""

    def __init__(self, who: str, done: list[tuple[object, ...]]) -> None:
        self.who, self.done = who, done

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *given: self.done.append((self.who, name, *given))


@pytest.mark.parametrize("devices", [(), ("changer",), ("chamber",), ("stage",), ("changer", "chamber", "stage")])
def test_each_device_is_asked_for_what_it_can_do_and_the_person_for_the_rest(devices: tuple[str, ...]) -> None:
    done = list[tuple[object, ...]]()
    has = {name: Recorder(name, done) if name in devices else None for name in ROLES.values()}
    bench: Any = SimpleNamespace(maybe=lambda role: has[ROLES[role]])
    hands = Hands(Recorder("person", done), bench)
    hands.mount(SAMPLES["2"])
    hands.lay_on_support(SAMPLES["3"])
    hands.place_probe(1e-3, 2e-3)
    hands.press_tooth(1)
    hands.place_weight(0.3)
    hands.turn_load_cell(120.0)
    hands.set_temperature(295.0)
    leaves = [("changer", "leave")] if has["changer"] else []
    assert done == [
        ("changer", "mount", "2") if has["changer"] else ("person", "mount", SAMPLES["2"]),
        *leaves,
        ("person", "lay_on_support", SAMPLES["3"]),
        ("stage" if has["stage"] else "person", "place_probe", 1e-3, 2e-3),
        *leaves,
        ("person", "press_tooth", 1),
        ("person", "place_weight", 0.3),
        ("person", "turn_load_cell", 120.0),
        ("chamber", "warm", 295.0) if has["chamber"] else ("person", "set_temperature", 295.0),
    ]
