"""--fidelity: a simulated command leaves out the effects that its result does not feel."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.procedures.records.run import Run
from palpate.simulators.planning.fidelity import reduced
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.weights import changes, see
from tests.procedures.conftest import IDEAL_SCENE, Palpate

SCENE = IDEAL_SCENE + (
    '\n[effects.gain_scatter]\n[effects.white_noise]\n[effects.load_cell]\nzero = "0 mV"\n[effects.charge_amplifier]\n'
)
SMALL = {"charge_amplifier", "white_noise"}  # their changes are below 1e-2
SWEEP = ("sweep", "loads", "--samples", "2", "--loads", "2 N, 3 N", "--scene", "five.toml")


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("five.toml").write_text(SCENE)


@pytest.mark.parametrize(
    ("fidelity", "left_out"),
    [
        (1e-5, {"adc"}),
        (1e-2, {"adc", "charge_amplifier", "white_noise"}),
        (0.9, {"adc", "charge_amplifier", "white_noise", "gain_scatter"}),
    ],
)
def test_what_is_left_out_changes_no_answer_by_more_than_the_fidelity(fidelity: float, left_out: set[str]) -> None:
    whole, asked = read_scene("five.toml"), [(Question("2"), 0.0), (Question("6", 4.0), 300.0)]
    found = reduced(whole, fidelity, asked)
    assert set(found.file.left_out or ()) == left_out == set(whole.effects) - set(found.effects)
    for question, start in asked:
        force, ratio = changes(see(whole, question, start), see(found, question, start))
        assert max(force.max(), ratio.max()) <= fidelity


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
        ((*SWEEP[:-2], "--bench", "five.toml", "--fidelity", "1e-3"), "five.toml"),
        (("sweep", "frequency", "--scene", "five.toml", "--fidelity", "1e-3"), "comes from more than load sets"),
        (("sweep", "loads", "--loads", "200 N", "--fidelity", "1e-3", "--dry-run"), "200 N"),
    ],
)
def test_a_fidelity_that_says_nothing_is_refused(palpate: Palpate, asked: tuple[str, ...], message: str) -> None:
    said = palpate(*asked)
    assert said.status
    assert message in said.complaint


def test_a_scene_file_does_not_choose_a_fidelity(palpate: Palpate) -> None:
    Path("own.toml").write_text("fidelity = 1e-3\n" + SCENE)
    said = palpate("scene", "check", "own.toml")
    assert said.status
    assert "give --fidelity to a command instead" in said.complaint
