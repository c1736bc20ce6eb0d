"""Numbers that no bench has: a scene with one is refused by name, and what still cannot be computed is told once."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import tomli_w

import palpate as package
from palpate.instrument.errors import BenchError, ConfigError
from palpate.simulators.clock import VirtualClock
from palpate.simulators.planning.plan import Question, driven
from palpate.simulators.planning.settle import read_scene
from tests.conftest import Install
from tests.hostile_scenes import cases
from tests.procedures.conftest import IDEAL_SCENE, Palpate, scene_of

SMALL = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
# in which every effect, and every key of a fault, stands once
EVERYTHING = ("everything", "with voltage_amplifier", "fault film_drift", "fault babbling_node", "fault emergency")


@pytest.mark.slow
def test_a_number_that_no_bench_has_is_refused_in_one_line_or_can_be_computed_with(tmp_path: Path) -> None:
    file, refused = tmp_path / "hostile.toml", 0
    tried = [case for case in cases() if case.scene in EVERYTHING]
    for case in tried:
        file.write_text(tomli_w.dumps(dict(case.content)), encoding="utf-8")
        try:
            read_scene(str(file))
            assert not case.value or 1e-30 <= abs(case.value) <= 1e30, case  # 0, or of a size that a bench may have
        except ConfigError as error:
            assert str(error).startswith(f"{file}: ") and "\n" not in str(error), case
            refused += 1
    assert 500 < refused < len(tried)


@pytest.mark.parametrize(
    ("key", "value", "limit"),
    [
        ("coil_resistance", "1e-308 ohm", "is too small; give at least 1 mohm"),
        ("coil_resistance", "1e308 ohm", "is too large; give at most 1 Mohm"),
        ("force_constant", "1e308 N/A", "is too large; give at most 10 kN/A"),
        ("suspension_stiffness", "1e-308 N/m", "is too small; give at least 1 N/m"),
        ("sensor_position", "1e308 m", "is too large; give at most 1 m"),
    ],
)
def test_a_part_of_the_shaker_that_nobody_can_build_is_refused_with_its_limit(
    key: str, value: str, limit: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(f'{IDEAL_SCENE}[rig]\n{key} = "{value}"\n', encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml").refusal
    assert said.startswith(f"my.toml: rig.{key}: ") and limit in said


WET_GLUE = """
from typing import ClassVar
import numpy as np
from pydantic import Field
from palpate.simulators.physics.effect import FilmsEffect

class WetGlue(FilmsEffect):
    kind: ClassVar = "lti"
    cancels_in_ratio: ClassVar[bool] = True
    loss: float = Field(default=0.1, strict=True)

    def matrix(self, design, stream, set_at_ns):
        if set_at_ns > 65_000_000_000:  # while it is driven, so in the thread of the simulated devices
            raise OverflowError("glue everywhere")
        return (1 - self.loss) * np.eye(len(design.films))
"""


@pytest.fixture
def wet_glue(install: Install) -> str:
    install("acme", "palpate.effects", {"wet_glue": "wet_glue:WetGlue"}, wet_glue=WET_GLUE)
    return f"{IDEAL_SCENE}[effects.wet_glue]\n"


@pytest.mark.parametrize("loss", ["1e-308", "-1e308", "1e31"])
def test_an_effect_of_another_package_has_no_number_that_cannot_be_computed_with(
    loss: str, wet_glue: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(f"{wet_glue}loss = {loss}\n", encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml")
    assert said.complaint == (
        f"my.toml: effects.wet_glue: loss = {float(loss):g} is no size that can be computed with; give 0, or 1e-30 to "
        "1e+30 of either sign"
    )


def test_what_fails_in_a_simulated_device_is_told_once_and_by_whom_and_a_script_gets_the_first_cause(
    wet_glue: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(wet_glue, encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml", "--out", "run")
    assert said.status == 1
    assert said.complaint.startswith("acme 1.2: WetGlue.matrix failed: OverflowError: glue everywhere")
    sweep: Any = package.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.2)
    first = pytest.raises(BenchError, match="the scene cannot be simulated: OverflowError: glue everywhere; look for")
    with first, package.open_bench(scene="my.toml") as bench:
        package.run(sweep, bench, out="script")


def test_a_clock_that_failed_says_so_to_whoever_waits() -> None:
    clock = VirtualClock()
    told = clock.failed(ZeroDivisionError("float division by zero"))
    assert clock.failed(ValueError("a later one")) is not told
    with pytest.raises(BenchError, match="cannot be simulated: ZeroDivisionError: float division by zero"):
        clock.wait(1.0)
    assert clock.now_ns() == 0


def test_ctrl_c_also_ends_what_the_simulation_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    given_up = Mock()
    monkeypatch.setattr(VirtualClock, "give_up_soon", given_up)
    with pytest.raises(KeyboardInterrupt), package.open_bench(scene="ideal"):
        assert not given_up.called
        signal.raise_signal(signal.SIGINT)
    assert given_up.call_count == 1


def test_a_motion_is_followed_no_further_than_somebody_wants(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = scene_of(f'{IDEAL_SCENE}[effects.current_limit]\nlimit = "10 mA"\n', tmp_path)
    clock = VirtualClock()
    rig = driven(scene, Question("1", 3.0), clock)
    monkeypatch.setattr("palpate.simulators.clock.PATIENCE", -1.0)
    clock.give_up_soon()
    with pytest.raises(BenchError, match="the simulation was interrupted"):
        rig.transitions(1_000_000_000)
    assert math.isfinite(rig.settled_for_ns())
