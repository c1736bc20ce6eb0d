"""The person at the bench, as procedures see him."""

from __future__ import annotations

from typing import Protocol

from palpate.instrument.sensor.sample import Sample


class Operator(Protocol):
    """Does by hand what no device does. Each method returns when it is done."""

    def mount(self, sample: Sample) -> None:
        """Lay the sample under the probe, the positioner being at its home position."""

    def lay_on_support(self, sample: Sample | None) -> None:
        """Put a rigid support in the sensor's place, its face as high, and lay the sample on it; None: nothing on it.

        The positioner is at its home position.
        """

    def place_probe(self, x: float, y: float) -> None:
        """Set a point probe above (x, y) from the sensor's corner [m], on the sample that is mounted.

        The positioner is at its home position.
        """

    def press_tooth(self, tooth: int) -> None:
        """Stand a pin on one tooth of the sensor, by its number from 0, so that the probe presses that tooth alone.

        The positioner is at its home position.
        """

    def place_weight(self, mass: float) -> None:
        """Put dead weights of `mass` kg in all on the load cell; 0 takes them off."""

    def turn_load_cell(self, degrees: float) -> None:
        """Turn the load cell about its axis to this position, without load."""

    def set_temperature(self, kelvin: float) -> None:
        """Make the surroundings of the sensor so many kelvin warmer than they were at the start."""
