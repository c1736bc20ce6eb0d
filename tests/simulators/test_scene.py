"""Scene files: what is right is read, and what is wrong is named."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import ConfigError, RangeError, UnknownName, UsageError
from palpate.instrument.models import price_list
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import RoundParameters, get_parameter_set
from palpate.instrument.models.price_list import ModelChoice
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Load, get_sample
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import EFFECTS
from palpate.simulators.planning.settle import read_scene, with_model
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import LARGEST_SEED, Scene

HEAD = 'name = "try"\npurpose = "a test"\ndesign = "single"\n'
EVERYTHING = {
    "gain_scatter": "strength = 0.5",
    "charge_amplifier": 'time_constant = "250 ms"',
    "white_noise": 'density = "3 µV/√Hz"',
    "adc": "bits = 12",
    "load_cell": 'zero = "-1.5 mV"\nnoise = "250 µV"\ndecimals = 2',
}


def read(tmp_path: Path, text: str) -> Scene:
    path = tmp_path / "scene.toml"
    path.write_text(HEAD + text)
    return read_scene(str(path))


# --- what is right -------------------------------------------------------------------------------------


def test_every_key_and_parameter_of_the_file_arrives_in_si_units(tmp_path: Path) -> None:
    scene = read(
        tmp_path,
        'model = "column"\nseed = 77\nnodes = 3\n'
        '[rig]\nforce_constant = "5 N/A"\nsensor_position = "13 mm"\n'
        + "".join(f"[effects.{name}]\n{parameters}\n" for name, parameters in EVERYTHING.items()),
    )
    assert (scene.name, scene.purpose, scene.design.name) == ("try", "a test", "single")
    assert (scene.model, scene.seed, scene.nodes) == ("column", 77, 3)
    rig = scene.rig
    assert (rig.force_constant, rig.coil_resistance, rig.suspension_stiffness) == (5.0, 3.5, 1000.0)
    assert rig.sensor_position == pytest.approx(13e-3, rel=1e-15)
    parameters = {name: effect.model_dump() for name, effect in scene.effects.items()}
    cell = parameters.pop("load_cell")
    assert {key: cell[key] for key in ("zero", "noise", "decimals")} == {
        "zero": "-0.0015 V", "noise": "0.00025 V", "decimals": 2,
    }  # fmt: skip
    assert parameters == {
        "charge_amplifier": {
            "time_constant": "0.25 s",
            "feedback": "1000000000.0 ohm",
            "input_offset": "0.001 V",
        },
        "adc": {"bits": 12},
        "white_noise": {"density": "3e-06 V/√Hz"},
        "gain_scatter": {"strength": 0.5, "redrawn": "set"},
    }


def test_the_order_of_the_file_does_not_change_anything(tmp_path: Path) -> None:
    forces = set()
    for order in itertools.islice(itertools.permutations(EVERYTHING.items()), 0, None, 17):
        scene = read(tmp_path, "".join(f"[effects.{name}]\n{parameters}\n" for name, parameters in order))
        assert list(scene.effects) == [name for name in EFFECTS if name in EVERYTHING]
        rig = Rig(scene, VirtualClock())
        rig.mount(SAMPLES["2"])
        rig.set_position(15e-3)
        forces.add(rig.film_voltages(np.arange(0, 10**9, 10**7)).tobytes())
    assert len(forces) == 1


def test_another_seed_or_model_leaves_the_rest_and_the_original_alone() -> None:
    scene = read_scene("thesis_single")
    assert (scene.with_seed(5).seed, scene.with_seed(5).effects, scene.seed) == (5, scene.effects, 1)
    assert scene.with_seed(LARGEST_SEED).seed == LARGEST_SEED
    assert (with_model(scene, "column").model, scene.model) == ("column", "experiment")


# --- the model -----------------------------------------------------------------------------------------


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[set[float], float]]:
    """A price list that has the column below a tolerance of 1e-2 and finite elements above it; what it was asked."""
    questions: list[tuple[set[float], float]] = []

    def choose(design: Design, loads: list[Load], tolerance: float) -> ModelChoice:
        questions.append(({load.sensed.modulus for load in loads}, tolerance))
        if tolerance < 1e-6:
            raise RangeError("no model meets it")
        model = "column" if tolerance >= 1e-2 else "axisymmetric"
        return ModelChoice(model, tolerance / 2, 1e-6, f"{model} is cheap")

    monkeypatch.setattr(price_list, "choose", choose)
    return questions


@pytest.mark.parametrize(
    "text, model, tolerance, given",
    [
        ("", "column", 2e-2, None),
        ("tolerance = 0.05\n", "column", 0.05, None),  # a closed form takes none
        ("tolerance = 1e-3\n", "axisymmetric", 1e-3, 1e-3),
    ],
)
def test_auto_is_settled_when_the_scene_is_read_for_all_samples_and_says_why(
    text: str, model: str, tolerance: float, given: float | None, tmp_path: Path, asked: list[tuple[set[float], float]]
) -> None:
    scene = read(tmp_path, f'model = "auto"\n{text}')
    assert (scene.model, scene.tolerance, scene.why) == (model, given, f"{model} is cheap")
    assert asked == [({sample.modulus for sample in SAMPLES.values()}, tolerance)]


def test_what_auto_chose_is_written_so_that_the_file_gives_the_same_scene_for_ever(
    tmp_path: Path, asked: list[tuple[set[float], float]]
) -> None:
    scene = read(tmp_path, 'model = "auto"\ntolerance = 1e-3\n')
    written = tmp_path / "written.toml"
    written.write_text(scene.with_seed(9).to_toml())
    again = read_scene(str(written))
    assert (again.file.model, again.file.tolerance) == ("axisymmetric", 1e-3)
    assert (again.model, again.tolerance, again.seed) == ("axisymmetric", 1e-3, 9)


@pytest.mark.parametrize(("tolerance", "effects"), [(0.5, ["gain_scatter"]), (1e-9, ["gain_scatter", "adc"])])
def test_effects_that_were_weighed_are_written_as_they_were_found(
    tmp_path: Path, tolerance: float, effects: list[str]
) -> None:
    automatic = '[effects.gain_scatter]\n[effects.adc]\nwhen = "auto"\n'
    scene = read(tmp_path, f"tolerance = {tolerance}\n{automatic}")
    assert set(scene.effects) == set(effects)
    written = tmp_path / "written.toml"
    written.write_text(scene.to_toml())
    assert read_scene(str(written)).effects == scene.effects


def test_another_model_keeps_the_tolerance_where_it_can_meet_one(
    tmp_path: Path, asked: list[tuple[set[float], float]]
) -> None:
    scene = read(tmp_path, 'model = "auto"\ntolerance = 1e-3\n')
    assert (with_model(scene, "solid").model, with_model(scene, "solid").tolerance) == ("solid", 1e-3)
    column = with_model(scene, "column")
    assert (column.model, column.tolerance, column.why) == ("column", None, "")
    assert "tolerance" not in column.to_toml()
    assert with_model(read(tmp_path, 'model = "column"'), "auto").why == "column is cheap"


def test_finite_elements_answer_when_a_sample_is_mounted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solution = axisymmetric.solve(RoundParameters(support="rigid"), 1)
    asked: list[tuple[float, float]] = []

    def solve_at(moduli: NDArray[np.float64], tolerance: float) -> list[tuple[object, float]]:
        asked.extend((modulus, tolerance) for modulus in moduli.tolist())
        return [(solution, 1e-4)] * len(moduli)

    monkeypatch.setattr(axisymmetric, "ladder", lambda _: SimpleNamespace(solve_at=solve_at))
    rig = Rig(read(tmp_path, 'model = "axisymmetric"\ntolerance = 1e-3\n'), VirtualClock())
    assert asked == []
    rig.mount(SAMPLES["2"])
    assert asked == [(SAMPLES["2"].modulus, 1e-3)]
    rig.set_position(15e-3)
    rigid, total = rig.film_voltages(np.array([0]))[:, 0]
    assert (rigid / 5.995e-3) / (total / 68.60e-3) == pytest.approx(solution.force_ratio, rel=1e-12)


@pytest.mark.parametrize(
    "text, parts",
    [
        ('model = "column"\ntolerance = 1e-3', ["tolerance", "'column'", "0.001", "take model 'auto'"]),
        ("tolerance = 1e-3", ["tolerance", "'experiment'"]),
        ('model = "auto"\ntolerance = 1e-9', ["no model meets it"]),
        ('model = "auto"\ntolerance = 0', ["tolerance", "more than 0", "0"]),
        ('model = "auto"\ntolerance = "1e-3"', ["tolerance", "is no number", "'1e-3'"]),
        ('model = "auot"', ["unknown model 'auot' (did you mean 'auto'?)"]),
    ],
)
def test_a_tolerance_that_cannot_be_met_is_refused(
    text: str, parts: list[str], tmp_path: Path, asked: list[tuple[set[float], float]]
) -> None:
    with pytest.raises(ConfigError, match=r"scene\.toml: ") as raised:
        read(tmp_path, text)
    for part in parts:
        assert part in str(raised.value)


# --- what is wrong -------------------------------------------------------------------------------------

WRONG = {
    "not TOML": ("seed = = 1", ["is not TOML", "line 4"]),
    "an unknown key": ("sead = 1", ["sead: unknown key (did you mean 'seed'?)"]),
    "a sample, which the operator mounts": ('sample = "2"', ["sample: unknown key"]),
    "an unknown key of the rig": ('[rig]\ncoil_resistence = "3.5 ohm"', ["rig.coil_resistence", "'coil_resistance'?"]),
    "an unknown effect": (
        "[effects.charge_amplifer]",
        ["effects.charge_amplifer: unknown effect (did you mean 'charge_amplifier'?)", "white_noise"],
    ),
    "an unknown parameter": (
        '[effects.charge_amplifier]\ntime_constnt = "1 s"',
        ["effects.charge_amplifier: time_constnt: unknown key (did you mean 'time_constant'?)"],
    ),
    "a wrong unit": (
        '[effects.charge_amplifier]\ntime_constant = "1 N"',
        ["effects.charge_amplifier: time_constant", "'1 N' is in N where s belongs", "'1 s'"],
    ),
    "a number without a unit": (
        "[effects.charge_amplifier]\ntime_constant = 1.5",
        ["effects.charge_amplifier: time_constant", "1.5 needs a unit", "'1 s'"],
    ),
    "a text without a unit": (
        '[effects.charge_amplifier]\ntime_constant = "1.5"',
        ["effects.charge_amplifier: time_constant", "'1.5' has no unit", "'1 s'"],
    ),
    "a negative time constant": (
        '[effects.charge_amplifier]\ntime_constant = "-20 ms"',
        ["effects.charge_amplifier: time_constant", "is too small", "-0.02"],
    ),
    "no time constant at all": (
        '[effects.charge_amplifier]\ntime_constant = "0 s"',
        ["effects.charge_amplifier: time_constant", "is too small", "0.0"],
    ),
    "an endless time constant": (
        '[effects.charge_amplifier]\ntime_constant = "1e300 s"',
        ["effects.charge_amplifier: time_constant", "is too large", "1e+300"],
    ),
    "not a number": (
        '[effects.white_noise]\ndensity = "nan V/√Hz"',
        ["effects.white_noise: density", "is not a quantity", "nan"],
    ),
    "infinity": ('[rig]\nforce_constant = "1e999 N/A"', ["rig.force_constant", "finite", "1e999"]),
    "a negative density": ('[effects.white_noise]\ndensity = "-1 nV/√Hz"', ["density", "is too small", "-1e-09"]),
    "a truth value": ("[effects.white_noise]\ndensity = true", ["density", "needs a unit", "True"]),
    "a text for a number": ('[effects.adc]\nbits = "16"', ["effects.adc: bits", "is no whole number", "'16'"]),
    "too many bits": ("[effects.adc]\nbits = 17", ["effects.adc: bits", "16", "17"]),
    "an effect that is no table": ("[effects]\nadc = 3", ["effects.adc", "3"]),
    "no stiffness": ('[rig]\nsuspension_stiffness = "0 N/m"', ["rig.suspension_stiffness", "at least 1 N/m", "0"]),
    "an unknown model": ('model = "colum"', ["unknown model 'colum' (did you mean 'column'?)", "experiment"]),
    "a negative seed": ("seed = -1", ["seed", "0", "-1"]),
    "a seed that is too large": (f"seed = {2**63}", ["seed", str(LARGEST_SEED), str(2**63)]),
    "a fraction of a seed": ("seed = 1.5", ["seed", "is no whole number", "1.5"]),
    "a seed as text": ('seed = "1"', ["seed", "is no whole number", "'1'"]),
    "too many nodes": ("nodes = 21", ["nodes", "20", "21"]),
    "no nodes": ("nodes = 0", ["nodes", "1", "0"]),
}
IMPOSSIBLE = {
    "a rail below zero": ("amplifier_clip", 'rail = "-5 V"', ["rail", "at least 1 mV", "-5"]),
    "a limit of no current": ("current_limit", 'limit = "0 A"', ["limit", "at least 1 mA"]),
    "a stop without travel": ("end_stops", 'travel = "0 mm"', ["travel", "at least 1 µm"]),
    "a stop of glass": ("end_stops", 'stiffness = "1e12 N/m"', ["stiffness", "at most"]),
    "a massless armature": ("shaker_dynamics", 'mass = "0 kg"', ["mass", "at least 1 µkg"]),
    "a negative inductance": ("shaker_dynamics", 'inductance = "-1 mH"', ["inductance", "at least 1 nH"]),
    "damping that drives": ("shaker_dynamics", 'damping = "-2 N s/m"', ["damping", "at least 0"]),
    "damping in another unit": ("shaker_dynamics", 'damping = "2 N/m"', ["damping", "'2 N/m'", "N s/m belongs"]),
    "an accumulator of other bits": ("frequency_error", "bits = 32", ["bits", "28 or 48", "32"]),
    "a time constant that runs backwards": (
        "viscoelastic",
        'g = [0.3]\ntau = ["-20 ms"]',
        ["tau.0", "is too small", "-20 ms"],
    ),
    "shares of 1": ("viscoelastic", 'g = [0.5, 0.5]\ntau = ["1 s", "2 s"]', ["g sums to 1, not below 1"]),
    "lists of unequal length": ("viscoelastic", 'g = [0.3, 0.1]\ntau = ["1 s"]', ["g has 2 terms and tau 1"]),
    "shares without times": ("viscoelastic", "g = [0.3]", ["g and tau belong together"]),
    "a share that is no number": ("viscoelastic", 'g = [nan]\ntau = ["1 s"]', ["g.0", "nan"]),
    "an unknown material": ("viscoelastic", 'material = "bone"', ["material", "'rubber' or 'soft_tissue'", "bone"]),
    "weights without radii": ("hysteresis", "weights = [0.1, 0.2]", ["2 weights and 1 radii"]),
    "a slope below zero": ("hysteresis", 'weights = [-0.6, -0.6]\nradii = ["1 N", "2 N"]', ["slope of -0.2", "raise"]),
    "a radius of nothing": ("hysteresis", 'weights = [0.1]\nradii = ["0 N"]', ["radii.0", "at least"]),
    "glue that amplifies": ("glue_clamping", "factor = 1.5", ["factor", "at most 1", "1.5"]),
    "glue on no film": ("glue_clamping", "films = []", ["films", "at least 1"]),
    "glue on an unknown film": ("glue_clamping", 'films = ["rigd"]', ["films.0", "'rigid' or 'total'", "rigd"]),
    "near-singular crosstalk": ("crosstalk", "compliant = 0.34", ["compliant", "at most 0.24", "0.34"]),
    "a load from the side": ("off_axis", 'angle = "90 deg"', ["angle", "at most 45"]),
    "an angle without a unit": ("off_axis", 'angle = "10"', ["angle", "has no unit where deg belongs"]),
    "a drift that is infinite": ("pyroelectric", 'drift = "1e999 K/s"', ["drift", "not finite"]),
    "a drift that settles at once": ("pyroelectric", 'settling = "0 s"', ["settling", "at least"]),
    "a negative charge": ("triboelectric", 'charge = "-1 pC"', ["charge", "at least 0"]),
    "a charge in volts": ("triboelectric", 'charge = "1 mV"', ["charge", "where C belongs"]),
    "a film without capacitance": ("voltage_amplifier", 'disc = "0 pF"', ["disc", "at least 0.001 pF"]),
    "a negative cable": ("voltage_amplifier", 'cable = "-1 pF"', ["cable", "at least 0"]),
    "a leak of no resistance": ("humidity_leak", 'wet = "0 ohm"', ["wet", "at least 1 kohm"]),
    "a leak in no time": ("humidity_leak", 'over = "0 s"', ["over", "at least 1"]),
    "a negative scatter": ("gain_scatter", "strength = -1.0", ["strength", "at least 0"]),
    "no feedback": ("charge_amplifier", 'feedback = "0 ohm"', ["feedback", "at least 1 ohm"]),
}
WRONG |= {
    case: (f"[effects.{effect}]\n{text}", [f"effects.{effect}", *parts])
    for case, (effect, text, parts) in IMPOSSIBLE.items()
} | {
    "two amplifiers": (
        "[effects.voltage_amplifier]\n[effects.charge_amplifier]",
        ["charge_amplifier and effects.voltage_amplifier exclude each other"],
    )
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_scene_is_refused_with_file_key_and_value(wrong: str, tmp_path: Path) -> None:
    text, parts = WRONG[wrong]
    with pytest.raises(ConfigError) as raised:
        read(tmp_path, text)
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / 'scene.toml'}: ")
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_every_problem_of_a_file_is_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text('seed = -1\nnodes = 99\nsead = 3\ndesign = "single"\nname = "x"\n')
    with pytest.raises(ConfigError) as raised:
        read_scene(str(path))
    lines = str(raised.value).splitlines()
    assert [line.removeprefix(f"{path}: ").split(":")[0] for line in lines] == ["purpose", "seed", "nodes", "sead"]


def test_an_unknown_model_or_sample_or_a_seed_out_of_range_is_refused_outside_files_too() -> None:
    scene = read_scene("thesis_single")
    with pytest.raises(UnknownName, match=r"unknown model 'beem' \(did you mean 'beam'\?\)"):
        with_model(scene, "beem")
    with pytest.raises(UnknownName, match="unknown sample '7'; valid: 1, 2, 3, 4, 5, 6"):
        get_sample("7")
    for seed in (-1, LARGEST_SEED + 1):
        with pytest.raises(RangeError, match=f"seed {seed} is no whole number from 0 to {LARGEST_SEED}"):
            scene.with_seed(seed)
    assert issubclass(ConfigError, UsageError) and issubclass(RangeError, UsageError)


# --- parameter sets ------------------------------------------------------------------------------------


def test_a_parameter_set_goes_over_the_scenes_design_and_samples() -> None:
    scene = read_scene("thesis_single")
    fitted = with_model(scene, "surface", "identified")
    chosen = get_parameter_set("identified", "surface")
    sample = get_sample("3")
    expected = response(chosen.design(scene.design), chosen.load(sample.modulus), "surface")
    assert replace(fitted.answer(sample), stiffness=expected.stiffness) == expected
    assert fitted.answer(sample).stiffness == scene.answer(sample).stiffness  # of the sample itself
    assert fitted.answer(sample).force_ratio != with_model(scene, "surface").answer(sample).force_ratio
    assert with_model(scene, "surface").answer(sample) == with_model(scene, "surface", "physical").answer(sample)


def test_a_scenes_parameter_set_is_in_its_file_and_comes_back(tmp_path: Path) -> None:
    fitted = with_model(read_scene("thesis_single"), "surface", "identified")
    path = tmp_path / "again.toml"
    path.write_text(fitted.to_toml(), encoding="utf-8")
    assert read_scene(str(path)).design == fitted.design
    assert "parameters" not in read_scene("thesis_single").to_toml()


def test_a_parameter_set_that_the_model_has_not_is_refused_and_the_file_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"scene.*unknown parameter set of model 'column' 'identified'"):
        read(tmp_path, 'model = "column"\nparameters = "identified"')


def test_automatic_effects_are_weighed_by_the_parameter_set(tmp_path: Path) -> None:
    scene = read(tmp_path, 'model = "surface"\nparameters = "identified"\n[effects]\nadc = "auto"')
    assert scene.design.support == "rigid"
