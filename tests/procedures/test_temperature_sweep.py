"""`palpate sweep temperature` finds what warming films add, and that the fitted trend takes it away."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.procedures.commands import procedures
from palpate.procedures.commands.options import BenchChoice
from tests.procedures.conftest import IDEAL_SCENE, Benches, Palpate, refused

SWEEP = ("sweep", "temperature")
WARM = (
    IDEAL_SCENE
    + """[effects.charge_amplifier]
[effects.load_cell]
[effects.pyroelectric]
drift = "1 mK/s"
settling = "200 s"
[effects.white_noise]
density = "0.3 µV/√Hz"
"""
)  # the noise dithers the sixteen bits of the bus


def off_by(points: list[dict[str, Any]], settling: float) -> float:
    """The farthest that an offset of a valid point is from what a charge amplifier of 1 s makes of the films' warming,
    in its standard uncertainties."""
    away = []
    for point in (each for each in points if each["valid"]):
        after = point["offset_after_s"]
        left = (math.exp(-after / settling) - math.exp(-after)) / (settling - 1)
        for film, newtons in zip(point["films"], (9.2, 150.0), strict=True):
            away.append(abs(film["offset_N"] - newtons * point["step_K"] * left) / film["offset_u"])
    assert away
    return max(away)


@pytest.mark.slow
def test_offsets_are_those_of_the_films_and_the_ratio_is_spared(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "warm.toml"
    scene.write_text(WARM)
    arguments = (
        "--seed",
        "3",  # the drive's phase, on which the error of a lock-in depends
        "--temperatures",
        "0 K, 10 K, 5 K",
        "--load",
        "4 N",
        "--dwell",
        "2 s",
        "--scene",
        str(scene),
        "--json",
        "--budget",
    )
    found = palpate(*SWEEP, *arguments).object
    assert [(p["temperature_K"], p["step_K"], p["valid"]) for p in found["points"]] == [
        (0, 0, True), (10, 10, True), (5, -5, True),
    ]  # fmt: skip
    assert off_by(found["points"], settling=200.0) < 2
    for offset, newtons in zip(found["offsets"], (9.2, 150.0), strict=True):
        assert math.exp(-12 / 200) < offset["offset_N_per_K"] / (newtons / 200) < 1
        assert 0.03 < offset["offset_u"] / offset["offset_N_per_K"] < 0.04  # the gain of a film is all rows' own
    told = [(f"offset of film {each['film']}", each["offset_N_per_K"], each["offset_u"]) for each in found["offsets"]]
    told.append(("change of the force ratio with a trend", found["ratio_per_K"], found["ratio_per_K_u"]))
    assert [(b["quantity"], b["value"], pytest.approx(b["u"], rel=1e-12)) for b in found["budgets"]] == told
    for budget, kinds in zip(found["budgets"], ("AB", "AB", "B"), strict=True):  # the gain is no reading's own
        assert "".join(component["kind"] for component in budget["components"]) == kinds
    assert [row["degrees_of_freedom"] for row in found["budgets"][0]["components"]] == [1, None]
    ratios = [p["force_ratio"] for p in found["points"]]
    assert max(ratios) / min(ratios) - 1 < 1e-3
    scatter = float(np.std(ratios, ddof=1) / np.mean(ratios))  # of noise and of the bus' bits, wherever dwells begin
    assert abs(found["largest_error_lock_in"]) > 2 * scatter
    assert abs(found["ratio_per_K"]) < found["ratio_per_K_u"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--temperatures", "0 K, 5 K"), "make 2 different changes; 3 to 50 give a slope"),
        (("--temperatures", "0 K, 5 K, 10 K, 15 K"), "make 2 different changes"),
        (("--temperatures", "0 K, 20 K, 70 K"), "temperature 70 K relative to the start is outside -20 to 40 K"),
        (("--temperatures", "0, 5, 15"), "'0' has no unit where K belongs"),
        (("--soak", "-1 s"), "soak -1 s is outside 0 to 86400 s"),
        (("--dwell", "50 ms"), "dwell 50 ms is below one cycle of 10 Hz"),
        (("--frequency", "1 kHz"), "frequency 1000 Hz is outside 0.5 to 100 Hz"),
        (("--load", "9.5 N"), "above the bench's force limit of 10 N"),
    ],
)
def test_what_cannot_be_swept_is_refused_before_a_bench_starts(
    palpate: Palpate, benches: Benches, arguments: tuple[str, str], message: str
) -> None:
    assert message in refused(palpate(*SWEEP, *arguments), benches)


def test_a_dry_run_counts_the_soak(palpate: Palpate, benches: Benches) -> None:
    found = palpate(*SWEEP, "--soak", "10 min", "--dry-run", "--json").object
    assert found["expected_seconds"] == pytest.approx(4 * 600 + 4 * 10 + 110, rel=0.05)
    assert benches == []


def test_films_that_warm_up_are_simulated_where_no_scene_is_named(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen: list[BenchChoice] = []
    monkeypatch.setattr(procedures, "measure", lambda _asked, choice, *_rest: chosen.append(choice))
    palpate(*SWEEP)
    palpate(*SWEEP, "--scene", "ideal")
    palpate(*SWEEP, "--bench", "lab.toml")
    assert [(choice.scene, choice.bench) for choice in chosen] == [
        ("humid_body", None), ("ideal", None), (None, Path("lab.toml")),
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "settling"), [("humid_body", 850.0), ("everything", 300.0), ("long_drift", 1e5)])
def test_every_scene_whose_films_warm_up_gives_what_each_change_adds_and_no_other_drift(
    palpate: Palpate, scene: str, settling: float
) -> None:
    """An amplifier's offset by damp is 1.6 N of the tooth's film, where 5 K add 0.05 N."""
    changes = ("--temperatures", "0.5 K, -4.5 K, 10.5 K, 10.5 K", "--soak", "1 min", "--dwell", "0.4 s")
    points = palpate(*SWEEP, *changes, "--scene", scene, "--json").object["points"]
    assert [point["step_K"] for point in points] == [0.5, -5, 15, 0]
    assert off_by(points, settling) < 2
    assert sum(point["valid"] for point in points) >= 3
