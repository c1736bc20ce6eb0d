"""Effects and designs that palpate knows nothing of: scenes name them, plans weigh them, and a lie is caught."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from palpate import ConfigError, PalpateError, get_design
from palpate.extend import BenchDescription, Design, Scene, Stream, read_scene
from palpate.instrument.arrays import Floats, Times
from palpate.instrument.config import check
from palpate.procedures.lab.about import added_by
from palpate.procedures.virtual import study_cell
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.effects.jitter import Jitter
from palpate.simulators.effects.mains_hum import MainsHum
from palpate.simulators.effects.off_axis import OffAxis
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.effects.white_noise import WhiteNoise
from palpate.simulators.physics.effect import Bound, Case, Effect, FilmsEffect, Kind, Rates
from palpate.simulators.planning.plan import Question, plan
from palpate.testing import EffectConformance
from tests.conftest import Install
from tests.procedures.conftest import Palpate
from tests.procedures.test_study import threads

QUESTION = Question("2", 3.0, dwell=0.5)
SCENE = 'name = "mine"\npurpose = "Mine."\ndesign = "single"\n'
WET_GLUE = """
from typing import ClassVar
import numpy as np
from pydantic import Field
from palpate.instrument.quantity import Seconds
from palpate.simulators.physics.effect import FilmsEffect

class WetGlue(FilmsEffect):
    kind: ClassVar = "lti"
    cancels_in_ratio: ClassVar[bool] = True
    loss: float = Field(default=0.1, ge=0, lt=1, strict=True)
    dried: Seconds = Field(default=0.0, ge=0)

    def matrix(self, design, stream, set_at_ns):
        return (1 - self.loss) * np.eye(len(design.films))
"""


@pytest.fixture
def wet_glue(install: Install) -> None:
    install("acme", "palpate.effects", {"wet_glue": "wet_glue:WetGlue"}, wet_glue=WET_GLUE)


def scene_of(effects: str, folder: Path) -> Scene:
    path = folder / "mine.toml"
    path.write_text(SCENE + effects, encoding="utf-8")
    return read_scene(str(path))


@pytest.mark.usefixtures("wet_glue")
def test_a_scene_names_it_with_quantities_and_says_whose_it_is(tmp_path: Path) -> None:
    scene = scene_of('[effects.wet_glue]\nloss = 0.2\ndried = "3 ms"\n[effects.adc]\n', tmp_path)
    assert (list(scene.effects), scene.called["wet_glue"]) == (["adc", "wet_glue"], "called for, from acme 1.2")
    assert scene.effects["wet_glue"].model_dump() == {"loss": 0.2, "dried": "0.003 s"}
    assert [each.name for each in plan(scene, QUESTION).included] == ["adc", "wet_glue"]
    automatic = scene_of('[effects.wet_glue]\nwhen = "auto"\n', tmp_path)
    assert automatic.called["wet_glue"].startswith("can change force by 0.1")
    with pytest.raises(ConfigError, match=r"mine.toml: effects.wet_glue: dried: .*needs a unit"):
        scene_of("[effects.wet_glue]\ndried = 3.0\n", tmp_path)
    with pytest.raises(
        ConfigError, match=r"effects.wet_glu: unknown effect \(did you mean 'wet_glue'\?\); valid: .*adc"
    ):
        scene_of('[effects]\nwet_glu = "on"\n', tmp_path)


@pytest.mark.usefixtures("wet_glue")
def test_a_study_names_package_and_version_and_does_not_go_on_with_another(
    palpate: Palpate, install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_cell, "executor_of", threads)
    scene_of("[effects.wet_glue]\n", Path())
    study = 'name = "glued"\nloads = "2 N"\n[axes]\nscene = ["mine.toml"]\nsample = ["1"]\n'
    Path("glued.toml").write_text(study, encoding="utf-8")
    assert palpate("study", "glued.toml", "--quiet").status == 0
    monkeypatch.setattr(study_cell, "packages_of", lambda *_: {"acme": "1.3"})
    refused = "holds another study: packages.acme is '1.2' there and '1.3' here; choose another --out"
    assert refused in palpate("study", "glued.toml").complaint


@pytest.mark.usefixtures("wet_glue")
def test_a_plan_weighs_it_where_it_is_left_out_and_names_one_that_cannot_be(install: Install, tmp_path: Path) -> None:
    install("odd", "palpate.effects", {"odd": "odd_effects:Odd", "lost": "no_such:Lost"}, odd_effects="Odd = 3")
    found = plan(scene_of("", tmp_path), QUESTION)
    (left,) = [each for each in found.omitted if each.name == "wet_glue"]
    assert (left.force, left.ratio) == (pytest.approx(0.1), pytest.approx(0.0, abs=1e-12))
    lost, odd = found.warnings[-2:]
    assert "effect 'lost' of odd 1.2 (no_such:Lost): cannot be loaded" in lost
    assert "effect 'odd' of odd 1.2 (odd_effects:Odd): is no Effect whose class is named after 'odd'" in odd


WRONG = {
    "from palpate.simulators.physics.effect import Effect as Glue\nclass WetGlue(Glue): ...": "inherits from none of",
    WET_GLUE.replace('kind: ClassVar = "lti"', ""): "does not say its kind (lti, static_nl, ",
    WET_GLUE.replace("default=0.1, ", ""): "cannot be made with the defaults of its parameters: ",
    WET_GLUE.replace("def matrix", "def matrices"): "cannot be made with .*abstract",
    WET_GLUE.replace("loss: float", "losses: list[float] = [0.0]\n    loss: float"): "cannot be made .*unhashable",
    WET_GLUE.replace("class WetGlue", "class WetGlues")
    + "WetGlue = WetGlues": "is no Effect whose class is named after",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_cannot_be_an_effect_is_refused(text: str, install: Install, tmp_path: Path) -> None:
    install("acme", "palpate.effects", {"wet_glue": "wet_glue:WetGlue"}, wet_glue=text)
    why = WRONG[text].replace("(", r"\(")
    with pytest.raises(ConfigError, match=rf"^effect 'wet_glue' of acme 1.2 \(wet_glue:WetGlue\): {why}"):
        scene_of("[effects.wet_glue]\n", tmp_path)


def test_two_effects_at_a_place_where_only_one_can_act_are_refused(install: Install, tmp_path: Path) -> None:
    text = (
        "from palpate.simulators.effects.charge_amplifier import ChargeAmplifier\n"
        "class SlowAmplifier(ChargeAmplifier):\n    excludes = ()\n"
    )
    install("acme", "palpate.effects", {"slow_amplifier": "slow:SlowAmplifier"}, slow=text)
    with pytest.raises(ConfigError, match=r"charge_amplifier and effects\.slow_amplifier exclude each other"):
        scene_of("[effects.slow_amplifier]\n[effects.charge_amplifier]\n", tmp_path)
    assert [*scene_of("[effects.slow_amplifier]\n", tmp_path).effects] == ["slow_amplifier"]


# --- effects that lie about themselves -------------------------------------------------------------------


class Modest(OffAxis):
    """Says that it changes nothing."""

    def known_bound(self, case: Case) -> Bound:
        return Bound(0.0, 0.0)


class Fickle(FilmsEffect):
    """Draws gains and does not say so."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        return np.diag(1 + 0.1 * stream.normal(set_at_ns // 1000, len(design.films)))


class Loud(WhiteNoise):
    """Understates its noise."""

    def error(self, case: Case, rates: Rates) -> float:
        return 0.01 * super().error(case, rates)


class Quiet(WhiteNoise):
    """Boasts of noise that would make a converter's steps average out."""

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        return np.zeros(len(time_ns))


class Hidden(WhiteNoise):
    """Understates what it adds to a sample."""

    def largest(self, case: Case, rates: Rates) -> float:
        return 0.1 * super().largest(case, rates)


class Alike(Modest):
    """Says that it cancels in the ratio."""

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        return np.diag(np.linspace(1.0, 0.9, len(design.films)))


def suite(effect: Effect) -> EffectConformance:
    found = EffectConformance()
    found.effect = effect  # type: ignore[misc]
    return found


GAINS = "test_gains_that_are_drawn_anew_for_a_load_set_say_so_by_their_scatter"
NOISE = "test_its_noise_is_as_strong_and_as_weak_as_it_says"
CANCELS = "test_where_it_says_so_it_cancels_in_the_ratio"


@pytest.mark.parametrize(
    ("effect", "test", "message"),
    [
        (Fickle(), GAINS, "gains differ, and `scatter` is None"),
        (Quiet(density="100 µV/√Hz"), NOISE, "V in each sample, 0 V are white"),
        (Hidden(density="100 µV/√Hz"), NOISE, ""),
        (Alike(), CANCELS, ""),
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_an_effect_that_says_what_is_not_so_is_caught(effect: Effect, test: str, message: str) -> None:
    with pytest.raises(AssertionError, match=message or None):
        getattr(suite(effect), test)()


@pytest.mark.parametrize("effect", [Modest(), Loud(density="100 µV/√Hz")], ids=lambda effect: effect.name)
def test_an_effect_that_changes_more_than_its_bound_is_caught(effect: Effect) -> None:
    with pytest.raises(AssertionError, match="more than its bound"):
        suite(effect).hold_bound(effect, {}, QUESTION)


def test_an_honest_effect_passes() -> None:
    suite(OffAxis()).hold_bound(OffAxis(), {}, QUESTION)
    for effect, test in [(OffAxis(), CANCELS), (OffAxis(), GAINS), (GainScatter(), GAINS)]:
        getattr(suite(effect), test)()
    for noise in (WhiteNoise(), MainsHum(), PinkNoise(), Jitter(delay="1 ms")):
        getattr(suite(noise), NOISE)()


# --- a sensor design of a package ---------------------------------------------------------------------

WIDE = """
from dataclasses import replace
from palpate.instrument.sensor.designs import SINGLE
DESIGN = replace(SINGLE, name="wide", ring=replace(SINGLE.ring, outer_radius=4.5e-3), thesis_force_ratio={})
"""
ODD = """
from wide_designs import DESIGN, replace
DESIGN = replace(DESIGN, name="odd", films=DESIGN.films[:1])
"""


@pytest.fixture
def wide(install: Install) -> None:
    places = {"wide": "wide_designs:DESIGN", "odd": "odd_designs:DESIGN"}
    install("acme", "palpate.designs", places, wide_designs=WIDE, odd_designs=ODD)


@pytest.mark.usefixtures("wide")
def test_a_scene_and_a_bench_name_it_and_a_record_says_whose_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\npurpose = "Mine."\ndesign = "wide"\nmodel = "column"\n', encoding="utf-8")
    scene = read_scene(str(path))
    assert scene.design.ring.outer_radius == 4.5e-3
    with SimulatedBench(scene) as sim:
        assert (sim.description.design, added_by(sim.description, scene)) == ("wide", {"acme": "1.2"})
        tables = sim.description.model_dump(mode="json", exclude_none=True)
    with pytest.raises(ConfigError, match=r"bench.toml: design: .*unknown design 'wine' \(did you mean 'wide'\?\)"):
        check({**tables, "design": "wine"}, BenchDescription, "bench.toml")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("lost", r"^design 'lost' of lost 1.2 \(no_such_designs:LOST\): cannot be loaded"),
        ("other", r"^design 'other' of lost 1.2 .*is no Design that is called 'other'"),
        ("odd", r"^design 'odd' of acme 1.2 .*RangeError: design 'odd': film 'rigid': there must"),
        ("none", r"valid: .*single, .*wide"),
    ],
)
@pytest.mark.usefixtures("wide")
def test_what_cannot_be_a_design_is_refused_and_hinders_no_other(name: str, why: str, install: Install) -> None:
    install("lost", "palpate.designs", {"lost": "no_such_designs:LOST", "other": "wide_designs:DESIGN"})
    with pytest.raises(PalpateError, match=why):
        get_design(name)
    assert get_design("wide").name == "wide"
