"""`palpate accuracy`: plans of a modulus that no other beats, and `accuracy scene`: what effects are worth."""

from __future__ import annotations

import json
import math
import re
import shlex
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from palpate.extend import Question, Scene, read_scene
from palpate.simulators.planning import weights
from palpate.simulators.planning.weights import DRAWS, PriceLine, Subset, front, leaving_out, nested, priced, see, weigh
from tests.procedures.conftest import IDEAL_SCENE, Palpate, said_once
from tests.shares import first_of


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The front of sample 4, as JSON."""
    return said_once(tmp_path_factory.mktemp("front"), "accuracy", "--sample", "4")


def test_no_plan_of_the_front_beats_another(found: dict[str, Any]) -> None:
    front = found["front"]
    assert len(front) > 10
    for one, other in pairwise(front):
        assert one["seconds"] < other["seconds"] <= other["longest_s"]
        assert one["U95"] > other["U95"]


def test_shares_add_up_and_the_bench_times_are_the_plans(found: dict[str, Any]) -> None:
    costs = found["costs"]
    assert math.fsum(cost["share"] or 0.0 for cost in costs) == pytest.approx(1)
    assert math.fsum(cost["bench_s"] or 0.0 for cost in costs) == pytest.approx(found["asked"]["seconds"], abs=1e-6)
    assert math.fsum(cost["person_s"] or 0.0 for cost in costs) == pytest.approx(found["asked"]["person_s"])
    assert 60 * found["asked"]["mountings"] < found["asked"]["person_s"] < found["asked"]["seconds"]


def test_what_is_not_random_needs_little_and_doubling_it_would_hardly_show(found: dict[str, Any]) -> None:
    rows = {cost["cause"]: cost for cost in found["costs"]}
    of_all = math.sqrt(math.fsum(cost["u"] ** 2 for cost in found["costs"] if cost["u"]))
    for cause in ("discretisation", "fit", "converter"):
        assert rows[cause]["has_value"] < rows[cause]["needs_value"]
        u = 2 * found["sensitivity"] * rows[cause]["needs_value"] / math.sqrt(3)
        assert math.hypot(of_all, u) < 1.05 * of_all
    noise = rows["noise"]
    less = math.sqrt(of_all**2 + noise["u"] ** 2 * (noise["has_value"] / (noise["needs_value"] / 2) - 1))
    assert less < 1.06 * of_all
    assert rows["converter, without noise"]["has_value"] > rows["converter"]["needs_value"]


def test_a_minute_less_gives_less_and_a_minute_more_gives_more(found: dict[str, Any]) -> None:
    assert found["minute_less_U95"] > found["asked"]["U95"] > found["minute_more_U95"]
    assert found["absolute_U95"] > 1 > found["references_U95"]
    assert (found["priors"][0]["u"], found["priors"][0]["freedom"]) == (0.01, 2)


@pytest.mark.parametrize("number", first_of([-4, 0]))
def test_the_command_of_a_plan_makes_that_plan(found: dict[str, Any], palpate: Palpate, number: int) -> None:
    point = found["front"][number]
    words = shlex.split(point["command"])
    assert words[0] == "palpate"
    planned = palpate(*words[1:], "--dry-run", "--json").object["planned"]
    assert {name: planned[name] for name in ("load_N", "mountings", "sets", "dwell_s", "seconds", "longest_s")} == {
        name: point[name] for name in ("load_N", "mountings", "sets", "dwell_s", "seconds", "longest_s")
    }


@pytest.mark.slow
def test_a_plan_that_fewer_than_95_in_100_runs_finish_is_marked(palpate: Palpate) -> None:
    fine = palpate("accuracy", "--tolerance", "0.6 %", "--json").object["asked"]
    assert 0.1 < fine["reached_by"] < 0.9
    assert f"({100 * fine['reached_by']:.0f} % of runs reach it)" in palpate("accuracy", "--tolerance", "0.6 %").out
    assert re.search(r"best now  --tolerance '0\.56 %', which \d+ % of runs reach",
                     palpate("accuracy", "--tolerance", "0.1 %").out)  # fmt: skip


@pytest.mark.slow
def test_what_would_lower_the_cause_that_binds_is_told_although_the_tolerance_is_reached(palpate: Palpate) -> None:
    noisy = palpate("accuracy", "--sample", "2", "--tolerance", "8 %", "--scene", "noisy_lab").out
    assert "binds          pick-up in step with the load: tie the films' cables down" in noisy
    assert "\nbinds " not in palpate("accuracy", "--sample", "2", "--tolerance", "8 %").out


def test_a_tolerance_above_20_percent_is_told_as_the_factor_that_it_is(palpate: Palpate) -> None:
    assert "± 50 % (× 1.6): 1 min" in palpate("accuracy", "--tolerance", "50 %").out


def test_people_read_plans_causes_and_who_pays(palpate: Palpate) -> None:
    said = palpate("accuracy", "--tolerance", "10 %", "--out", "prices.png")
    assert said.status == 0
    for text in (
        "± 5 %", "± 10 %: 1 min", "of it a person's", "gain scatter", "converter",
        "a minute       29 s give no answer; 2 min 29 s give ± 8",
        "integration    not in the path: the bench steps nothing", "palpate measure modulus --sample 4 --tolerance",
        "scatter was never measured; --mountings 12 does so", "× 1.3 with 6 references (40 min 00 s, once)",
        "not calibrated: ± 9.9 % leaves their error out; with 6 points",
    ):  # fmt: skip
        assert text in said.out, said.out
    assert max(map(len, said.out.splitlines()[:-1])) <= 80
    assert said.out.splitlines()[-1] == f"plot           {Path('prices.png').absolute()}"
    assert Path("prices.png").exists()


@pytest.mark.slow
def test_the_picture_gives_a_half_width_no_other_time_than_the_table(palpate: Palpate, figures: list[Figure]) -> None:
    lines = palpate("accuracy", "--out", "prices.svg").out.splitlines()
    labels = [each.get_text().split(": ") for each in figures[0].axes[0].texts if each.get_text().startswith("±")]
    assert len(labels) > 2
    for half, lasts in labels:
        assert all(lasts in line for line in lines if line.strip().startswith(f"{half} "))


def test_a_tolerance_that_nothing_reaches_is_told_with_what_binds_and_other_ways(palpate: Palpate) -> None:
    said = palpate("accuracy", "--absolute", "--json", "--out", "prices.svg")
    front = json.loads(said.out)
    assert (said.status, front["asked"], front["costs"], front["plot"]) == (1, None, [], None)
    assert "cannot be reached: the model binds: validation leaves × 3.3" in front["why"]
    assert "--relative-to-model" in front["why"]


# --- palpate accuracy scene: what the effects of a scene are worth ------------------------------------

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
    assert (front([quick, other, near], 1.0), front([quick, other, near], 4.0)) == ([near, quick], [near, other, quick])


@pytest.mark.slow
def test_the_command_shows_each_subset_and_draws_it(palpate: Palpate, scene: str) -> None:
    found = palpate("accuracy", "scene", scene, "--out", "prices.svg", "--json").object
    assert ([each["name"] for each in found["effects"]], len(found["subsets"])) == (list(read_scene(scene).effects), 5)
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
