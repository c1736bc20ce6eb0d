"""palpate accuracy scene: what the effects of a scene are worth."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.simulators.planning import weights
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.weights import DRAWS, PriceLine, Subset, front, leaving_out, nested, priced, see, weigh
from palpate.simulators.scenes.scene import Scene
from tests.procedures.conftest import IDEAL_SCENE, Palpate

SCENE = IDEAL_SCENE + (
    '\n[effects.gain_scatter]\n[effects.white_noise]\ndensity = "20 µV/√Hz"\n[effects.load_cell]\n[effects.crosstalk]\n'
)

ONE = PriceLine(1.0, 0.1, 1.0, 0.1)


@pytest.fixture(autouse=True)
def few_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer rounds than a price needs: how good it is is asked elsewhere."""
    monkeypatch.setattr(weights, "FEWEST", 2)
    monkeypatch.setattr(weights, "SMALL", np.inf)


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("four.toml").write_text(SCENE)
    return "four.toml"


@pytest.mark.slow
def test_each_effect_is_left_out_by_what_it_changes_and_all_are_measured_together(scene: str) -> None:
    read = read_scene(scene)
    weighed = weigh(read, Question())
    changes = {each.name: each.change for each in weighed}
    assert changes["load_cell"] is None  # the films do not show the indicator
    assert changes["crosstalk"] == 0  # a single sensor has no neighbour
    assert 0 < (changes["white_noise"] or 0) < (changes["gain_scatter"] or 0)
    tried = nested(read, Question(), weighed)
    assert [each.without[-1:] for each in tried] == [(), ("adc",), ("crosstalk",), ("white_noise",), ("gain_scatter",)]
    assert tried[0].change == tried[1].change == 0
    assert tried[-2].ratio == pytest.approx(changes["white_noise"], rel=0.2)  # it stands there almost alone
    again = nested(read, Question(), weighed)  # the same seed gives the same changes
    assert [replace(each, price=ONE) for each in tried] == [replace(each, price=ONE) for each in again]


def test_the_change_is_the_root_mean_square_over_draws_of_the_same_seeds(scene: str) -> None:
    read = read_scene(scene)
    by_hand = []
    for seed in range(read.seed, read.seed + DRAWS):
        ratios = [
            see(each.with_seed(seed), Question(), draws=1).ratios[0, 0]
            for each in (read, leaving_out(read, ["white_noise"]))
        ]
        by_hand.append(ratios[1] / ratios[0] - 1)
    (found,) = [each for each in weigh(read, Question()) if each.name == "white_noise"]
    assert found.ratio == pytest.approx(np.sqrt(np.mean(np.square(by_hand))), rel=1e-12)


def test_an_effect_costs_what_it_adds(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each effect takes 1 ms, on a machine that stands for the function whose time is taken, and for its clock."""
    now = 0.0

    def sampled(scene: Scene, *_: object) -> None:
        nonlocal now
        now += 1e-3 * len(scene.effects)

    monkeypatch.setattr(weights, "films_sampled", sampled)
    monkeypatch.setattr(time, "process_time", lambda: now)
    found = {name: round(1e3 * each.a_s, 9) for name, each in priced(read_scene(scene), Question()).items()}
    assert found == {"": 5, "gain_scatter": 1, "white_noise": 1, "crosstalk": 1, "adc": 1}


def test_the_front_leaves_out_what_is_neither_nearer_nor_quicker() -> None:
    """What is spent once does not count as much the longer the dwell."""
    near = Subset((), 0.0, 0.0, PriceLine(3.0, 0.1, 0.0, 0.1))
    other = Subset(("a",), 0.1, 0.0, PriceLine(4.0, 0.1, -0.5, 0.1))
    quick = Subset(("a", "b"), 0.0, 0.2, PriceLine(1.0, 0.1, 0.0, 0.1))
    assert front([quick, other, near], 1.0) == [near, quick]
    assert front([quick, other, near], 4.0) == [near, other, quick]


@pytest.mark.slow
def test_the_command_shows_each_subset_and_draws_it(palpate: Palpate, scene: str) -> None:
    found = palpate("accuracy", "scene", scene, "--out", "prices.svg", "--json").object
    assert [each["name"] for each in found["effects"]] == list(read_scene(scene).effects)
    assert len(found["subsets"]) == 5
    assert found["subsets"][0]["front"] in (True, False)
    assert list(found["subsets"][0]["price"]) == ["a_s", "u_a_s", "b_s_per_s", "u_b_s_per_s"]
    assert Path(found["plot"]).exists()
    spoken = palpate("accuracy", "scene", scene).out
    assert "SIMULATED" in spoken and "the films do not show what they change: load_cell" in " ".join(spoken.split())


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (("nowhere",), "unknown scene 'nowhere'"),
        (("four.toml", "--sample", "9"), "unknown sample '9'"),
        (("four.toml", "--dwell", "10 ms"), "record at least"),
        (("four.toml", "--dwell", "1 h", "--frequency", "200 Hz"), "are more than 2e+07, which are held at once"),
    ],
)
def test_what_cannot_be_weighed_is_refused(palpate: Palpate, scene: str, asked: tuple[str, ...], message: str) -> None:
    said = palpate("accuracy", "scene", *asked)
    assert said.status
    assert message in said.complaint
