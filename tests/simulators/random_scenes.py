"""Scenes at random: each effect with parameters from its whole allowed range, and the loads that are asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from palpate.instrument.quantity import Unit
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning.plan import RATE, Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import RigParameters, Scene

ELSEWHERE = ("can_timing", "load_cell", "serial_timing")  # the films do not pass them
LIMITS = ("amplifier_clip", "current_limit", "end_stops")
USUAL = 0.5  # of all numbers are within two decades of the default, the others anywhere
DECADES = 4.0  # on each side of the default, where the range has no end
MOST_BESIDE = 5
DESIGNS = ("single",) * 6 + ("single_round", "common_base", "different_base")
# Of each twenty numbers these are arrays; by their number, so that all others are the scenes that they always were.
ARRAYS = {6: "array", 18: "array_16"}
# Effects on the share of the force come in numbers of their own likewise.
SHARES, WITH_SHARES = ("curve_error", "mounting_scatter"), 12
MEASURED = ("single", "common_base", "different_base")


@dataclass(frozen=True)
class Drawn:
    """One scene without an effect and with it, and what is asked of both."""

    number: int
    name: str
    without: Scene
    with_it: Scene
    question: Question


def drawn(number: int) -> Drawn:
    """The scene of a number: always the same."""
    chance = np.random.default_rng([15, number])
    while True:
        shares = number % 20 == WITH_SHARES
        names = [name for name in EFFECTS if name not in ELSEWHERE and (shares or name not in SHARES)]
        name = str(chance.choice(names))
        beside = [str(other) for other in chance.permutation(names)[: chance.integers(MOST_BESIDE + 1)]]
        chosen = {name}
        for other in beside:
            # Beside a limit that acts no bound is given: few of them.
            if other in LIMITS and chance.random() < 0.7:
                continue
            if not any(other in effect_class(each).excludes for each in chosen):
                chosen.add(other)
        effects = {each: effect_at_random(each, chance) for each in EFFECTS if each in chosen}
        scene = _scene(chance, effects, ARRAYS.get(number % 20))
        without = replace(scene, effects={each: effect for each, effect in effects.items() if each != name})
        return Drawn(number, name, without, scene, _question(chance, scene.design))


def _scene(chance: np.random.Generator, effects: Mapping[str, Effect], array: str | None) -> Scene:
    design = get_design(array or str(chance.choice(DESIGNS)))
    thesis = read_scene("thesis_single")
    rig = RigParameters()
    if chance.random() < 0.3:
        rig = RigParameters(
            force_constant=f"{_near(chance, 4.0)} N/A",
            coil_resistance=f"{_near(chance, 3.5)} ohm",
            suspension_stiffness=f"{_near(chance, 1000.0)} N/m",
        )
    model = "experiment" if design.name in MEASURED else "column"
    return replace(thesis, design=design, model=model, rig=rig, effects=effects, seed=int(chance.integers(2**31)))


def _near(chance: np.random.Generator, value: float) -> float:
    return float(value * 10 ** chance.uniform(-0.5, 0.5))


def _question(chance: np.random.Generator, design: Design) -> Question:
    """Of round numbers, as people ask, and of any."""
    load = float(10 ** chance.uniform(-0.5, 1.0))
    frequency = float(chance.choice([2.0, 5.0, 10.0, 20.0]))
    dwell = float(chance.choice([0.2, 0.5, 1.0, 2.0]))
    if chance.random() < 0.5:
        frequency = float(10 ** chance.uniform(-0.3, 1.8))
        dwell = float(10 ** chance.uniform(-1.0, 0.3))
    return Question(str(chance.choice(sorted(SAMPLES))), load, frequency, max(dwell, 0.6 / frequency, 20 / RATE))


# --- parameters ----------------------------------------------------------------------------------------


def effect_at_random(name: str, chance: np.random.Generator) -> Effect:
    """An effect with each parameter from its whole range, near its default, or as it comes."""
    kind = effect_class(name)
    while True:
        values = {}
        for field, info in kind.model_fields.items():
            if (name, field) in _SPECIAL:
                value = _SPECIAL[name, field](chance)
                if value is not None:
                    values[field] = value
            elif chance.random() < 0.8:
                values[field] = _value(info, chance)
        values |= _JOINT[name](chance) if name in _JOINT else {}
        try:
            return kind.model_validate(values)
        except ValidationError:
            continue  # numbers that do not go together


def _value(info: FieldInfo, chance: np.random.Generator) -> Any:
    if get_origin(info.annotation) is Literal:
        options = get_args(info.annotation)
        return options[chance.integers(len(options))]
    ends: dict[str, float] = {}
    unit = None
    for each in info.metadata:
        unit = each.unit if isinstance(each, Unit) else unit
        ends |= {end: getattr(each, end) for end in ("ge", "gt", "le", "lt") if getattr(each, end, None) is not None}
    low, high = ends.get("ge", ends.get("gt", -math.inf)), ends.get("le", ends.get("lt", math.inf))
    if info.annotation is int:
        return int(chance.integers(int(low), int(high) + 1))
    value = _number(float(info.default), low, high, chance)
    return f"{value!r} {unit}" if unit else value


def _number(default: float, low: float, high: float, chance: np.random.Generator) -> float:
    """Within the range; by its logarithm where that has a meaning."""
    if low < 0:
        size = _number(abs(default) or 0.1 * high, 0.0, high, chance)
        return max(low, size if chance.random() < 0.5 else -size)
    scale = default or min(high, 1.0)
    least = max(low, scale * 10**-DECADES) or scale * 10**-DECADES
    most = min(high, scale * 10**DECADES)
    least = low if low > 0 else least
    most = high if math.isfinite(high) else most
    if chance.random() < USUAL:
        least, most = max(least, scale / 100), min(most, 100 * scale)
    value = float(np.exp(chance.uniform(math.log(least), math.log(most))))
    return min(max(value, least), math.nextafter(most, 0.0))


def _weights(chance: np.random.Generator) -> dict[str, Any]:
    count = int(chance.integers(1, 4))
    weights = chance.uniform(-1, 1, count) * 10 ** chance.uniform(-3, 0)
    radii = 10 ** chance.uniform(-4, 1, count)
    if chance.random() < 0.1:
        radii = 10 ** chance.uniform(-6, 6, count)
    return {"weights": tuple(map(float, weights)), "radii": tuple(f"{r!r} N" for r in map(float, radii))}


def _prony(chance: np.random.Generator) -> dict[str, Any]:
    if chance.random() < 0.4:
        return {"material": str(chance.choice(["rubber", "soft_tissue"]))}
    count = int(chance.integers(1, 4))
    shares = chance.dirichlet(np.ones(count + 1))[:count] * chance.uniform(0, 1)
    tau = 10 ** chance.uniform(-6, 6, count) if chance.random() < 0.5 else 10 ** chance.uniform(-3, 2, count)
    return {"g": tuple(map(float, shares)), "tau": tuple(f"{t!r} s" for t in map(float, tau))}


def _films(chance: np.random.Generator) -> tuple[str, ...] | None:
    return (("rigid",), ("total",), ("rigid", "total"))[chance.integers(3)]


def _nothing(chance: np.random.Generator) -> None:
    return None


_SPECIAL: dict[tuple[str, str], Callable[[np.random.Generator], Any]] = {
    ("glue_clamping", "films"): _films,
    ("gain_scatter", "redrawn"): _nothing,  # when gains are drawn anew changes no bound
    ("hysteresis", "weights"): _nothing,
    ("hysteresis", "radii"): _nothing,
    ("viscoelastic", "material"): _nothing,
    ("viscoelastic", "g"): _nothing,
    ("viscoelastic", "tau"): _nothing,
}
_JOINT = {"hysteresis": _weights, "viscoelastic": _prony}
