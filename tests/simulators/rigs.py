"""Rigs for tests: the thesis' bench with chosen effects, driven without devices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.instrument.models import springs
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.linear.periodic import HERTZ, Periodic
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import RigParameters, Scene

MS = 1_000_000
SECOND = 1000 * MS
BALANCE = 9e-3  # m, where the probe touches a 3 mm sample: 12 mm less its thickness


def scene(*effects: str, **rig: str) -> Scene:
    """The thesis' bench with these effects only."""
    thesis = read_scene("thesis_single")
    return replace(
        thesis,
        effects={name: thesis.effects[name] for name in effects},
        rig=RigParameters.model_validate({**thesis.rig.model_dump(mode="json"), **rig}),
    )


def waveform(kind: str, amplitude: float, frequency: int = 10 * HERTZ, start_ns: int = 0) -> Periodic:
    """A waveform as the signal generator gives it."""
    k = np.arange(1, 26, 2)
    match kind:
        case "square":
            sines = 4 / (np.pi * k)
        case "triangle":
            sines = 8 / (np.pi * k) ** 2 * np.where(k % 4 == 1, 1, -1)
        case _:
            k, sines = np.array([1]), np.array([1.0])
    return Periodic(0.0, frequency, start_ns, 0, k, (-1j * amplitude * sines).astype(complex))


def pressed(rig: Rig, sample: str, position: float, amplitude: float, kind: str = "sine") -> None:
    rig.mount(SAMPLES[sample])
    rig.set_position(position)
    rig.set_voltage(waveform(kind, amplitude))


def share(chosen: Scene, sample: str) -> float:
    """Part of the shaker's force that the stack takes; the suspension takes the rest."""
    stack = springs.stiffness(chosen.design, SAMPLES[sample])
    return stack / (chosen.rig.suspension_stiffness + stack)
