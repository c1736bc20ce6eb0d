"""Tests that every effect must pass, also one of an installed package."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import tomli_w

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.contracts.own import RANGE_VOLTS
from palpate.instrument.sensor.design import FILM_KINDS
from palpate.instrument.signals.estimate import amplitudes
from palpate.simulators.bounds import SIGMAS, bound_of
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import effect_class, in_order
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from palpate.simulators.physics.effect import CanEffect, CellEffect, Effect, FilmsEffect, InputEffect, LineEffect, rival
from palpate.simulators.planning.plan import RATE, SETTLING, Question, case_of, driven, plan
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene

PERIOD_NS = round(1e9 / RATE)
QUESTIONS = (Question("2", 3.0, dwell=0.5), Question("6", 1.5, 2.0, dwell=1.0))  # the softest and the hardest sample
SPECTRUM = 8192  # samples
DRAWS = 6  # number of draws of the drive's phase and of noise
GOLDEN = (math.sqrt(5) - 1) / 2
ROUNDING = 1e-9
ON_BUSES = (CanEffect, LineEffect, CellEffect)  # effects that do not change the films' signals
HEAD = 'name = "conformance"\npurpose = "An effect of a package."\ndesign = "single"\n'


class EffectConformance:
    """Tests of an effect on a bench, alone and together with the scene's usual effects.

    Attributes:
        effect: the effect, with parameters that change a second of samples clearly.
        nothing: the effect with parameters that change nothing; None: there are none.
        scene: name of the scene that gives sensor, model and usual effects.
    """

    effect: ClassVar[Effect]
    nothing: ClassVar[Effect | None] = None
    scene: ClassVar[str] = "thesis_single"

    def of(self, *effects: Effect, beside: Mapping[str, Effect] | None = None) -> Scene:
        """The scene with these effects, in addition to others."""
        chosen = in_order({**(beside or {}), **{effect.name: effect for effect in effects}})
        return replace(read_scene(self.scene), effects=chosen, called=dict.fromkeys(chosen, "called for"))

    @property
    def usual(self) -> dict[str, Effect]:
        """The usual effects of the scene that do not exclude it."""
        own = {self.effect.name: self.effect}
        usual = read_scene(self.scene).effects
        return {name: other for name, other in usual.items() if name not in own and not rival(other, own)}

    def hold_bound(self, effect: Effect, others: Mapping[str, Effect], question: Question) -> None:
        """Raises AssertionError: the effect changes a result by more than its bound, together with others."""
        without, with_it = self.of(beside=others), self.of(effect, beside=others)
        bound = bound_of(case_of(without.design, without.model, without.effects, question), effect)
        for force, ratio in _changes(without, with_it, question):
            found = f"{effect!r} changes force by {force:.3g} and ratio by {ratio:.3g}, more than its bound {bound}"
            assert force <= bound.force + ROUNDING, found
            assert ratio <= bound.ratio + ROUNDING, found

    def test_a_scene_calls_for_it_by_its_name_and_parameters(self, tmp_path: Path) -> None:
        assert effect_class(self.effect.name) is type(self.effect)
        parameters = self.effect.model_dump(mode="json", exclude_none=True)
        file = tmp_path / "conformance.toml"
        file.write_text(HEAD + tomli_w.dumps({"effects": {self.effect.name: parameters}}), encoding="utf-8")
        read = read_scene(str(file))
        assert read.effects == {self.effect.name: self.effect}
        file.write_text(read.to_toml(), encoding="utf-8")
        assert read_scene(str(file)).effects == read.effects

    def test_an_unknown_parameter_is_refused_and_a_known_one_cannot_be_changed(self) -> None:
        with pytest.raises(ValueError, match="no_such_parameter"):
            type(self.effect).model_validate({"no_such_parameter": 1})
        for parameter in type(self.effect).model_fields:
            with pytest.raises(ValueError, match="frozen"):
                setattr(self.effect, parameter, 1.0)

    def test_a_plan_names_it_and_weighs_it_where_it_is_left_out(self) -> None:
        (named,) = plan(self.of(self.effect), QUESTIONS[0]).included
        assert (named.name, named.kind) == (self.effect.name, self.effect.kind)
        assert self.effect.name in [each.name for each in plan(self.of(), QUESTIONS[0]).omitted]

    def test_it_changes_something(self) -> None:
        if isinstance(self.effect, ON_BUSES):
            pytest.skip("films do not feel what happens on a bus or in the load cell's display")
        assert not np.array_equal(_volts(self.of(self.effect, beside=self.usual)), _volts(self.of(beside=self.usual)))

    def test_at_zero_strength_it_changes_nothing_at_all(self) -> None:
        if self.nothing is None:
            pytest.skip("no parameters are named by which it changes nothing")
        for others in ({}, self.usual):
            assert np.array_equal(_volts(self.of(self.nothing, beside=others)), _volts(self.of(beside=others)))

    def test_the_same_seed_gives_the_same_samples_in_blocks_of_any_size(self) -> None:
        scene = self.of(self.effect, beside=self.usual)
        whole = _volts(scene)
        assert np.array_equal(_volts(scene), whole)
        assert np.array_equal(_volts(scene, block=7), whole)

    def test_the_order_in_a_scene_does_not_matter(self) -> None:
        scene = self.of(self.effect, beside=self.usual)
        turned = replace(scene, effects=dict(list(scene.effects.items())[::-1]))
        assert np.array_equal(_volts(turned), _volts(scene))

    @pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: f"{question.frequency:g} Hz")
    @pytest.mark.parametrize("usual", [False, True], ids=["alone", "beside the usual effects"])
    def test_leaving_it_out_never_changes_a_result_by_more_than_its_bound(
        self, usual: bool, question: Question
    ) -> None:
        for effect in (self.effect, type(self.effect)()):
            self.hold_bound(effect, self.usual if usual else {}, question)

    def test_the_bounds_of_others_beside_it_hold(self) -> None:
        """A converter asks it for its noise and its greatest voltage, gains that scatter for what passes them."""
        own = {self.effect.name: self.effect}
        for name in ("adc", "gain_scatter"):
            other = effect_class(name)()
            if name not in own and not rival(other, own):
                self.hold_bound(other, own, QUESTIONS[0])

    def test_where_it_says_so_it_cancels_in_the_ratio(self) -> None:
        if not self.effect.cancels_in_ratio:
            pytest.skip("it does not say that it cancels in the force ratio")
        for _, ratio in _changes(self.of(), self.of(self.effect), QUESTIONS[0]):
            assert ratio <= ROUNDING

    def test_gains_that_are_drawn_anew_for_a_load_set_say_so_by_their_scatter(self) -> None:
        """Bounds take other gains for the same ones at any time, and scattered ones to stay within six deviations."""
        if not isinstance(self.effect, FilmsEffect):
            pytest.skip("it does not change the films' gains")
        design, scatter = read_scene(self.scene).design, self.effect.scatter
        streams = (Stream(1, "conformance"), Stream(2, "conformance"))
        drawn = [self.effect.matrix(design, stream, at) for stream in streams for at in (0, 10**9, 10**13)]
        if scatter is None:
            assert all(np.array_equal(each, drawn[0]) for each in drawn), "gains differ, and `scatter` is None"
            return
        allowed = SIGMAS * scatter * np.array([film.scatter for film in design.films])
        assert all((abs(each - np.eye(len(allowed))) <= np.diag(allowed)).all() for each in drawn)

    def test_its_noise_is_as_strong_and_as_weak_as_it_says(self) -> None:
        """A converter's steps average out by what is independent in each sample; its rail must not be reached."""
        dither = self.effect.dither(RATE)
        if not isinstance(self.effect, InputEffect):
            assert dither == 0.0, "only what adds to samples dithers them"
            pytest.skip("it adds nothing at the converter")
        scene = self.of(self.effect)
        rig, numbers = driven(scene, QUESTIONS[0]), round(SETTLING * RATE) + np.arange(SPECTRUM)
        rates = rig.film_rates(numbers * PERIOD_NS)[-1]
        volts = self.effect.volts(Stream(1, self.effect.name), numbers * PERIOD_NS, PERIOD_NS, lambda: rates)
        case = case_of(scene.design, scene.model, {}, replace(QUESTIONS[0], dwell=SPECTRUM / RATE))
        assert np.abs(volts).max() <= self.effect.largest(case, lambda: rates[np.newaxis])
        power = np.abs(np.fft.rfft(volts - volts.mean())[1:]) ** 2 / SPECTRUM
        floor = min(band.mean() for band in np.array_split(power, 16))  # level of the white part of the noise
        assert floor >= 0.7 * dither**2, f"it says {dither:.3g} V in each sample, {math.sqrt(floor):.3g} V are white"


def _changes(without: Scene, with_it: Scene, question: Question) -> Iterator[tuple[float, float]]:
    """Greatest relative changes of force and ratio over all films, for some phases and draws of noise."""
    for draw in range(DRAWS):
        (force, ratio), (other_force, other_ratio) = (
            _forces_and_ratios(replace(scene, seed=scene.seed + draw), question, draw * GOLDEN % 1)
            for scene in (without, with_it)
        )
        if force.all() and np.isfinite([*ratio, *other_ratio]).all() and ratio.all():  # a converter may see nothing
            yield float(abs(other_force / force - 1).max()), float(abs(other_ratio / ratio - 1).max())


def _forces_and_ratios(scene: Scene, question: Question, phase: float) -> tuple[Floats, Floats]:
    """Amplitudes of the forces under the bases [N], and each tooth's force ratio, by least squares."""
    samples, films = _volts(scene, question, phase), scene.design.films
    found = amplitudes(np.arange(samples.shape[1]) / RATE, samples, question.frequency)
    forces = found / [film.sensitivity for film in films]
    tooth, base = ([i for i, film in enumerate(films) if film.kind == kind] for kind in FILM_KINDS)
    pairs = [(i, j) for i in tooth for j in base if set(films[i].teeth) <= set(films[j].teeth)]
    with np.errstate(divide="ignore", invalid="ignore"):
        return forces[base], np.array([forces[i] / forces[j] for i, j in pairs])


def _volts(scene: Scene, question: Question = QUESTIONS[0], phase: float = 0.0, block: int = 0) -> Floats:
    """Voltages (films, n) that nodes of unlimited resolution sample, or a converter gives [V].

    phase: of the drive as it begins, in cycles. block: samples that are asked for at once, 0: all.
    """
    clock = VirtualClock()
    rig = driven(scene, question, clock)
    size, start = abs(rig.coil_voltage().amplitude[0]), round(phase * CYCLE) % CYCLE
    rig.set_voltage(Periodic(0.0, round(question.frequency * HERTZ), 0, start, np.array([1]), np.array([-1j * size])))
    clock.add(rig)
    times = (round(SETTLING * RATE) + np.arange(round(question.dwell * RATE))) * PERIOD_NS
    parts = []
    while len(times):
        clock.wait(1e-9 * (int(times[0]) - clock.now_ns()))
        count = max(1, int(np.searchsorted(times, rig.next_event_ns())))
        parts.append(_sampled(rig, times[: min(count, block or count)]))
        times = times[parts[-1].shape[1] :]
    return np.concatenate(parts, axis=1)


def _sampled(rig: Rig, times: Times) -> Floats:
    effects, seed = rig.effects, rig.scene.seed
    volts, rates = rig.film_voltages(times), rig.film_rates(times)
    for effect in effects.input:
        for film, own in enumerate(rates):
            stream = Stream(seed, effect.name, 1, 0 if effect.common else film, PERIOD_NS)
            volts[film] += effect.volts(stream, times, PERIOD_NS, own.copy)
    if effects.converter is not None:
        volts = effects.converter.convert(volts / max(RANGE_VOLTS))[0] * max(RANGE_VOLTS)
    return volts
