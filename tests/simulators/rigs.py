"""Rigs for tests: the thesis' bench with chosen effects, driven without devices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.models import springs
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import effect_class
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, Periodic, constant
from palpate.simulators.physics.chain import Armature, Limits, MeasuringChain, Plays, Touch
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import RigParameters, Scene

MS = 1_000_000
SECOND = 1000 * MS
BALANCE = 9e-3  # m, where the probe touches a 3 mm sample: 12 mm less its thickness


def an_effect(name: str, **parameters: object) -> Any:
    """An effect as a scene calls for it, by name; it has the methods of its own kind."""
    return effect_class(name).model_validate(parameters)


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


def shaken(
    effects: Mapping[str, Effect],
    sample: str = "2",
    advance: float = 7e-3,
    amplitude: float = 2.0,
    *,
    design: str = "single",
    seed: int = 1,
) -> Rig:
    """A rig with these effects alone, and a clock of its own, under a sample that is pressed and shaken."""
    clock = VirtualClock()
    rig = Rig(replace(scene(), effects=effects, design=get_design(design), seed=seed), clock)
    clock.add(rig)
    pressed(rig, sample, BALANCE + advance, amplitude)
    return rig


def share(chosen: Scene, sample: str) -> float:
    """Part of the shaker's force that the stack takes; the suspension takes the rest."""
    stack = springs.stiffness(chosen.design, SAMPLES[sample])
    return stack / (chosen.rig.suspension_stiffness + stack)


STRONG: dict[str, Effect] = {
    "frequency_error": an_effect("frequency_error", bits=28),
    "amplifier_clip": an_effect("amplifier_clip", rail="1 V"),
    "current_limit": an_effect("current_limit", limit="0.3 A"),
    "end_stops": an_effect("end_stops", travel="1 mm"),
    "shaker_dynamics": an_effect("shaker_dynamics", mass="0.3 kg"),
    "curve_error": an_effect("curve_error"),
    "mounting_scatter": an_effect("mounting_scatter", scatter=0.1),
    "viscoelastic": an_effect("viscoelastic", material="soft_tissue"),
    "hysteresis": an_effect("hysteresis", weights=(0.3,), radii=("0.02 N",)),
    "crosstalk": an_effect("crosstalk", compliant=0.2),
    "glue_clamping": an_effect("glue_clamping"),
    "off_axis": an_effect("off_axis", angle="30 deg"),
    "gain_scatter": an_effect("gain_scatter", strength=3.0),
    "pyroelectric": an_effect("pyroelectric", drift="0.2 K/s"),
    "triboelectric": an_effect("triboelectric", charge="1 pC"),
    "humidity_leak": an_effect("humidity_leak", over="10 s"),
    "charge_amplifier": an_effect("charge_amplifier", time_constant="0.4 s"),
    "voltage_amplifier": an_effect("voltage_amplifier"),
    "mains_hum": an_effect("mains_hum", amplitude="50 mV"),
    "pink_noise": an_effect("pink_noise", density="100 µV/√Hz"),
    "white_noise": an_effect("white_noise", density="100 µV/√Hz"),
    "jitter": an_effect("jitter", delay="1 ms"),
    "adc": an_effect("adc", bits=10),
    "can_timing": an_effect("can_timing"),
    "load_cell": an_effect("load_cell", zero="2.5 mV", noise="1.5 mV", decimals=3),
    "serial_timing": an_effect("serial_timing"),
}


NO_PLAYS = Plays(ring=False, radii=(), weights=())
SHAKER = Armature(4.0, 3.5, 1000.0)  # N/A, ohm, N/m
# Films: the tooth with the plays, and both columns.
TOOTH_AND_TOTAL = np.array([[1.0, 0.0, 1.0, 0.0], [1.0, 1.0, 0.0, 0.0]])


def chain_on(
    stack: StateSpace,
    advance: float,
    volts: float,
    frequency: int = 10 * HERTZ,
    *,
    armature: Armature = SHAKER,
    limits: Limits | None = None,
    plays: Plays = NO_PLAYS,
    films: Floats = TOOTH_AND_TOTAL,
) -> tuple[MeasuringChain, Path]:
    """A shaker on a stack and films that give forces in volts, and its path under a sine from rest."""
    chain = MeasuringChain(
        armature, limits or Limits(), stack, advance, plays, gain(films), [gain(np.eye(1))] * len(films),
        np.zeros(len(films)), 0.1, 0.0,
    )  # fmt: skip
    drive = waveform("sine", volts, frequency)
    mode = chain.mode(Touch(contact=(advance >= 0,) * 2, drag=(0,) * chain.plays))
    return chain, Path((drive, constant(1.0, drive), drive.derivative()), mode, 0, np.zeros(mode.system.order))
