"""The effects a scene may call for, by name. A module is imported only when a scene names it.

A package that is installed beside this one adds an effect by an entry point:

[project.entry-points."palpate.effects"]
cable_sag = "cable_sag:CableSag"
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import TypeVar, get_args

from palpate.instrument.additions import addition, additions, find, unusable
from palpate.instrument.errors import ConfigError
from palpate.simulators.physics.effect import PLACES, Effect, Kind

# These are in the order of the signal chain.
EFFECTS: dict[str, str] = {
    "frequency_error": "palpate.simulators.effects.frequency_error:FrequencyError",
    "amplifier_clip": "palpate.simulators.effects.amplifier_clip:AmplifierClip",
    "current_limit": "palpate.simulators.effects.current_limit:CurrentLimit",
    "end_stops": "palpate.simulators.effects.end_stops:EndStops",
    "shaker_dynamics": "palpate.simulators.effects.shaker_dynamics:ShakerDynamics",
    "curve_error": "palpate.simulators.effects.curve_error:CurveError",
    "mounting_scatter": "palpate.simulators.effects.mounting_scatter:MountingScatter",
    "viscoelastic": "palpate.simulators.effects.viscoelastic:Viscoelastic",
    "hysteresis": "palpate.simulators.effects.hysteresis:Hysteresis",
    "crosstalk": "palpate.simulators.effects.crosstalk:Crosstalk",
    "glue_clamping": "palpate.simulators.effects.glue_clamping:GlueClamping",
    "off_axis": "palpate.simulators.effects.off_axis:OffAxis",
    "gain_scatter": "palpate.simulators.effects.gain_scatter:GainScatter",
    "pyroelectric": "palpate.simulators.effects.pyroelectric:Pyroelectric",
    "triboelectric": "palpate.simulators.effects.triboelectric:Triboelectric",
    "humidity_leak": "palpate.simulators.effects.humidity_leak:HumidityLeak",
    "charge_amplifier": "palpate.simulators.effects.charge_amplifier:ChargeAmplifier",
    "voltage_amplifier": "palpate.simulators.effects.voltage_amplifier:VoltageAmplifier",
    "mains_hum": "palpate.simulators.effects.mains_hum:MainsHum",
    "pink_noise": "palpate.simulators.effects.pink_noise:PinkNoise",
    "white_noise": "palpate.simulators.effects.white_noise:WhiteNoise",
    "jitter": "palpate.simulators.effects.jitter:Jitter",
    "adc": "palpate.simulators.effects.adc:Adc",
    "can_timing": "palpate.simulators.effects.can_timing:CanTiming",
    "load_cell": "palpate.simulators.effects.load_cell:LoadCell",
    "serial_timing": "palpate.simulators.effects.serial_timing:SerialTiming",
}


GROUP, WHAT = "palpate.effects", "effect"
T = TypeVar("T")


def effect_names() -> list[str]:
    """Names of all effects: palpate's own in the order of the chain, then those of installed packages by name."""
    return [*EFFECTS, *(name for name in additions(GROUP) if name not in EFFECTS)]


def in_order(effects: Mapping[str, T]) -> dict[str, T]:
    """A mapping by effect names, sorted in the order of `effect_names`."""
    return {name: effects[name] for name in (*EFFECTS, *sorted(effects.keys() - EFFECTS.keys())) if name in effects}


def origin(name: str) -> str:
    """The text ", from PACKAGE VERSION" for an effect of an installed package; empty for palpate's own effects."""
    entry = addition(GROUP, WHAT, name) if name not in EFFECTS else None
    return f", from {entry.origin}" if entry else ""


def effect_class(name: str) -> type[Effect]:
    """The class of an effect by its name.

    Raises:
        UnknownName: there is no effect of that name.
        ConfigError: the package that adds it cannot be used, or its class has another name.
    """
    if name not in EFFECTS:
        return _added(name)
    module, class_name = EFFECTS[name].split(":")
    found: type[Effect] = getattr(importlib.import_module(module), class_name)
    if found.name != name:
        raise ConfigError(f"effect {name!r}: its class {class_name} is named after {found.name!r}; rename one of them")
    return found


def _added(name: str) -> type[Effect]:
    """The class of an installed package's effect, after all checks that need no scene."""
    entry, found = find(GROUP, WHAT, name, EFFECTS)
    if not (isinstance(found, type) and issubclass(found, Effect) and found.name == name):
        raise unusable(entry, WHAT, f"is no Effect whose class is named after {name!r}")
    if not issubclass(found, PLACES):
        raise unusable(entry, WHAT, f"inherits from none of {', '.join(place.__name__ for place in PLACES)}")
    if getattr(found, "kind", None) not in get_args(Kind) or not hasattr(found, "cancels_in_ratio"):
        raise unusable(entry, WHAT, f"does not say its kind ({', '.join(get_args(Kind))}) and cancels_in_ratio")
    try:
        hash(found.model_validate({}))
    except Exception as error:  # its validators can raise anything
        raise unusable(entry, WHAT, f"cannot be made with the defaults of its parameters: {error}") from error
    return found
