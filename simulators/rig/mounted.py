"""What lies between the probe and the load cell: how stiff it is, and what part of the force each film takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.instrument.errors import RangeError
from palpate.instrument.models.influence import tooth_shares
from palpate.instrument.models.table import Response
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.physics.parts import Stack

SUPPORT_STIFFNESS = 1e6  # N/m, of the rigid support with the load cell below it [A]
PIN_STIFFNESS = 1e3  # N/m, of the rubber tip of the pin that presses one tooth [A]


@dataclass(frozen=True)
class Mounted:
    """A sample on the sensor, or on a rigid support in its place; or a pin on one tooth; or nothing.

    response: of the sensor under the sample. probe_at: above this point of the sensor the probe is a point [m].
    """

    design: Design
    sample: Sample | None = None
    response: Response | None = None
    on_support: bool = False
    tooth: int | None = None
    probe_at: tuple[float, float] | None = None

    @property
    def thickness(self) -> float:
        """Of the sample [m]."""
        return self.sample.thickness if self.sample else 0.0

    def probed(self, x: float, y: float) -> Mounted:
        """The same under a point probe. Raises RangeError."""
        if self.sample is None or self.on_support:
            raise RangeError("no sample lies on the sensor: mount one before the point probe is placed")
        tooth_shares(self.design, self.sample, (x, y))
        return replace(self, probe_at=(x, y))

    def springs(self) -> Stack:
        """The stack's stiffness comes from the column model, its share on the tooth from the scene's model.

        On the rigid support the sample takes the ring's branch, as no film lies below either.
        """
        if self.on_support:
            pad = self.sample
            compliance = 0.0 if pad is None else pad.thickness / (pad.modulus * pad.area)
            whole = compliance + 1 / SUPPORT_STIFFNESS
            return Stack(0.0, 1 / whole, object_share=compliance / whole)
        if self.tooth is not None:
            return Stack(PIN_STIFFNESS, 0.0, object_share=1.0)
        if self.response is None or self.sample is None:
            return Stack(0.0, 0.0, 0.0)
        ring = self.design.ring
        hardness = self.sample.modulus * ring.height / (ring.material.modulus * self.sample.thickness)
        ratio, stiffness = self.response.force_ratio, self.response.stiffness
        return Stack(ratio * stiffness, (1 - ratio) * stiffness, object_share=1 / (1 + hardness))

    def part(self, film: Film) -> float:
        """Of the force on all teeth, what those of a film take; under a point probe, of the whole force."""
        if self.on_support:
            return 0.0
        if self.tooth is not None:
            return float(self.tooth in film.teeth)
        if self.probe_at is not None and self.sample is not None and film.kind != "total":
            return tooth_shares(self.design, self.sample, self.probe_at)[film.teeth[0]]
        return len(film.teeth) / len(self.design.teeth)
