"""What numbers of the finite-element models depend on, apart from the object's modulus and the force."""

from __future__ import annotations

from dataclasses import replace

from palpate.instrument.models.parameters import Parameters, SolidParameters

# Raise this with every change of the models' numbers: stored ones of another version are not used.
CODE_VERSION = 5


def fixed(parameters: Parameters) -> str:
    """Text of everything on which a force ratio depends, except the object's modulus.

    The ring's modulus is in it, because it sets the sensor's stiffness against that of the plates.
    """
    apart = replace(parameters, sensed_modulus=parameters.compliant_modulus)
    if isinstance(apart, SolidParameters):
        apart = replace(apart, force=1.0)
    return apart.canonical()
