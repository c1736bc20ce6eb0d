"""The effects a scene may call for, by name. A module is imported only when a scene names it."""

from __future__ import annotations

import importlib

from instrument.errors import UnknownName
from simulators.effects.effect import Effect

EFFECTS: dict[str, str] = {
    "charge_amplifier": "simulators.effects.charge_amplifier:ChargeAmplifier",
    "adc": "simulators.effects.adc:Adc",
    "white_noise": "simulators.effects.white_noise:WhiteNoise",
    "gain_scatter": "simulators.effects.gain_scatter:GainScatter",
    "load_cell": "simulators.effects.load_cell:LoadCell",
    "shaker_dynamics": "simulators.effects.shaker_dynamics:ShakerDynamics",
    "viscoelastic": "simulators.effects.viscoelastic:Viscoelastic",
    "hysteresis": "simulators.effects.hysteresis:Hysteresis",
    "mains_hum": "simulators.effects.mains_hum:MainsHum",
    "pink_noise": "simulators.effects.pink_noise:PinkNoise",
    "jitter": "simulators.effects.jitter:Jitter",
    "can_timing": "simulators.effects.can_timing:CanTiming",
    "serial_timing": "simulators.effects.serial_timing:SerialTiming",
}


def effect_class(name: str) -> type[Effect]:
    """The class of an effect. Raises UnknownName."""
    if name not in EFFECTS:
        raise UnknownName("effect", name, EFFECTS)
    module, class_name = EFFECTS[name].split(":")
    found: type[Effect] = getattr(importlib.import_module(module), class_name)
    return found
