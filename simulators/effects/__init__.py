"""The effects a scene may call for, by name. A module is imported only when a scene names it."""

from __future__ import annotations

import importlib

from palpate.instrument.errors import ConfigError, UnknownName
from palpate.simulators.physics.effect import Effect

# In the order of the chain.
EFFECTS: dict[str, str] = {
    "frequency_error": "palpate.simulators.effects.frequency_error:FrequencyError",
    "amplifier_clip": "palpate.simulators.effects.amplifier_clip:AmplifierClip",
    "current_limit": "palpate.simulators.effects.current_limit:CurrentLimit",
    "end_stops": "palpate.simulators.effects.end_stops:EndStops",
    "shaker_dynamics": "palpate.simulators.effects.shaker_dynamics:ShakerDynamics",
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


def effect_class(name: str) -> type[Effect]:
    """The class of an effect. Raises UnknownName, and ConfigError: the class is not named after the effect."""
    if name not in EFFECTS:
        raise UnknownName("effect", name, EFFECTS)
    module, class_name = EFFECTS[name].split(":")
    found: type[Effect] = getattr(importlib.import_module(module), class_name)
    if found.name != name:
        raise ConfigError(f"effect {name!r}: its class {class_name} is named after {found.name!r}; rename one of them")
    return found
