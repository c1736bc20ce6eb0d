"""The effects a scene may call for, by name. A module is imported only when a scene names it."""

from __future__ import annotations

import importlib

from instrument.errors import UnknownName
from simulators.effects.effect import Effect

# In the order of the chain.
EFFECTS: dict[str, str] = {
    "frequency_error": "simulators.effects.frequency_error:FrequencyError",
    "amplifier_clip": "simulators.effects.amplifier_clip:AmplifierClip",
    "current_limit": "simulators.effects.current_limit:CurrentLimit",
    "end_stops": "simulators.effects.end_stops:EndStops",
    "shaker_dynamics": "simulators.effects.shaker_dynamics:ShakerDynamics",
    "viscoelastic": "simulators.effects.viscoelastic:Viscoelastic",
    "hysteresis": "simulators.effects.hysteresis:Hysteresis",
    "crosstalk": "simulators.effects.crosstalk:Crosstalk",
    "glue_clamping": "simulators.effects.glue_clamping:GlueClamping",
    "off_axis": "simulators.effects.off_axis:OffAxis",
    "gain_scatter": "simulators.effects.gain_scatter:GainScatter",
    "pyroelectric": "simulators.effects.pyroelectric:Pyroelectric",
    "triboelectric": "simulators.effects.triboelectric:Triboelectric",
    "humidity_leak": "simulators.effects.humidity_leak:HumidityLeak",
    "charge_amplifier": "simulators.effects.charge_amplifier:ChargeAmplifier",
    "voltage_amplifier": "simulators.effects.voltage_amplifier:VoltageAmplifier",
    "mains_hum": "simulators.effects.mains_hum:MainsHum",
    "pink_noise": "simulators.effects.pink_noise:PinkNoise",
    "white_noise": "simulators.effects.white_noise:WhiteNoise",
    "jitter": "simulators.effects.jitter:Jitter",
    "adc": "simulators.effects.adc:Adc",
    "can_timing": "simulators.effects.can_timing:CanTiming",
    "load_cell": "simulators.effects.load_cell:LoadCell",
    "serial_timing": "simulators.effects.serial_timing:SerialTiming",
}


def effect_class(name: str) -> type[Effect]:
    """The class of an effect. Raises UnknownName."""
    if name not in EFFECTS:
        raise UnknownName("effect", name, EFFECTS)
    module, class_name = EFFECTS[name].split(":")
    found: type[Effect] = getattr(importlib.import_module(module), class_name)
    return found
