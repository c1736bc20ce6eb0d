"""How much the force ratio of a sensor scatters from mounting to mounting, by a run of several mountings."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.config import Name, NotNegative, Positive
from palpate.instrument.uncertainty.budget import Between


class MountingScatterCalibration(Calibration):
    """Scatter of the ratio of one sensor from mounting to mounting. The field names are the keys of its file.

    Args:
        means_u: relative standard deviation of the mean ratio of a mounting; what sets scatter within it is in it.
        degrees_of_freedom: degrees of freedom of this estimate: mountings less one.
        sets_u: what sets alone add to it.
        sets_freedom: the degrees of freedom of that.
        design: design of the sensor.
        device: serial number of the sensor node.
    """

    file: ClassVar[str] = "scatter of mountings"
    kind: ClassVar[str] = "mountings"
    make: ClassVar[str] = "run palpate measure modulus with three mountings or more"

    model_config = ConfigDict(strict=True)

    means_u: Positive
    degrees_of_freedom: Annotated[int, Field(ge=1)]
    sets_u: NotNegative
    sets_freedom: Annotated[int, Field(ge=1)]
    design: Name

    @property
    def of(self) -> tuple[str, ...]:
        return (self.design,)

    @property
    def found(self) -> Between:
        """What is known of the scatter beyond that of sets."""
        return Between(self.means_u, self.degrees_of_freedom, self.sets_u, self.sets_freedom)
