"""What a scene does not call for is never imported, built or called."""

from __future__ import annotations

import sys

import pytest

from palpate.simulators import effects
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from tests.simulators.measured import volts


def poison(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Import, construction and any use of an effect raise."""
    module, class_name = EFFECTS[name].split(":")
    found = effect_class(name)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError(f"effect {name!r} was not called for")

    monkeypatch.setattr(found, "__init__", refuse)
    monkeypatch.setattr(found, "model_validate", refuse)
    monkeypatch.delattr(sys.modules[module], class_name)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(EFFECTS, name, f"{module}:{class_name}")


@pytest.mark.parametrize("name", ["ideal", "thesis_single", "everything"])
def test_a_scene_gives_the_same_bytes_where_every_effect_that_it_does_not_name_is_poison(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = volts(read_scene(name), Question(dwell=0.2)).tobytes()
    unused = [effect for effect in EFFECTS if effect not in read_scene(name).file.effects]
    for effect in unused:
        poison(monkeypatch, effect)
    assert volts(read_scene(name), Question(dwell=0.2)).tobytes() == clean


def test_the_poison_works(monkeypatch: pytest.MonkeyPatch) -> None:
    found: type[Effect] = effect_class("adc")
    poison(monkeypatch, "adc")
    with pytest.raises(ImportError):
        effects.effect_class("adc")
    with pytest.raises(AssertionError, match="'adc' was not called for"):
        found()
