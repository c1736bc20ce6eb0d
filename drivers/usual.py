"""The usual devices of a bench by names of their own."""

from __future__ import annotations

from typing import Any

from palpate.drivers.devices.positioner import Positioner
from palpate.drivers.devices.sample_changer import SampleChanger
from palpate.drivers.devices.sensor_node import SensorNode
from palpate.drivers.devices.shaker_amplifier import ShakerAmplifier
from palpate.drivers.devices.signal_generator import SignalGenerator
from palpate.drivers.devices.strain_indicator import StrainIndicator


class UsualDevices:
    """What `Bench` has beside roles, for procedures that need more of a device than its role says."""

    all: Any
    role: Any
    maybe: Any

    @property
    def generator(self) -> SignalGenerator:
        found: SignalGenerator = self.role(SignalGenerator)
        return found

    @property
    def amplifier(self) -> ShakerAmplifier:
        found: ShakerAmplifier = self.role(ShakerAmplifier)
        return found

    @property
    def indicator(self) -> StrainIndicator:
        found: StrainIndicator = self.role(StrainIndicator)
        return found

    @property
    def positioner(self) -> Positioner:
        found: Positioner = self.role(Positioner)
        return found

    @property
    def nodes(self) -> list[SensorNode]:
        found: list[SensorNode] = self.all(SensorNode)
        return found

    @property
    def changer(self) -> SampleChanger | None:
        found: SampleChanger | None = self.maybe(SampleChanger)
        return found
