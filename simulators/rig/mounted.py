"""What lies between the probe and the load cell: its stiffness, and the part of the force that each film takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.instrument.errors import RangeError
from palpate.instrument.models.influence import tooth_shares
from palpate.instrument.models.table import Response
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.physics.parts import SpringStack

SUPPORT_STIFFNESS = 1e6  # N/m, rigid support with the load cell below it [A]
PIN_STIFFNESS = 1e3  # N/m, rubber tip of the pin that presses one tooth [A]


@dataclass(frozen=True)
class Mounted:
    """What lies under the probe: a sample on the sensor or on a rigid support, a pin on one tooth, or nothing.

    Attributes:
        design: the sensor design.
        sample: the sample; None: there is none.
        response: force ratio and stiffness of the sensor under the sample; None without a sample on the sensor.
        on_support: True: a rigid support takes the sensor's place.
        tooth: index of the tooth on which the pin stands; None: no pin.
        probe_at: x and y of a point probe from the sensor's corner [m]; None: the probe covers the whole sample.
    """

    design: Design
    sample: Sample | None = None
    response: Response | None = None
    on_support: bool = False
    tooth: int | None = None
    probe_at: tuple[float, float] | None = None

    @property
    def thickness(self) -> float:
        """Thickness of the sample; 0 without one [m]."""
        return self.sample.thickness if self.sample else 0.0

    def probed(self, x: float, y: float) -> Mounted:
        """The same sample with a point probe above (x, y) [m].

        Raises RangeError: no sample lies on the sensor, or no model gives the teeth's shares of the force there.
        """
        if self.sample is None or self.on_support:
            raise RangeError("no sample lies on the sensor: mount one before the point probe is placed")
        tooth_shares(self.design, self.sample, (x, y))
        return replace(self, probe_at=(x, y))

    def springs(self) -> SpringStack:
        """The stack of sample and sensor as two parallel springs, one to the teeth and one to the ring.

        The scene's sensor model gives the total stiffness and the teeth's share of the force; the column model gives
        the sample's part of the compression. On the rigid support the sample is in the ring's branch, because no film
        lies below either of them.
        """
        if self.on_support:
            pad = self.sample
            compliance = 0.0 if pad is None else pad.thickness / (pad.modulus * pad.area)
            whole = compliance + 1 / SUPPORT_STIFFNESS
            return SpringStack(0.0, 1 / whole, object_share=compliance / whole)
        if self.tooth is not None:
            return SpringStack(PIN_STIFFNESS, 0.0, object_share=1.0)
        if self.response is None or self.sample is None:
            return SpringStack(0.0, 0.0, 0.0)
        ring = self.design.ring
        hardness = self.sample.modulus * ring.height / (ring.material.modulus * self.sample.thickness)
        ratio, stiffness = self.response.force_ratio, self.response.stiffness
        return SpringStack(ratio * stiffness, (1 - ratio) * stiffness, object_share=1 / (1 + hardness))

    def part(self, film: Film) -> float:
        """Fraction of the force on all teeth that the teeth of a film take; under a point probe, of the whole force."""
        if self.on_support:
            return 0.0
        if self.tooth is not None:
            return float(self.tooth in film.teeth)
        if self.probe_at is not None and self.sample is not None and film.kind != "total":
            return tooth_shares(self.design, self.sample, self.probe_at)[film.teeth[0]]
        return len(film.teeth) / len(self.design.teeth)
