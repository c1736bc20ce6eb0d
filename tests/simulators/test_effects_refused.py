"""Impossible parameters of effects: one message that names the parameter, the value and the limit."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.errors import ConfigError
from palpate.simulators.planning.settle import read_scene

HEAD = 'name = "try"\npurpose = "a test"\ndesign = "single"\n'

WRONG = {
    "a rail below zero": ("amplifier_clip", 'rail = "-5 V"', ["rail", "at least 1 mV", "-5"]),
    "a limit of no current": ("current_limit", 'limit = "0 A"', ["limit", "at least 1 mA"]),
    "a stop without travel": ("end_stops", 'travel = "0 mm"', ["travel", "at least 1 µm"]),
    "a stop of glass": ("end_stops", 'stiffness = "1e12 N/m"', ["stiffness", "at most"]),
    "a massless armature": ("shaker_dynamics", 'mass = "0 kg"', ["mass", "at least 1 µkg"]),
    "a negative inductance": ("shaker_dynamics", 'inductance = "-1 mH"', ["inductance", "at least 1 nH"]),
    "damping that drives": ("shaker_dynamics", 'damping = "-2 N s/m"', ["damping", "at least 0"]),
    "damping in another unit": ("shaker_dynamics", 'damping = "2 N/m"', ["damping", "'2 N/m'", "N s/m belongs"]),
    "an accumulator of other bits": ("frequency_error", "bits = 32", ["bits", "28 or 48", "32"]),
    "a negative time constant": (
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


@pytest.mark.parametrize("case", WRONG)
def test_an_impossible_parameter_is_refused_by_its_name_and_limit(tmp_path: Path, case: str) -> None:
    effect, text, expected = WRONG[case]
    path = tmp_path / "scene.toml"
    path.write_text(f"{HEAD}[effects.{effect}]\n{text}\n")
    with pytest.raises(ConfigError) as refused:
        read_scene(str(path))
    for part in (f"effects.{effect}", *expected):
        assert part in str(refused.value)


def test_the_two_amplifiers_exclude_each_other(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f"{HEAD}[effects.voltage_amplifier]\n[effects.charge_amplifier]\n")
    with pytest.raises(ConfigError, match=r"charge_amplifier and effects\.voltage_amplifier exclude each other"):
        read_scene(str(path))
