"""--fidelity: a simulated command leaves out the effects that its result does not feel."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate import Run, UsageError, get_sample
from palpate.extend import Question, read_scene
from palpate.procedures.lab import chosen as chosen_module
from palpate.procedures.lab.chosen import Chosen, at_fidelity, choose
from palpate.procedures.lab.lab import Dwells
from palpate.simulators.planning.weights import changes, reduced, see
from tests.procedures.conftest import IDEAL_SCENE, Palpate
from tests.shares import first_of

SCENE = IDEAL_SCENE + (
    '\n[effects.gain_scatter]\n[effects.white_noise]\n[effects.load_cell]\nzero = "0 mV"\n[effects.charge_amplifier]\n'
)
SWEEP = ("sweep", "loads", "--samples", "2", "--loads", "2 N, 3 N", "--scene", "five.toml")


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("five.toml").write_text(SCENE)


@pytest.mark.parametrize(
    ("most", "left_out"),
    first_of(
        [
            (1e-2, {"adc", "charge_amplifier", "white_noise"}),
            (1e-5, {"adc"}),
            (0.9, {"adc", "charge_amplifier", "white_noise", "gain_scatter"}),
        ]
    ),
)
def test_what_is_left_out_changes_no_answer_by_more_than_the_fidelity(most: float, left_out: set[str]) -> None:
    whole, asked = read_scene("five.toml"), [(Question("2"), 0.0), (Question("6", 4.0), 300.0)]
    found = reduced(whole, most, asked)
    assert set(found.file.left_out or ()) == left_out == set(whole.effects) - set(found.effects)
    for question, start in asked:
        force, ratio = changes(see(whole, question, start), see(found, question, start))
        assert max(force.max(), ratio.max()) <= most


@pytest.mark.slow
def test_a_run_says_what_was_left_out_and_goes_on_without_it(palpate: Palpate) -> None:
    done = palpate(*SWEEP, "--fidelity", "1e-2", "--out", "day", "--json")
    assert "--fidelity 0.01 leaves out of scene ideal: " in done.err
    assert (done.object["fidelity"], sorted(done.object["left_out"])) == (
        0.01,
        ["adc", "charge_amplifier", "white_noise"],
    )
    header = Run.open(Path("day")).header["scene"]
    assert isinstance(header, dict) and header["fidelity"] == 0.01
    again = read_scene("day/scene.toml")
    assert list(again.effects) == ["gain_scatter", "load_cell"] and again.file.fidelity == 0.01
    assert Run.open(Path("day")).digest() != Run.open(Path(palpate(*SWEEP, "--json").object["run"])).digest()
    twice = palpate(*SWEEP, "--fidelity", "1e-2", "--json").object["run"]
    assert Run.open(Path(twice)).digest() == Run.open(Path("day")).digest()


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ((*SWEEP, "--fidelity", "0"), "--fidelity: '0' is not above 0"),
        ((*SWEEP, "--fidelity", "1.5"), "--fidelity: '1.5' is 150 %, above the 50 %"),
        (("sweep", "frequency", "--scene", "five.toml", "--fidelity", "1e-3"), "comes from more than load sets"),
        (("sweep", "loads", "--loads", "200 N", "--fidelity", "1e-3", "--dry-run"), "200 N"),
    ],
)
def test_a_fidelity_that_says_nothing_is_refused(palpate: Palpate, asked: tuple[str, ...], message: str) -> None:
    said = palpate(*asked)
    assert said.status
    assert message in said.complaint


def test_a_real_bench_leaves_nothing_out() -> None:
    with pytest.raises(UsageError, match="a real bench leaves nothing out"):
        at_fidelity(Chosen(None, None), 1e-3, "sweep-loads", None, 0.0)


def test_each_load_of_each_object_is_asked_and_the_least_one_at_the_end_of_the_run_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[Question, float]] = []
    monkeypatch.setattr(chosen_module, "reduced", lambda scene, _fidelity, asked: seen.extend(asked) or scene)
    dwells = Dwells([get_sample("2"), get_sample("6")], (4.0, 9.0), 10.0, 1.0)
    at_fidelity(choose(None, "five.toml"), 1e-3, "sweep-loads", dwells, 77.0)
    assert [(question.pressed.name, question.load, start) for question, start in seen] == [
        ("2", 4.0, 0.0), ("2", 9.0, 0.0), ("6", 4.0, 0.0), ("6", 9.0, 0.0), ("2", 4.0, 77.0)
    ]  # fmt: skip


def test_a_scene_file_does_not_choose_a_fidelity(palpate: Palpate) -> None:
    Path("own.toml").write_text("fidelity = 1e-3\n" + SCENE)
    said = palpate("scene", "check", "own.toml")
    assert said.status
    assert "give --fidelity to a command instead" in said.complaint
