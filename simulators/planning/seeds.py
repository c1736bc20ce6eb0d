"""Load sets of one scene under many seeds, as arrays: what `load_sets` samples under each seed, to the last bit.

Up to the converter a chain in closed form is linear in the gains that are drawn for each setting of the drive. So it is
computed once without any gain, and once for each setting with the gains of that setting alone. The films under a seed
are sums of these, times the seed's gains, plus the seed's own noise.

Such a sum rounds in another order than a rig that is followed. The converter's steps are 10^8 times as large, so that
nearly always the samples are the same. Where a sample is so near to the edge of a step that it might fall on the other
side, the seed is not `sure`, and must be followed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, HEADROOM, RANGE_VOLTS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.effects import EFFECTS
from palpate.simulators.physics.converter import FINEST, convert
from palpate.simulators.physics.effect import Effect, Effects, FilmsEffect, Kind
from palpate.simulators.planning.waveforms import SettledLoad, settled_loads
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import FilmInputs
from palpate.simulators.scenes.scene import Scene

Flags = npt.NDArray[np.bool_]

ROUND_OFF = 1e-12  # of a range, a thousand times the greatest difference that the order of a sum makes
NEGLIGIBLE = 1e-14  # V, a tenth of `ROUND_OFF` of the finest range


def seed_bound(scene: Scene) -> str:
    """Name of an effect by which the films are not linear in what a seed draws; empty: there is none.

    What an effect of another package draws is not known. One that changes the share of the force draws the stiffness of
    the chain.
    """
    effects = Effects(scene.effects)
    bound = [*effects.share, *(effect for effect in effects.values() if effect.name not in EFFECTS)]
    return bound[0].name if bound else ""


class SetGains(FilmsEffect):
    """Stands in place of the scatter of gains: 1 where the drive was set at one of some times [ns], else 0."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    times_ns: frozenset[int]

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        return float(set_at_ns in self.times_ns) * np.eye(len(design.films))


@dataclass(frozen=True, slots=True, eq=False)
class SeedSamples:
    """Samples of all films under some seeds.

    Attributes:
        voltage: (seeds, loads, films, n) V.
        saturated: whether a sample is saturated (seeds, loads).
        sure: whether they are certainly what `load_sets` gives (seeds,).
    """

    voltage: Floats
    saturated: Flags
    sure: Flags


@dataclass(frozen=True, slots=True, eq=False)
class _Films:
    """Films under some loads, from load number `first` on: voltages [V], and rates [V/s] where an effect needs them.

    Each is of shape (loads, films, n).
    """

    first: int
    volts: Floats
    rates: Floats | None

    def less(self, other: _Films) -> _Films:
        here = slice(self.first - other.first, self.first - other.first + len(self.volts))
        rates = None if self.rates is None or other.rates is None else self.rates - other.rates[here]
        return _Films(self.first, self.volts - other.volts[here], rates)


class SeedArray:
    """The load sets of a scene, of which all that its seeds share is computed once."""

    def __init__(self, scene: Scene, sample: Sample, loads: Sequence[float], frequency: float, dwell: float) -> None:
        """Compute what the seeds share. Arguments and errors are those of `settled_loads`."""
        effects = Effects(scene.effects)
        self._scatter = effects.scattering
        self._converter = effects.converter
        self._nodes = scene.nodes
        self._follows = any(effect.follows for effect in effects.input)

        def settled(times_ns: Iterable[int]) -> Iterator[SettledLoad]:
            chosen: Mapping[str, Effect] = scene.effects
            if self._scatter:
                chosen = effects.but(self._scatter).including(SetGains(times_ns=frozenset(times_ns)))
            return settled_loads(replace(scene, effects=chosen), sample, loads, frequency, dwell)

        self._loads: list[SettledLoad] = []
        self._without = self._films(self._kept(settled([])))
        self._rig = self._loads[-1].rig
        self._gains: list[tuple[int, _Films]] = []  # when they are drawn [ns], and films by these gains alone
        if self._scatter and self._scatter.by_mounting:
            every = (time_ns for at in self._loads for time_ns in at.set_ns)
            self._gains = [(self._rig.mounted_at_ns, self._films(settled(every)).less(self._without))]
        elif self._scatter:
            for number, at in enumerate(self._loads):
                for time_ns in at.set_ns:
                    self._gains.append((time_ns, self._films(settled([time_ns]), number)))

    @property
    def seconds(self) -> Floats:
        """Times of the samples under each load, from the first one on (n,) [s]."""
        return self._loads[0].seconds

    @property
    def samples_in(self) -> int:
        """Number of samples of all films under all loads."""
        return self._without.volts.size

    def _kept(self, settled: Iterable[SettledLoad]) -> Iterator[SettledLoad]:
        for at in settled:
            self._loads.append(at)
            yield at

    def _films(self, settled: Iterable[SettledLoad], first: int | None = None) -> _Films:
        """Films under each load; with `first`, what they differ by from no gains, from there until it is negligible."""
        volts, rates = [], []
        for number, at in enumerate(settled):
            if first is not None and number < first:
                continue
            volts.append(at.rig.film_voltages(at.time_ns))
            if self._follows:
                rates.append(at.rig.film_rates(at.time_ns, at.period_ns))
            if first is not None and np.abs(volts[-1] - self._without.volts[number]).max() < NEGLIGIBLE:
                break
        found = _Films(first or 0, np.array(volts), np.array(rates) if self._follows else None)
        return found if first is None else found.less(self._without)

    # --- what differs from seed to seed ----------------------------------------------------------------

    def sampled(self, seeds: Sequence[int]) -> SeedSamples:
        """What the nodes sample under each seed."""
        gains = [self._drawn(seed) for seed in seeds]
        volts = self._summed(gains, self._without.volts, [films.volts for _, films in self._gains])
        rates = None
        if self._without.rates is not None:
            rates = self._summed(
                gains, self._without.rates, [films.rates for _, films in self._gains if films.rates is not None]
            )
        expected = HEADROOM * np.abs(volts).max(axis=-1)
        fine = expected <= min(RANGE_VOLTS)
        sure = (np.abs(expected - min(RANGE_VOLTS)) > ROUND_OFF).all(axis=(1, 2))
        self._add(seeds, volts, rates)
        ranges = np.where(fine, min(RANGE_VOLTS), max(RANGE_VOLTS))
        codes, saturated, clear = self._converted(volts, ranges)
        again = saturated & fine
        if again.any():
            ranges[again] = max(RANGE_VOLTS)
            codes[again], saturated[again], still_clear = self._converted(volts[again], ranges[again])
            clear[again] &= still_clear
        counts = codes * FULL_SCALE_COUNTS + 0.0  # a count has no negative zero
        voltage = counts * (ranges / FULL_SCALE_COUNTS)[..., np.newaxis]
        return SeedSamples(voltage, np.asarray(saturated.any(axis=-1)), sure & clear.all(axis=(1, 2)))

    def _drawn(self, seed: int) -> Floats:
        """Gains of the films (draws, films)."""
        if self._scatter is None:
            return np.zeros((0, 0))
        design, stream = self._rig.scene.design, Stream(seed, self._scatter.name)
        return np.array([np.diagonal(self._scatter.matrix(design, stream, at_ns)) for at_ns, _ in self._gains])

    def _summed(self, gains: Sequence[Floats], without: Floats, each: Sequence[Floats]) -> Floats:
        """Voltages or rates (seeds, loads, films, n) with the gains of each seed."""
        total = np.tile(without, (len(gains), 1, 1, 1))
        for number, ((_, films), added) in enumerate(zip(self._gains, each, strict=True)):
            own = np.array([drawn[number] for drawn in gains])[:, np.newaxis, :, np.newaxis]
            total[:, films.first : films.first + len(added)] += own * added
        return total

    def _add(self, seeds: Sequence[int], volts: Floats, rates: Floats | None) -> None:
        """Add to the films what the inputs of their nodes add; a film on several nodes is the last one's."""
        plain = volts.copy()
        for node in range(1, self._nodes + 1):
            inputs = FilmInputs(self._rig, node, node)
            wired = [(i, inputs.wired(film)) for i, film in enumerate(self._rig.scene.design.films)]
            films = [i for i, channel in wired if channel is not None]
            channels = [channel - 1 for _, channel in wired if channel is not None]
            at_inputs = inputs.film_channels @ plain
            for own, seed in enumerate(seeds):
                sources = inputs.sources(self._loads[0].period_ns, seed)
                for number, at in enumerate(self._loads):
                    of_films = rates[own, number] if rates is not None else None
                    of_channels = partial(_channels, inputs, of_films)
                    given = inputs.with_added(at_inputs[own, number], sources, at.time_ns, at.period_ns, of_channels)
                    volts[own, number, films] = given[channels]

    def _converted(self, volts: Floats, ranges: Floats) -> tuple[Floats, Flags, Flags]:
        """Samples as fractions of their ranges, which films have a saturated one, and which are clear of all edges."""
        fraction = volts / ranges[..., np.newaxis]
        bits = self._converter.bits if self._converter else FINEST
        steps = fraction * 2.0 ** (bits - 1)
        clear = np.abs(steps - np.rint(steps)).max(axis=-1) < 0.5 - ROUND_OFF * 2.0 ** (bits - 1)
        codes, saturated = self._converter.convert(fraction) if self._converter else convert(fraction)
        return codes, np.asarray(saturated.any(axis=-1)), clear


def _channels(inputs: FilmInputs, rates: Floats | None) -> Floats:
    """Rates of a node's channels; only effects that follow a film's signal ask for them."""
    assert rates is not None
    return np.asarray(inputs.film_channels @ rates)
