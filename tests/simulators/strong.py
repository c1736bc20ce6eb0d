"""Every effect, strong enough to be seen in a second of samples; those of the buses are seen on the buses alone."""

from __future__ import annotations

from palpate.simulators.effects.adc import Adc
from palpate.simulators.effects.amplifier_clip import AmplifierClip
from palpate.simulators.effects.can_timing import CanTiming
from palpate.simulators.effects.charge_amplifier import ChargeAmplifier
from palpate.simulators.effects.crosstalk import Crosstalk
from palpate.simulators.effects.current_limit import CurrentLimit
from palpate.simulators.effects.curve_error import CurveError
from palpate.simulators.effects.end_stops import EndStops
from palpate.simulators.effects.frequency_error import FrequencyError
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.effects.glue_clamping import GlueClamping
from palpate.simulators.effects.humidity_leak import HumidityLeak
from palpate.simulators.effects.hysteresis import Hysteresis
from palpate.simulators.effects.jitter import Jitter
from palpate.simulators.effects.load_cell import LoadCell
from palpate.simulators.effects.mains_hum import MainsHum
from palpate.simulators.effects.mounting_scatter import MountingScatter
from palpate.simulators.effects.off_axis import OffAxis
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.effects.pyroelectric import Pyroelectric
from palpate.simulators.effects.serial_timing import SerialTiming
from palpate.simulators.effects.shaker_dynamics import ShakerDynamics
from palpate.simulators.effects.triboelectric import Triboelectric
from palpate.simulators.effects.viscoelastic import Viscoelastic
from palpate.simulators.effects.voltage_amplifier import VoltageAmplifier
from palpate.simulators.effects.white_noise import WhiteNoise
from palpate.simulators.physics.effect import Effect

STRONG: dict[str, Effect] = {
    "frequency_error": FrequencyError(bits=28),
    "amplifier_clip": AmplifierClip(rail="1 V"),
    "current_limit": CurrentLimit(limit="0.3 A"),
    "end_stops": EndStops(travel="1 mm"),
    "shaker_dynamics": ShakerDynamics(mass="0.3 kg"),
    "curve_error": CurveError(),
    "mounting_scatter": MountingScatter(scatter=0.1),
    "viscoelastic": Viscoelastic(material="soft_tissue"),
    "hysteresis": Hysteresis(weights=(0.3,), radii=("0.02 N",)),
    "crosstalk": Crosstalk(compliant=0.2),
    "glue_clamping": GlueClamping(),
    "off_axis": OffAxis(angle="30 deg"),
    "gain_scatter": GainScatter(strength=3.0),
    "pyroelectric": Pyroelectric(drift="0.2 K/s"),
    "triboelectric": Triboelectric(charge="1 pC"),
    "humidity_leak": HumidityLeak(over="10 s"),
    "charge_amplifier": ChargeAmplifier(time_constant="0.4 s"),
    "voltage_amplifier": VoltageAmplifier(),
    "mains_hum": MainsHum(amplitude="50 mV"),
    "pink_noise": PinkNoise(density="100 µV/√Hz"),
    "white_noise": WhiteNoise(density="100 µV/√Hz"),
    "jitter": Jitter(delay="1 ms"),
    "adc": Adc(bits=10),
    "can_timing": CanTiming(),
    "load_cell": LoadCell(zero="2.5 mV", noise="1.5 mV", decimals=3),
    "serial_timing": SerialTiming(),
}


def together() -> dict[str, Effect]:
    """As many effects as go together; of those that exclude each other, the first."""
    chosen: dict[str, Effect] = {}
    for name, effect in STRONG.items():
        if not set(effect.excludes) & set(chosen):
            chosen[name] = effect
    return chosen
