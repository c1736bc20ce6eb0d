"""What an effect changes in the results, at most: force and force ratio of a least-squares sine at the set load.

Steady states are compared as phasors, so what is linear is exact. Added to that is what can be left of transients,
for a drive that begins at any phase, `settled` before the dwell; and what noise, steps and plays that the scene
simulates beside the effect make of its change. Where contact, a limit or the converter's rail acts, nothing holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from instrument.contracts.sensor_node import RANGE_VOLTS
from instrument.design import FILM_KINDS, Film
from simulators.effects import EFFECTS
from simulators.effects.effect import (
    AmplifierEffect,
    Bound,
    Case,
    DriveEffect,
    Effect,
    FilmsEffect,
    HysteresisEffect,
    LeakEffect,
    ShakerEffect,
    StackEffect,
)
from simulators.linear.lti import StateSpace
from simulators.linear.periodic import HERTZ
from simulators.physics.chain import Touch
from simulators.planning.fits import fitted, leaks, left_over, transient
from simulators.planning.pickup import Additive, bound, largest_within, rounding, signal
from simulators.randomness import Stream

if TYPE_CHECKING:
    from simulators.rig import Rig

Complexes = npt.NDArray[np.complex128]
BEYOND = Bound(math.inf, math.inf)
LIMITS = ("rail", "current", "stop")
PEAKS = 100.0  # of noise, over what a fit makes of it


@dataclass(frozen=True, slots=True)
class Change:
    """What a film's phasor is multiplied with, and how far from that the factor may lie."""

    factor: complex
    reach: float = 0.0


# --- from changes of the films to the results ----------------------------------------------------------


def bound_of(case: Case, changes: Sequence[Change]) -> Bound:
    """Bound of the results for a change of each film."""
    if all(change == Change(1.0) for change in changes):
        return Bound(0.0, 0.0)
    spans = [_span(case, number, change) for number, change in enumerate(changes)]
    rigid, total = (
        [number for number, film in enumerate(case.design.films) if film.kind == kind] for kind in FILM_KINDS
    )
    force = max(max(abs(spans[base][0] - 1), abs(spans[base][1] - 1)) for base in total)
    ratio = 0.0
    for base in total:
        least, most = spans[base]
        for tooth in rigid:
            if not set(case.design.films[tooth].teeth) <= set(case.design.films[base].teeth):
                continue
            low, high = spans[tooth]
            if not (least > 0 and math.isfinite(most + high)):
                return Bound(force, math.inf)
            ratio = max(ratio, high / least - 1, 1 - low / most)
    return Bound(force, ratio)


def _span(case: Case, number: int, change: Change) -> tuple[float, float]:
    """Least and greatest factor of a film's fitted amplitude."""
    film = case.design.films[number]
    added = sum(_errors(case, film))
    least = signal(case, film)
    if not added < least:
        return 0.0, math.inf
    step, common = 2 * rounding(case, film) / least, added / least
    # (s f + n) / (s + n) = f' with f' - f = (1 - f) n / (s + n): what is added to both dilutes the change.
    # Jitter follows the signal: of another phase it is another.
    late = case.effects.get("jitter")
    moved = change.reach > 0 or complex(change.factor).imag != 0
    other = 2 * abs(change.factor) * late.error(case, film) / least if moved and isinstance(late, Additive) else 0.0
    reach = change.reach + abs(change.factor - 1) * common + step + other + _played(case, number, change)
    slack = reach / (1 - common)
    return max(abs(change.factor) - slack, 0.0), abs(change.factor) + slack


def _played(case: Case, number: int, change: Change) -> float:
    """Plays follow a change of their force by no more than the change itself, in size and once more in phase."""
    plays = next((e for e in case.effects.values() if isinstance(e, HysteresisEffect)), None)
    if plays is None or plays.path != case.design.films[number].kind:
        return 0.0
    weights = sum(abs(weight) for weight in plays.plays().weights)
    return 2 * largest_within(case) * weights * (abs(change.factor - 1) + change.reach)


# --- changes of the films ------------------------------------------------------------------------------


def bound_of_gains(case: Case, effect: FilmsEffect) -> Bound:
    """Of gains that hold at any frequency: the films change by them, transients and all."""
    films = case.design.films
    volts = np.array([signal(replace(case, effects={}), film) for film in films])
    if not volts.all():
        return BEYOND
    factors = effect.matrix(case.design, Stream(0), 0) @ volts / volts
    return bound_of(case, [Change(float(factor)) for factor in factors])


def bound_of_chain(case: Case, effect: Effect) -> Bound:
    """Of anything linear: the load is set anew with it."""
    before, after = case.driven(case.effects), case.driven(_with(case, effect))
    if nonlinear(case, before) or nonlinear(case, after):
        return BEYOND
    true = before.coil_voltage().frequency / HERTZ
    was, became = gains(before, true), gains(after, true)
    least, most = fitted(case, true) if true != case.frequency else (1.0, 1.0)
    if not was.all() or not least > 0:
        return BEYOND
    # A fit of another frequency than the drive's depends on the phase.
    left = (left_over(case, before) + left_over(case, after)) / abs(was) / least
    factors = became / was
    left = left + abs(factors) * (most / least - 1) * (factors.imag != 0)
    return bound_of(case, [Change(complex(f), float(r)) for f, r in zip(factors, left, strict=True)])


def bound_of_limit(case: Case, effect: Effect, name: str) -> Bound:
    """Of a limit: nothing where it is never met from the beginning of the drive to the end of the dwell."""
    return BEYOND if _touched(case, case.driven(_with(case, effect)), (name,)) else Bound(0.0, 0.0)


def warming(case: Case, source: StateSpace, film: Film) -> float:
    """What a fit can find of a source that the constant 1 feeds from the drive's beginning on [V]."""
    amplifier, number = _amplifier(case), case.design.films.index(film)
    row = slice(number, number + 1)
    chains = [StateSpace(source.a, source.b, source.c[row], source.d[row])]
    if amplifier is not None:
        chains = [chains[0].then(amplifier.system(film, case.design, leakage)) for leakage in _leakages(case)]
    errors = []
    for chain in chains:
        weights, rates = transient(chain, chain.b[:, 3], np.zeros(chain.order))
        errors.append(float(weights[0] @ leaks(case, rates)))
    return max(errors)


def of_source(case: Case, effect: Additive) -> Bound:
    """As of anything that adds to the films' voltages, where the load is what is asked for."""
    with_it = case.driven(_with(case, cast("Effect", effect)))
    return BEYOND if nonlinear(case, with_it) else bound(effect, case)


def following(case: Case, film: Film, force: float) -> float:
    """Amplitude of a voltage of a film that follows the load, `force` V for each newton [V]."""
    amplifier = _amplifier(case)
    if amplifier is None:
        return force * case.amplitude
    largest = 0.0
    for leakage in _leakages(case):
        system = amplifier.system(film, case.design, leakage)
        left = abs(float(system.d[0, 0])) * float(leaks(case, np.linalg.eigvals(system.a).astype(complex)).sum())
        passed = float(abs(system.transfer(case.frequency)[0, 0]))
        largest = max(largest, passed * case.amplitude + left * (case.preload + case.amplitude))
    return force * largest


def bound_of_leak(case: Case, effect: LeakEffect) -> Bound:
    """Of a leak that grows: the largest there is, its offset in the dwell, and the amplifiers' transients twice."""
    amplifier, design = _amplifier(case), case.design
    if amplifier is None:
        return Bound(0.0, 0.0)
    rig = case.driven(case.effects)
    was, left = abs(gains(rig, rig.coil_voltage().frequency / HERTZ)), left_over(case, rig)
    if nonlinear(case, rig) or not was.all():
        return BEYOND
    most = max(_conductances(effect))
    # A leak that changes by equal parts in equal times: within a dwell by so much of its largest value.
    parts = abs(math.log(effect.conductance(0.0) / effect.conductance(math.inf))) if most else 0.0
    moved = 1 - math.exp(-min(parts, parts * (case.dwell + 2e-9 * effect.epoch_ns) / effect.over))
    changes = []
    for number, film in enumerate(design.films):
        wet, dry = (amplifier.system(film, design, g).transfer(case.frequency)[0, 0] for g in (most, 0.0))
        offset = abs(amplifier.offset(film, design, most)) * moved * largest_within(case) / was[number]
        changes.append(Change(1.0, float(abs(wet / dry - 1) + offset + 2 * left[number] / was[number])))
    return bound_of(case, changes)


def bound_of_plays(case: Case, effect: HysteresisEffect) -> Bound:
    """Of play operators: each moves by no more than the force's amplitude less its radius."""
    rig, plays = case.driven(case.effects), effect.plays()
    swing = _swing(case, effect.path)
    if nonlinear(case, rig) or not swing > 0:
        return BEYOND
    moved = sum(abs(w) * max(0.0, swing - r) for w, r in zip(plays.weights, plays.radii, strict=True)) / swing
    shifted = sum(abs(w) for w in plays.weights) * (1 + case.preload / case.amplitude)
    amplifier = _amplifier(case)
    changes = []
    for film in case.design.films:
        if film.kind != effect.path:
            changes.append(Change(1.0))
            continue
        reach = moved * largest_within(case)
        if amplifier is not None:
            # A high-pass gives no more than twice the largest value of what it gets, and forgets the mean.
            system = amplifier.system(film, case.design, max(_leakages(case)))
            passed = abs(system.transfer(case.frequency)[0, 0])
            high = abs(float(system.d[0, 0]))
            rates = np.linalg.eigvals(system.a).astype(complex)
            reach = high / passed * (2 * reach + shifted * float(leaks(case, rates).sum()))
        changes.append(Change(1.0, reach))
    return bound_of(case, changes)


# --- parts ---------------------------------------------------------------------------------------------


def gains(rig: Rig, frequency: float) -> Complexes:
    """Phasors of the films under the drive's voltage at a frequency, (films,) [V]."""
    phasors: Complexes = rig.transfer(frequency)[:-1] * abs(rig.coil_voltage().amplitude[0])
    return phasors


def _with(case: Case, effect: Effect) -> Mapping[str, Effect]:
    name = next(name for name, path in EFFECTS.items() if path.endswith(f":{type(effect).__name__}"))
    return {**case.effects, name: effect}


def _amplifier(case: Case) -> AmplifierEffect | None:
    return next((e for e in case.effects.values() if isinstance(e, AmplifierEffect)), None)


def _leakages(case: Case) -> list[float]:
    leak = next((e for e in case.effects.values() if isinstance(e, LeakEffect)), None)
    return [0.0] if leak is None else [0.0, *_conductances(leak)]


def _conductances(leak: LeakEffect) -> tuple[float, float]:
    return leak.conductance(0.0), leak.conductance(math.inf)


def nonlinear(case: Case, rig: Rig) -> bool:
    """Whether contact, a limit or the converter's rail changes anything up to the end of the dwell."""
    if "adc" in rig.scene.effects:
        first = round(1e9 * case.settled)
        times = first + np.arange(round(case.dwell * case.rate)) * round(1e9 / case.rate)
        noise = max(sum(_errors(case, film)) for film in case.design.films)
        if not abs(rig.film_voltages(times)).max() + PEAKS * noise < max(RANGE_VOLTS):
            return True
    return _touched(case, rig, LIMITS) or _touched(case, rig, ("contact",))


def _touched(case: Case, rig: Rig, names: Sequence[str]) -> bool:
    """Whether any of these is met, or lost, from the beginning of the drive to the end of the dwell."""
    met = [rig.touch(), *(after for _, after in rig.transitions(round(1e9 * (case.settled + case.dwell))))]
    return any(getattr(touch, name) != getattr(Touch(), name) for touch in met for name in names)


def _errors(case: Case, film: Film) -> list[float]:
    return [effect.error(case, film) for effect in case.effects.values() if isinstance(effect, Additive)]


def _swing(case: Case, path: str) -> float:
    """Amplitude of the force on the films of a kind, summed over the teeth [N]."""
    moving = {n: e for n, e in case.effects.items() if isinstance(e, DriveEffect | ShakerEffect | StackEffect)}
    rig = case.driven(moving)
    phasors = gains(rig, rig.coil_voltage().frequency / HERTZ)
    return float(sum(abs(v) / f.sensitivity for v, f in zip(phasors, case.design.films, strict=True) if f.kind == path))


def diluted(case: Case) -> list[float]:
    """What other effects add to each film's amplitude, relatively."""
    films = [(sum(_errors(case, film)), signal(case, film)) for film in case.design.films]
    return [error / (least - error) if error < least else math.inf for error, least in films]
