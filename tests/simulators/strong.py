"""Every effect, strong enough to be seen in a second of samples; those of the buses are seen on the buses alone."""

from __future__ import annotations

from simulators.effects.adc import Adc
from simulators.effects.can_timing import CanTiming
from simulators.effects.charge_amplifier import ChargeAmplifier
from simulators.effects.effect import Effect
from simulators.effects.gain_scatter import GainScatter
from simulators.effects.hysteresis import Hysteresis
from simulators.effects.jitter import Jitter
from simulators.effects.load_cell import LoadCell
from simulators.effects.mains_hum import MainsHum
from simulators.effects.pink_noise import PinkNoise
from simulators.effects.serial_timing import SerialTiming
from simulators.effects.shaker_dynamics import ShakerDynamics
from simulators.effects.viscoelastic import Viscoelastic
from simulators.effects.white_noise import WhiteNoise

STRONG: dict[str, Effect] = {
    "charge_amplifier": ChargeAmplifier(time_constant="0.4 s"),
    "adc": Adc(bits=10),
    "white_noise": WhiteNoise(density="100 µV/√Hz"),
    "gain_scatter": GainScatter(strength=3.0),
    "load_cell": LoadCell(zero="2.5 mV", noise="1.5 mV", decimals=3),
    "shaker_dynamics": ShakerDynamics(mass=0.3),
    "viscoelastic": Viscoelastic(g=(0.5,)),
    "hysteresis": Hysteresis(weights=(0.3,), radii=("0.02 N",)),
    "mains_hum": MainsHum(amplitude="50 mV"),
    "pink_noise": PinkNoise(density="100 µV/√Hz"),
    "jitter": Jitter(delay="1 ms"),
    "can_timing": CanTiming(),
    "serial_timing": SerialTiming(),
}


def together() -> dict[str, Effect]:
    """As many of them as go together: the first of those that exclude each other."""
    chosen: dict[str, Effect] = {}
    for name, effect in STRONG.items():
        if not set(effect.excludes) & set(chosen):
            chosen[name] = effect
    return chosen
