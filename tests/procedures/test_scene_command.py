"""palpate scene: what is shipped, what a scene holds, whether it runs, and what its waveforms look like."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from palpate.instrument.sensor.designs import get_design
from palpate.procedures.virtual import explained as drawing
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import waveforms
from palpate.simulators.scenes.heads import shipped
from tests.procedures.conftest import IDEAL_SCENE, Palpate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEAD = {"scene", "purpose", "design", "model", "parameter_set", "seed", "nodes", "effects"}


Ship = Callable[[str, str], Path]


@pytest.fixture
def ship(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Ship:
    """Puts a changed scene in the place of all that are shipped."""

    def put(old: str, new: str) -> Path:
        text, file = shipped()["ideal"].read_text(encoding="utf-8"), tmp_path / "ideal.toml"
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
        for place in ("procedures.virtual.scene_list", "simulators.planning.settle"):
            monkeypatch.setattr(f"palpate.{place}.shipped", lambda: {"ideal": file})
        return file

    return put


# --- list, show, check ---------------------------------------------------------------------------------


def test_the_list_says_of_each_scene_what_is_found_when_the_scene_is_read_whole(palpate: Palpate) -> None:
    listed, spoken = palpate("scene", "list", "--json").object["scenes"], palpate("scene", "list").out
    assert listed == [palpate("scene", "check", name, "--json").object for name in shipped()]
    assert [*map(set, listed)] == len(listed) * [HEAD]
    assert [name for name in shipped() if name not in spoken] == []


@pytest.mark.parametrize(
    ("written", "changed", "refusal"),
    [
        ('design = "single"', 'design = "singel"', "unknown design 'singel' (did you mean 'single'?)"),
        ('purpose = "', 'purpse = "', "purpose: is missing"),
        ("seed = 1", "seed = 1.5", "seed: 1.5"),
        ("seed = 1", "seed = ", "is not TOML"),
    ],
)
def test_a_damaged_file_of_a_shipped_scene_is_told_by_the_list(
    written: str, changed: str, refusal: str, palpate: Palpate, ship: Ship
) -> None:
    file = ship(written, changed)
    done = palpate("scene", "list")
    assert (done.status, done.out) == (2, "")
    assert f"{file}: " in done.err and refusal in done.err


def test_a_scene_whose_effects_are_chosen_by_calculation_is_listed_with_those_that_were_chosen(
    palpate: Palpate, ship: Ship
) -> None:
    ship("design =", 'effects.current_limit = { when = "auto", limit = "100 A" }\ndesign =')
    (listed,) = palpate("scene", "list", "--json").object["scenes"]
    assert listed == palpate("scene", "check", "ideal", "--json").object
    assert listed["effects"] == []


def test_a_shown_scene_names_every_parameter_with_its_unit_and_those_left_to_their_defaults(palpate: Palpate) -> None:
    Path("my.toml").write_text(IDEAL_SCENE + '\n[effects.jitter]\n[effects.mains_hum]\nfrequency = "60 Hz"\n')
    shown = palpate("scene", "show", "my.toml", "--json").object
    assert set(shown) == {*HEAD, "rig", "parameters"}
    assert shown["parameters"] == {
        "jitter": {"delay": "1e-05 s"},
        "adc": {"bits": 16},
        "mains_hum": {"amplitude": "0.001 V", "frequency": "60.0 Hz", "phase": 0.0},
    }
    assert shown["rig"]["suspension_stiffness"] == "1000.0 N/m"
    spoken = palpate("scene", "show", "my.toml").out
    for text in ("Everything exact", "design single, model experiment", "mains_hum", "60 Hz", "1000 N/m"):
        assert text in spoken


def test_what_is_shown_can_be_written_into_a_scene_file(palpate: Palpate) -> None:
    """Parameters are texts as the file has them, without digits of binary arithmetic."""
    for name in shipped():
        shown = palpate("scene", "show", name, "--json").object
        file = tomllib.loads(shipped()[name].read_text(encoding="utf-8"))
        assert set(file.get("effects", {})) >= set(shown["parameters"])
        assert shown["effects"] == list(shown["parameters"])
    assert "0.00181 V" in palpate("scene", "show", "thesis_single").out


def test_a_scene_that_can_be_simulated_is_checked_with_exit_status_0(palpate: Palpate) -> None:
    assert palpate("scene", "check", "array_16").out == "array_16: can be simulated\n"
    quiet = palpate("scene", "check", "array_16", "--quiet")
    assert (quiet.status, quiet.out, quiet.err) == (0, "", "")


# --- plot ----------------------------------------------------------------------------------------------


def test_a_plot_goes_where_it_is_told_and_never_over_another(palpate: Palpate) -> None:
    plot = ("scene", "plot", "ideal", "--periods", "1")
    made = palpate(*plot, "--load", "2 N", "--out", "chain.png", "--json").object
    assert {"scene", "sample", "load_N", "file"} == set(made)
    assert (made["load_N"], made["file"]) == (2.0, str(Path("chain.png").absolute()))
    assert "chain.png exists and is not overwritten" in palpate(*plot, "--out", "chain.png").complaint
    assert "does not end in .png or .svg" in palpate(*plot, "--out", "chain.pdf").complaint
    own = [palpate(*plot).out.strip() for _ in range(2)]
    assert {Path(each).parent for each in own} == {Path("runs/plots").absolute()}
    assert own[0] != own[1] and own[0].endswith("-ideal.png")
    assert palpate(*plot, "--out", "q.png", "--quiet").out == ""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--sample", "9"), "unknown sample '9'"),
        (("--load", "3"), "'3' has no unit where N belongs"),
        (("--load", "0 N"), "load 0 N is not above 0 and finite"),
        (("--frequency", "-1 Hz"), "frequency -1 Hz is not above 0 and finite"),
    ],
)
def test_a_measurement_that_cannot_be_is_refused(options: tuple[str, str], message: str, palpate: Palpate) -> None:
    assert message in palpate("scene", "plot", "ideal", *options).complaint
    assert not Path("runs").exists()


def test_the_picture_holds_every_stage_of_every_film_in_millivolts_and_marks_saturated_samples(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, _path, **_: figures.append(figure))
    design = get_design("different_base")
    seen = waveforms(read_scene("thesis_different_base"), Question(), 2)
    cut = seen.saturated.copy()
    cut[1, 3:6] = True
    drawing.draw(design, replace(seen, saturated=cut), "scene try", tmp_path / "try.png")
    assert "SIMULATED scene try" in figures[0].get_suptitle()
    coil, force, *films = figures[0].axes
    assert np.array_equal(coil.lines[0].get_ydata(), seen.coil)
    assert np.array_equal(force.lines[0].get_ydata(), seen.force)
    for row, stage in enumerate((seen.before, seen.films, seen.samples)):
        for column, numbers in enumerate(((0, 2), (1, 3))):
            for number in numbers:
                lines = {line.get_label(): line for line in films[2 * row + column].lines}
                assert np.allclose(lines[design.films[number].name].get_ydata(), 1e3 * stage[number])
    (marks,) = [line for axes in films for line in axes.lines if line.get_label() == "saturated"]
    assert np.array_equal(marks.get_xdata(), 1e3 * seen.sample_time[3:6])
