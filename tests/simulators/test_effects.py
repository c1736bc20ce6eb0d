"""Each effect does what it says, nothing at zero strength, and nothing to the others."""

from __future__ import annotations

import ast
import itertools
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import ConfigError
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators import effects
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.load_indicator import SimulatedStrainIndicator
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.physics.effect import Effect, SourceEffect
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.shares import first_of
from tests.simulators.measured import volts
from tests.simulators.rigs import BALANCE, MS, SECOND, STRONG, an_effect, pressed, scene, shaken

SIMULATORS = Path(__file__).parents[2] / "simulators"


def seen(
    effects: Mapping[str, Effect], seed: int = 1, node_id: int = 1, design: str = "single", count: int = 1000
) -> tuple[bytes, list[float]]:
    """Some samples a millisecond apart with their flags, and the indicator's readings, after two load sets."""
    rig = shaken(effects, amplitude=1.0, design=design, seed=seed)
    clock = rig.clock
    clock.wait(0.3)
    pressed(rig, "2", BALANCE + 7e-3, 2.0)
    node = SimulatedSensorNode(clock, node_id, 1, rig)
    indicator = SimulatedStrainIndicator(clock, "SIM-SI-0001", rig)
    times = clock.now_ns() + np.arange(1, count + 1) * MS
    samples = node.sample(times, node.film_channels @ rig.film_voltages(times), MS)
    readings = []
    for _ in range(max(count // 200, 1)):
        clock.wait(0.1)
        readings.append(indicator.read("reading_float"))
    return samples.counts.tobytes() + samples.saturation.tobytes(), readings


def test_nobody_else_asks_for_an_effect_by_its_name_or_its_type() -> None:
    names, asked = EFFECTS.keys() - {"hysteresis", "current_limit"}, []  # a kind of effect, and a register
    for file in (path for path in SIMULATORS.rglob("*.py") if path.parent.name != "effects"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            match node:
                case ast.Constant(value=str(text)) if text in names:
                    asked.append(f"{file.name}:{node.lineno} {text}")
                case ast.Call(func=ast.Name(id="isinstance"), args=[_, asked_for]) if file.name != "effect.py":
                    if re.search(r"\w+Effect\b", ast.unparse(asked_for)):
                        asked.append(f"{file.name}:{node.lineno} {ast.unparse(node)}")
    assert asked == []


# --- the shape of an effect ----------------------------------------------------------------------------


def test_an_effect_whose_class_has_another_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EFFECTS, "glue_loss", EFFECTS["adc"])
    with pytest.raises(ConfigError, match="'glue_loss': its class Adc is named after 'adc'; rename one of them"):
        effect_class("glue_loss")


def test_the_effects_of_this_test_are_all_there_are() -> None:
    assert list(STRONG) == list(EFFECTS)


# --- absent, present, together -------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, effect in STRONG.items() if effect.kind != "timing"])
def test_an_effect_that_is_called_for_changes_something(name: str) -> None:
    beside = {"charge_amplifier": STRONG["charge_amplifier"]} if name == "humidity_leak" else {}  # nothing else leaks
    design = "common_base" if name == "crosstalk" else "single"
    assert seen({**beside, name: STRONG[name]}, design=design) != seen(beside, design=design)


NOTHING: dict[str, Effect] = {
    "amplifier_clip": an_effect("amplifier_clip", rail="1 kV"),
    "current_limit": an_effect("current_limit", limit="1 kA"),
    "end_stops": an_effect("end_stops", travel="1 m"),
    "curve_error": an_effect("curve_error", constant=0.0, spread=0.0),
    "mounting_scatter": an_effect("mounting_scatter", scatter=0.0),
    "viscoelastic": an_effect("viscoelastic", g=(0.0,), tau=("1 s",)),
    "crosstalk": an_effect("crosstalk", compliant=0.0),
    "glue_clamping": an_effect("glue_clamping", factor=1.0),
    "off_axis": an_effect("off_axis", angle="0 deg"),
    "gain_scatter": an_effect("gain_scatter", strength=0.0),
    "pyroelectric": an_effect("pyroelectric", drift="0 K/s"),
    "triboelectric": an_effect("triboelectric", charge="0 C"),
    "white_noise": an_effect("white_noise", density="0 V/√Hz"),
    "pink_noise": an_effect("pink_noise", density="0 V/√Hz"),
    "jitter": an_effect("jitter", delay="0 s"),
}


@pytest.mark.parametrize("nothing", [{name: effect} for name, effect in NOTHING.items()], ids=list(NOTHING))
@pytest.mark.parametrize("others", [(), ("charge_amplifier", "adc", "load_cell")])
def test_zero_strength_is_absent_bit_for_bit(nothing: dict[str, Effect], others: tuple[str, ...]) -> None:
    beside = {name: STRONG[name] for name in others}
    design = "common_base" if "crosstalk" in nothing else "single"
    assert seen({**beside, **nothing}, design=design) == seen(beside, design=design)


def test_a_16_bit_converter_gives_the_counts_that_travel_without_one() -> None:
    assert seen({"adc": an_effect("adc", bits=16)}) == seen({})


def test_another_seed_changes_every_random_effect() -> None:
    for name in ("white_noise", "gain_scatter", "load_cell"):
        assert seen({name: STRONG[name]}, seed=1) != seen({name: STRONG[name]}, seed=2), name
    for name in ("charge_amplifier", "adc"):
        assert seen({name: STRONG[name]}, seed=1) == seen({name: STRONG[name]}, seed=2), name


@pytest.mark.parametrize("name", EFFECTS)
def test_adding_an_effect_leaves_the_random_numbers_of_the_others_unchanged(name: str) -> None:
    """Films with no force on them show the noise alone, static readings the indicator's noise alone."""

    def noise(effects: Mapping[str, Effect]) -> tuple[Floats, float, Floats]:
        clock = VirtualClock()
        rig = Rig(replace(scene(), effects=effects), clock)
        rig.mount(SAMPLES["2"])
        clock.wait(1.234)
        node = SimulatedSensorNode(clock, 3, 1, rig)
        times = clock.now_ns() + np.arange(1, 501) * MS
        samples = node.sample(times, node.film_channels @ rig.film_voltages(times), MS)
        reading = SimulatedStrainIndicator(clock, "SIM-SI-0001", rig).read("reading_float")
        return samples.counts.astype(float), reading, rig.film_system().d[:, 0]

    base = {each: STRONG[each] for each in ("white_noise", "gain_scatter", "load_cell") if each != name}
    own, added = {name: STRONG[name]}, {**base, name: STRONG[name]}
    (plain, zero, gains), (counts, reading, scattered) = noise({}), noise(base)
    (own_counts, own_reading, own_gains), (all_counts, all_reading, all_gains) = noise(own), noise(added)
    steps = 2 * 2.0 ** (16 - STRONG["adc"].bits) if name == "adc" else 2.0  # each of the four is rounded
    assert np.abs((all_counts - own_counts) - (counts - plain)).max() <= steps
    assert all_reading - own_reading == pytest.approx(reading - zero, abs=1e-9)
    if isinstance(STRONG[name], SourceEffect):
        assert all_gains - own_gains == pytest.approx(scattered - gains, rel=1e-12)
    else:
        assert all_gains / own_gains == pytest.approx(scattered / gains, rel=1e-12)
    assert name == "white_noise" or np.abs(counts - plain).std() > 5


# --- gain scatter --------------------------------------------------------------------------------------


DRAWS = 20_000  # a standard deviation of them is known to 0.5 %


@pytest.mark.parametrize("design", first_of(["common_base", "array"]))
def test_gains_of_20_000_sets_scatter_as_films_teeth_and_sensor_are_stated_to(design: str) -> None:
    chosen, stream, effect = get_design(design), Stream(1, "gain_scatter"), an_effect("gain_scatter")
    gains = np.array([effect.matrix(chosen, stream, 1000 * number).diagonal() for number in range(DRAWS)])
    covariance = np.array(chosen.scatter_covariance)
    assert gains.mean(axis=0) == pytest.approx(1.0, abs=4 * 0.125 / math.sqrt(DRAWS))
    assert gains.std(axis=0) == pytest.approx(np.sqrt(covariance.diagonal()), rel=0.02)
    assert gains.std(axis=0) == pytest.approx([film.scatter for film in chosen.films], rel=0.02)
    stated = covariance / np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
    assert np.corrcoef(gains.T) == pytest.approx(stated, abs=4 / math.sqrt(DRAWS))
    small = 1 + (gains - 1) / 10  # so that a quotient is linear, as what is stated is
    by_name = dict(zip([film.name for film in chosen.films], small.T, strict=True))
    bases = [film for film in chosen.films if film.kind == "total"]
    teeth = np.array([
        by_name[film.name] / by_name[next(base.name for base in bases if film.teeth[0] in base.teeth)]
        for film in chosen.films
        if film.kind == "rigid"
    ])  # fmt: skip
    assert 10 * teeth.std(axis=1) == pytest.approx(np.sqrt(np.array(chosen.tooth_covariance).diagonal()), rel=0.02)
    assert 10 * teeth.mean(axis=0).std() == pytest.approx(chosen.ratio_scatter, rel=0.02)


def test_strength_scales_the_scatter_and_load_sets_draw_independently() -> None:
    single, stream = get_design("single"), Stream(1, "gain_scatter")
    once, thrice = (
        np.array(
            [an_effect("gain_scatter", strength=s).matrix(single, stream, n * SECOND).diagonal() for n in range(2000)]
        )
        for s in (1.0, 3.0)
    )
    assert np.allclose(thrice - 1, 3 * (once - 1), rtol=1e-12, atol=1e-15)
    for film in once.T:
        assert abs(np.corrcoef(film[1:], film[:-1])[0, 1]) < 4 / np.sqrt(2000)


# --- noise, converter, indicator -----------------------------------------------------------------------


@pytest.mark.parametrize("rate", [200.0, 1000.0, 10_000.0])
def test_white_noise_has_its_density_at_any_sample_rate(rate: float) -> None:
    period = round(1e9 / rate)
    noise, times = an_effect("white_noise", density="2 µV/√Hz"), period * np.arange(40_000)
    volts = noise.volts(Stream(1, "white_noise", 1, 0), times, period, lambda: np.zeros(len(times)))
    assert volts.std() == pytest.approx(2e-6 * np.sqrt(rate / 2), rel=4 / np.sqrt(80_000))
    spectrum = np.abs(np.fft.rfft(volts)) ** 2 * 2 / (rate * len(volts))  # one-sided, V2/Hz
    for band in np.array_split(spectrum[1:-1], 10):
        assert np.sqrt(band.mean()) == pytest.approx(2e-6, rel=0.05)


def test_white_noise_is_independent_between_channels_and_nodes() -> None:
    counts: dict[tuple[int, int], Floats] = {}
    for node_id in (1, 2):
        data, _ = seen({"white_noise": an_effect("white_noise", density="1 mV/√Hz")}, node_id=node_id)
        quiet, _ = seen({}, node_id=node_id)
        difference = np.frombuffer(data[:8000], "<i2").astype(float) - np.frombuffer(quiet[:8000], "<i2")
        with_films = difference.reshape(-1, 4)[:, :2]
        counts |= {(node_id, channel): column for channel, column in enumerate(with_films.T)}
    for one, other in itertools.combinations(counts.values(), 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / np.sqrt(1000)
    assert all(column.std() > 10 for column in counts.values())


@pytest.mark.parametrize("bits", [4, 12, 16])
def test_the_converter_rounds_to_its_steps_and_flags_what_it_cuts(bits: int) -> None:
    step = 2.0 ** (1 - bits)
    fraction = np.array([0.0, 0.49 * step, 0.51 * step, -1.0, -1.0 - 0.4 * step, 1.0 - step, 1.0 - 0.6 * step])
    values, saturated = an_effect("adc", bits=bits).convert(fraction)
    assert values.tolist() == [0.0, 0.0, step, -1.0, -1.0, 1.0 - step, 1.0 - step]
    assert not saturated.any()
    values, saturated = an_effect("adc", bits=bits).convert(np.array([1.0, 7.0, -1.0 - 0.6 * step, np.inf, -np.inf]))
    assert values.tolist() == [1.0 - step, 1.0 - step, -1.0, 1.0 - step, -1.0]
    assert saturated.all()


def test_the_display_shows_the_load_with_its_zero_noise_and_decimals() -> None:
    cell = an_effect("load_cell", zero="1.81 mV", noise="0.3 mV", decimals=4)
    shown = np.array([cell.display(20.0, Stream(1, "load_cell"), update) for update in range(4000)])
    assert shown.mean() == pytest.approx(21.81, abs=4 * 0.3 / np.sqrt(4000))
    assert shown.std() == pytest.approx(0.3, rel=0.045)
    assert cell.display(20.0, Stream(1, "load_cell"), 7) == shown[7]
    assert abs(np.corrcoef(shown[1:], shown[:-1])[0, 1]) < 4 / np.sqrt(4000)
    quiet = an_effect("load_cell", zero="1.81 mV", noise="0 mV", decimals=0)
    assert [quiet.display(mv, Stream(1, "load_cell"), 0) for mv in (0.0, 10.0, -10.0)] == [2.0, 12.0, -8.0]


# --- effects that are not called for -----------------------------------------------------------------


def poison(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Import, construction and any use of an effect raise."""
    module, class_name = EFFECTS[name].split(":")
    found = effect_class(name)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError(f"effect {name!r} was not called for")

    monkeypatch.setattr(found, "__init__", refuse)
    monkeypatch.setattr(found, "model_validate", refuse)
    monkeypatch.delattr(sys.modules[module], class_name)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(EFFECTS, name, f"{module}:{class_name}")


@pytest.mark.parametrize("name", ["ideal", "thesis_single", "everything"])
def test_a_scene_gives_the_same_bytes_where_every_effect_that_it_does_not_name_is_poison(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    clean = volts(read_scene(name), Question(dwell=0.2)).tobytes()
    unused = [effect for effect in EFFECTS if effect not in read_scene(name).file.effects]
    for effect in unused:
        poison(monkeypatch, effect)
    assert volts(read_scene(name), Question(dwell=0.2)).tobytes() == clean


def test_the_poison_works(monkeypatch: pytest.MonkeyPatch) -> None:
    found: type[Effect] = effect_class("adc")
    poison(monkeypatch, "adc")
    with pytest.raises(ImportError):
        effects.effect_class("adc")
    with pytest.raises(AssertionError, match="'adc' was not called for"):
        found()
