"""`palpate scene`: what is shipped, what a scene holds, how it is simulated, and what its waveforms look like."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from palpate import get_design
from palpate.extend import Question, Scene, read_scene
from palpate.procedures.virtual import explained
from palpate.procedures.virtual import explained as drawing
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.planning import plan as planning
from palpate.simulators.planning.waveforms import waveforms
from palpate.simulators.planning.weights import PriceLine, Weight
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
    assert ([*map(set, listed)], [name for name in shipped() if name not in spoken]) == (len(listed) * [HEAD], [])


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
    assert (listed, listed["effects"]) == (palpate("scene", "check", "ideal", "--json").object, [])


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


# --- how a scene is simulated -------------------------------------------------------------------------

NOISY = IDEAL_SCENE + '\n[effects.white_noise]\ndensity = "20 µV/√Hz"\n'
PLAYED = NOISY + '\n[effects.hysteresis]\nweights = [0.1]\nradii = ["50 mN"]\n'

PRICES = {
    "": PriceLine(12.63e-3, 0.2e-3, 94.2e-6, 3e-6),
    "hysteresis": PriceLine(7.24e-3, 0.2e-3, 13e-6, 6e-6),
    "white_noise": PriceLine(0.1e-3, 0.11e-3, 8.2e-6, 2e-6),
}


@pytest.fixture
def cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds of what is left out take most of a plan's time, and prices the rest."""
    monkeypatch.setattr(planning, "omissions", lambda *_: ([], []))
    monkeypatch.setattr(explained, "priced", lambda *_: PRICES)


def unweighed(scene: Scene, _question: Question, more: Sequence[str], _progress: object) -> list[Weight]:
    """What effects change takes a part of the time that only some tests look at."""
    return [Weight(name, None, None) for name in (*scene.effects, *more)]


# --- what is said --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_object_holds_path_cost_effects_in_and_effects_out_with_their_bounds(palpate: Palpate) -> None:
    found = palpate("scene", "explain", "thesis_single", "--load", "4 N", "--prices", "--json").object
    assert set(found) == {
        "scene", "model", "parameter_set", "mark", "path", "why", "transitions", "included", "omitted", "warnings",
        "steady", "price", "faults", "measured", "unmeasured",
    }  # fmt: skip
    assert (found["scene"], found["model"], found["mark"]) == ("thesis_single", "experiment", 1e-4)
    assert (found["path"], found["transitions"], found["steady"]) == ("closed form", 0.0, None)
    assert found["why"] == "it is proven for each limit of the bench that the drive does not reach it"
    own = read_scene("thesis_single").effects
    assert [(each["name"], each["kind"], each["why"]) for each in found["included"]] == [
        (name, effect_class(name).kind, "called for") for name in own
    ]
    assert 0 < found["price"]["u_a_s"] < found["price"]["a_s"]
    bounds = {each["name"]: (each["force"], each["ratio"]) for each in found["omitted"]}
    assert set(bounds) == set(EFFECTS) - set(own)
    assert all(0 <= bounds[name][k] < 1 for name in ("off_axis", "glue_clamping") for k in (0, 1))
    assert bounds["can_timing"] == (0.0, 0.0)
    assert bounds["end_stops"] == (None, None)  # 4 N takes the armature further than 8 mm
    measured = {each["name"]: each for each in found["measured"]}
    assert set(measured) == set(EFFECTS)
    assert measured["gain_scatter"]["ratio"] == pytest.approx(0.041, rel=0.5)  # the ratio's scatter, of a few draws
    assert measured["load_cell"]["ratio"] is measured["load_cell"]["price"] is None  # the films do not show it
    for name, most in bounds.items():
        changes = zip((measured[name]["force"], measured[name]["ratio"]), most, strict=True)
        assert all(change is None or limit is None or change <= limit + 1e-12 for change, limit in changes), name


def test_the_text_marks_bounds_above_the_given_change_and_no_others(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explained, "weigh", unweighed)
    Path("quiet.toml").write_text(NOISY)
    for mark, marked in (("1e-4", True), ("0.5", False)):
        spoken = palpate("scene", "explain", "quiet.toml", "--mark", mark).out
        assert f"(* above {float(mark):g})" in " ".join(spoken.split())
        lines = {line.split()[0]: line for line in spoken.splitlines() if line.split()}
        assert ("*" in lines["off_axis"]) is marked
        assert lines["end_stops"].split()[:4] == ["end_stops", "static_nl", "0.0e+00", "0.0e+00"]


@pytest.mark.usefixtures("cheap")
def test_the_text_says_path_reason_time_what_is_in_with_kind_cost_and_reason_and_the_faults(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    auto = '\n[effects.off_axis]\nwhen = "auto"\nangle = "30 deg"\n'
    fault = '[[fault]]\non = "sensor_node_1"\nkind = "node_reboot"\nat = "3 s"\n'
    Path("played.toml").write_text(PLAYED + auto + fault)
    spoken = palpate("scene", "explain", "played.toml", "--prices").out
    assert "path: transitions: play operators move" in spoken
    words = " ".join(spoken.split())
    assert "40 transitions a second, 12.6 ms of processor time and 94 µs for each second of bench" in words
    lines: dict[str, list[str]] = {}
    for line in filter(None, map(str.split, spoken.splitlines())):
        lines.setdefault(line[0], line)  # the column on its own, of a table that is wider than 80, comes later
    assert lines["hysteresis"][1:4] == ["hysteresis", "no", "0.0e+00"] and float(lines["hysteresis"][4]) > 1e-3
    assert lines["white_noise"][1:3] == ["additive", "no"] and 0 < float(lines["white_noise"][3]) < 1e-2
    prices = [lines["hysteresis"][5:7], lines["white_noise"][5:8], lines["adc"][5:7]]
    assert prices == [["7.2", "13"], ["<", "0.3", "8"], ["-", "-"]]
    assert "fault: on sensor_node_1, kind node_reboot, at 3 s" in spoken and "settled" not in spoken
    monkeypatch.setattr(explained, "weigh", unweighed)
    found = palpate("scene", "explain", "played.toml", "--json").object
    why = {each["name"]: each["why"] for each in found["included"]}
    assert why["adc"] == "called for"
    assert why["off_axis"].startswith("can change force by 0.1") and why["off_axis"].endswith("above 0.0001")
    assert [each["kind"] for each in found["faults"]] == ["node_reboot"]


@pytest.mark.usefixtures("cheap")
def test_the_settled_state_is_shown_with_force_and_ratio_of_each_film_where_it_is_asked_for(palpate: Palpate) -> None:
    Path("played.toml").write_text(PLAYED)
    asked = ("scene", "explain", "played.toml", "--sample", "1", "--load", "2 N", "--steady")
    found = palpate(*asked, "--json").object
    assert (found["path"], found["steady"]["force"]) == ("describing function", pytest.approx(2.0, rel=1e-9))
    rigid, total = found["steady"]["films"]
    assert 0.316 < rigid["ratio"] < 0.35 and total["ratio"] is None
    spoken = palpate(*asked).out
    assert "path: describing function" in spoken
    assert "settled, at 2 N peak to peak on the load cell" in spoken
    assert f"{1e3 * rigid['amplitude']:.6g}" in spoken and f"{rigid['ratio']:.6g}" in spoken


@pytest.mark.usefixtures("cheap")
def test_a_signal_below_20_steps_with_little_noise_is_a_warning_and_with_strict_an_error(palpate: Palpate) -> None:
    Path("few.toml").write_text(IDEAL_SCENE)
    small = ("scene", "explain", "few.toml", "--load", "0.5 N")
    spoken, refused = palpate(*small), palpate(*small, "--strict")
    assert (spoken.status, "warning: film 'rigid': amplitude" in spoken.out) == (0, True)
    assert (refused.status, "scene 'few.toml': film 'rigid': amplitude" in refused.complaint) == (2, True)
    Path("quiet.toml").write_text(NOISY)
    assert palpate("scene", "explain", "quiet.toml", "--strict").status == 0


def test_no_bound_is_given_of_a_dwell_that_no_sine_can_be_fitted_to(palpate: Palpate) -> None:
    Path("quiet.toml").write_text(NOISY)
    found = palpate("scene", "explain", "quiet.toml", "--dwell", "10ms", "--json").object
    assert all(each["ratio"] is None for each in found["measured"]) == bool(found["unmeasured"])
    bounds = {each["name"]: (each["force"], each["ratio"]) for each in found["omitted"]}
    assert bounds["mains_hum"] == bounds["off_axis"] == bounds["charge_amplifier"] == (None, None)
    assert bounds["can_timing"] == (0.0, 0.0)


# --- what is refused -----------------------------------------------------------------------------------
