"""How much the force ratio of a sensor scatters from mounting to mounting, by a run of several mountings."""

from __future__ import annotations

from datetime import date
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from palpate.instrument.config import Hashed, IsoDate, Name, NotNegative, Positive
from palpate.instrument.uncertainty.groups import Between


class MountingScatter(Hashed):
    """Scatter of the ratio of one sensor from mounting to mounting. The field names are the keys of its file.

    Args:
        means_u: relative standard deviation of the mean ratio of a mounting; what sets scatter within it is in it.
        degrees_of_freedom: degrees of freedom of this estimate: mountings less one.
        sets_u: what sets alone add to it.
        sets_freedom: the degrees of freedom of that.
        design: design of the sensor.
        device: serial number of the sensor node.
        scene: identity of the simulated sensor; None: a real one.
        simulated: whether a simulated bench measured it.
        source: name of the run.
        created: date and time, ISO 8601.
        expires: last day on which it is used, ISO 8601.
    """

    file: ClassVar[str] = "scatter of mountings"

    model_config = ConfigDict(strict=True)

    means_u: Positive
    degrees_of_freedom: Annotated[int, Field(ge=1)]
    sets_u: NotNegative
    sets_freedom: Annotated[int, Field(ge=1)]
    design: Name
    device: Name
    scene: Name | None = None
    simulated: bool
    source: Name
    created: Name
    expires: IsoDate

    @property
    def found(self) -> Between:
        """What is known of the scatter beyond that of sets."""
        return Between(self.means_u, self.degrees_of_freedom, self.sets_u, self.sets_freedom)

    def holds_for(self, design: str, scene: str | None, simulated: bool, today: date) -> bool:
        """Whether it was measured with such a sensor and has not expired."""
        same = (self.design, self.scene, self.simulated) == (design, scene, simulated)
        return same and today <= date.fromisoformat(self.expires)
