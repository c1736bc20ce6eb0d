"""palpate scene: what is shipped, what a scene holds, whether it runs, and what its waveforms look like."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.virtual import explained as drawing
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import Waveforms, waveforms
from palpate.simulators.scenes.heads import shipped
from tests.procedures.conftest import IDEAL_SCENE, Palpate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEAD = {"scene", "purpose", "design", "model", "parameter_set", "seed", "nodes", "effects"}


# --- list, show, check ---------------------------------------------------------------------------------


def test_the_list_names_every_shipped_scene_with_its_purpose(palpate: Palpate) -> None:
    scenes = palpate("scene", "list", "--json").object["scenes"]
    assert [scene["scene"] for scene in scenes] == list(shipped())
    for scene in scenes:
        assert set(scene) == HEAD
    for name in shipped():
        assert name in palpate("scene", "list").out


def test_the_list_says_of_each_scene_what_is_found_when_the_scene_is_read_whole(palpate: Palpate) -> None:
    listed = palpate("scene", "list", "--json").object["scenes"]
    assert listed == [palpate("scene", "check", name, "--json").object for name in shipped()]


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
    written: str, changed: str, refusal: str, palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "ideal.toml"
    text = shipped()["ideal"].read_text(encoding="utf-8")
    assert written in text
    file.write_text(text.replace(written, changed), encoding="utf-8")
    for place in ("procedures.virtual.scene_list", "simulators.planning.settle"):
        monkeypatch.setattr(f"palpate.{place}.shipped", lambda: {"ideal": file})
    done = palpate("scene", "list")
    assert (done.status, done.out) == (2, "")
    assert f"{file}: " in done.err and refusal in done.err


def test_a_scene_whose_effects_are_chosen_by_calculation_is_listed_with_those_that_were_chosen(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "ideal.toml"
    file.write_text(
        f'{shipped()["ideal"].read_text(encoding="utf-8")}\n[effects.current_limit]\nwhen = "auto"\nlimit = "100 A"\n'
    )
    for place in ("procedures.virtual.scene_list", "simulators.planning.settle"):
        monkeypatch.setattr(f"palpate.{place}.shipped", lambda: {"ideal": file})
    listed = palpate("scene", "list", "--json").object["scenes"]
    assert listed == [palpate("scene", "check", "ideal", "--json").object]
    assert listed[0]["effects"] == []


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


def test_a_shown_parameter_has_no_digits_of_binary_arithmetic(palpate: Palpate) -> None:
    assert "0.00181 V" in palpate("scene", "show", "thesis_single").out


def test_what_is_shown_can_be_written_into_a_scene_file(palpate: Palpate) -> None:
    """Parameters are texts as the file has them."""
    for name in shipped():
        shown = palpate("scene", "show", name, "--json").object
        file = tomllib.loads(shipped()[name].read_text(encoding="utf-8"))
        assert set(file.get("effects", {})) >= set(shown["parameters"])
        assert shown["effects"] == list(shown["parameters"])


@pytest.mark.parametrize("name", ["thesis_single", "array_16"])
def test_a_scene_that_can_be_simulated_is_checked_with_exit_status_0(name: str, palpate: Palpate) -> None:
    assert set(palpate("scene", "check", name, "--json").object) == HEAD
    assert palpate("scene", "check", name).out == f"{name}: can be simulated\n"
    quiet = palpate("scene", "check", name, "--quiet")
    assert (quiet.status, quiet.out, quiet.err) == (0, "", "")


WRONG = {
    "no such scene": ("thesis_singel", "unknown scene 'thesis_singel' (did you mean 'thesis_single'?)"),
    "no such file": ("absent.toml", "absent.toml: cannot be read: No such file or directory"),
    "an unknown effect": ("effect.toml", "effect.toml: effects.hum: unknown effect"),
    "a wrong unit": ("unit.toml", "unit.toml: effects.mains_hum: frequency: '50 V' is in V where Hz belongs"),
    "too few nodes": ("nodes.toml", "nodes.toml: nodes: 1 cannot take the 17 films of design 'array_16'"),
    "a sample that the model does not answer for": ("model.toml", "nothing was measured with design 'array_16'"),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("command", ["show", "check", "plot"])
def test_a_wrong_scene_is_one_clear_error(wrong: str, command: str, palpate: Palpate) -> None:
    for name, old, new in (
        ("effect", "effects.adc", "effects.hum"),
        ("unit", "[effects.adc]", '[effects.mains_hum]\nfrequency = "50 V"'),
        ("nodes", 'design = "single"', 'design = "array_16"\nmodel = "column"\nnodes = 1'),
        ("model", 'design = "single"', 'design = "array_16"'),
    ):
        Path(f"{name}.toml").write_text(IDEAL_SCENE.replace(old, new))
    scene, message = WRONG[wrong]
    if (wrong, command) == ("a sample that the model does not answer for", "show"):
        assert palpate("scene", command, scene).status == 0  # nothing is asked of the model
        return
    spoken = palpate("scene", command, scene)
    assert spoken.status == 2
    assert message in spoken.complaint


# --- plot ----------------------------------------------------------------------------------------------


def test_a_plot_goes_where_it_is_told_and_never_over_another(palpate: Palpate) -> None:
    made = palpate("scene", "plot", "ideal", "--load", "2 N", "--periods", "1", "--out", "chain.png", "--json").object
    assert {"scene", "sample", "load_N", "file"} == set(made)
    assert (made["load_N"], made["file"]) == (2.0, str(Path("chain.png").absolute()))
    assert (
        "chain.png exists and is not overwritten" in palpate("scene", "plot", "ideal", "--out", "chain.png").complaint
    )
    assert "does not end in .png or .svg" in palpate("scene", "plot", "ideal", "--out", "chain.pdf").complaint
    of_its_own = palpate("scene", "plot", "ideal", "--periods", "1").out.strip()
    assert of_its_own.endswith("-ideal.png") and Path(of_its_own).parent == Path("runs/plots").absolute()
    assert palpate("scene", "plot", "ideal", "--out", "q.png", "--quiet").out == ""


def test_two_plots_of_a_scene_in_the_same_second_are_two(palpate: Palpate) -> None:
    """Each second of the coming five minutes has a plot already."""
    plots, now = Path("runs/plots"), datetime.now(UTC)
    plots.mkdir(parents=True)
    for second in range(300):
        (plots / f"{now + timedelta(seconds=second):%Y%m%dT%H%M%SZ}-ideal.png").touch()
    assert palpate("scene", "plot", "ideal", "--periods", "1").out.strip().endswith("Z-ideal-2.png")


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


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[Design, Waveforms], Figure]:
    """Draws waveforms and keeps the figure in place of the file."""
    figures: list[Figure] = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, _path, **_: figures.append(figure))

    def draw(design: Design, seen: Waveforms) -> Figure:
        drawing.draw(design, seen, "scene try", tmp_path / "try.png")
        return figures[-1]

    return draw


def test_the_picture_holds_every_stage_of_every_film_in_millivolts(
    drawn: Callable[[Design, Waveforms], Figure],
) -> None:
    design = get_design("different_base")
    seen = waveforms(read_scene("thesis_different_base"), Question(), 2)
    figure = drawn(design, seen)
    assert "SIMULATED scene try" in figure.get_suptitle()
    coil, force, *films = figure.axes
    assert np.array_equal(coil.lines[0].get_ydata(), seen.coil)
    assert np.array_equal(force.lines[0].get_ydata(), seen.force)
    for row, stage in enumerate((seen.before, seen.films, seen.samples)):
        for column, numbers in enumerate(((0, 2), (1, 3))):
            axes = films[2 * row + column]
            for line, number in zip(axes.lines, numbers, strict=True):
                assert line.get_label() == design.films[number].name
                assert np.allclose(line.get_ydata(), 1e3 * stage[number])


def test_saturated_samples_are_marked(drawn: Callable[[Design, Waveforms], Figure]) -> None:
    seen = waveforms(read_scene("ideal"), Question(), 1)
    cut = seen.saturated.copy()
    cut[1, 3:6] = True
    rigid, total = drawn(get_design("single"), replace(seen, saturated=cut)).axes[-2:]
    assert [line.get_label() for line in rigid.lines] == ["rigid"]
    assert [line.get_label() for line in total.lines] == ["total", "saturated"]
    assert np.array_equal(total.lines[1].get_xdata(), 1e3 * seen.sample_time[3:6])
