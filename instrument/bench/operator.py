"""The person at the bench, as procedures ask for work by hand."""

from __future__ import annotations

from typing import Protocol

from palpate.instrument.sensor.sample import Sample


class Operator(Protocol):
    """Work that no device does. Each method returns when the work is done."""

    def mount(self, sample: Sample) -> None:
        """Lay the sample under the probe. The positioner is at its home position."""

    def lay_on_support(self, sample: Sample | None) -> None:
        """Replace the sensor by a rigid support of the same height, and lay the sample on it; None: leave it bare.

        The positioner is at its home position.
        """

    def place_probe(self, x: float, y: float) -> None:
        """Place a point probe above (x, y) [m] from the sensor's corner, on the sample that is mounted.

        The positioner is at its home position.
        """

    def press_tooth(self, tooth: int) -> None:
        """Stand a pin on one tooth of the sensor, by its number from 0, so that the probe presses that tooth alone.

        The positioner is at its home position.
        """

    def place_weight(self, mass: float) -> None:
        """Put dead weights of `mass` kg altogether on the load cell; 0: take them off."""

    def turn_load_cell(self, degrees: float) -> None:
        """Turn the unloaded load cell about its axis to this angle."""

    def set_temperature(self, kelvin: float) -> None:
        """Make the surroundings of the sensor warmer by this than they were at the start [K]."""

    def confirm_device(self, what: str, label: str) -> None:
        """Look that `what`, a device that tells nothing by which it is known, is the one with this label.

        This comes before anything is sent to the bench.
        """


def mount_anew(operator: Operator, sample: Sample) -> None:
    """Have a sample mounted that may lie under the probe already, and is to be taken off before.

    An operator without a method of this name is asked to mount it.
    """
    getattr(operator, "mount_anew", operator.mount)(sample)
