"""The load indicator's output on a free channel of a sensor node: the load has a waveform beside those of the films."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import palpate
from palpate.extend import Bench, LoadIndicator, Scene, SensorNode, read_scene
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.procedures.engine.listeners import Traced
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.rig import RigLoadCell
from tests.procedures.conftest import Palpate
from tests.procedures.live import served
from tests.procedures.test_live_page import Page, browser, page
from tests.procedures.test_long_dwell import PIECES, SWEEP, CutShort, cut_short

__all__ = ["browser", "cut_short", "page"]  # fixtures

AMPLIFIER = 1.0  # s
WIRED = "load_channel = 3"
TEXT = f"""
name = "wired"
purpose = "The load indicator's output is on the third channel."
design = "single"
{WIRED}

[effects.gain_scatter]

[effects.charge_amplifier]
time_constant = "{AMPLIFIER:g} s"

[effects.white_noise]

[effects.jitter]

[effects.adc]

[effects.load_cell]
"""
LOADS = (2.0, 4.0)


def written(folder: Path, text: str = TEXT) -> str:
    folder.mkdir(exist_ok=True)
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def swept(folder: Path, text: str = TEXT, **options: Any) -> palpate.Finished[Any]:
    with palpate.open_bench(scene=written(folder, text)) as bench:
        return palpate.run(palpate.LoadSweep(samples=("1",), loads=LOADS), bench, out=folder / "run", **options)


@pytest.fixture(scope="module")
def wired(tmp_path_factory: pytest.TempPathFactory) -> palpate.Finished[Any]:
    return swept(tmp_path_factory.mktemp("wired"))


def test_the_waveform_tells_the_load_that_the_indicator_reads(wired: palpate.Finished[Any]) -> None:
    for point in wired.run.points():
        assert_like(point)
        assert point["load_waveform_u"] < point["load_measured_u"] < 0.02 * point["load_N"]
    assert wired.run.events() == []


def assert_like(point: Mapping[str, Any]) -> None:
    """The waveform and the indicator must tell the same load."""
    u = math.hypot(point["load_waveform_u"], point["load_measured_u"])
    assert abs(point["load_waveform_N"] - point["load_measured_N"]) < 2.6 * u


def test_a_film_is_before_the_load_by_what_its_charge_amplifier_turns(wired: palpate.Finished[Any]) -> None:
    lead = math.degrees(math.atan(1 / (2 * math.pi * 10.0 * AMPLIFIER)))
    for point in wired.run.points():
        for film in ("rigid", "total"):
            assert abs(point[f"phase_{film}_deg"] - lead) < 2.6 * point[f"phase_{film}_u"]
            assert 0.05 < point[f"phase_{film}_u"] < 0.6 / 2.6


def test_the_waveform_is_the_output_in_volts_which_the_live_page_gets_and_films_are_sampled_as_without_it(
    tmp_path: Path,
) -> None:
    heard: list[palpate.Event] = []
    run = swept(tmp_path / "wired", listeners=[Traced(heard.append)]).run
    traces = [event.data for event in heard if event.kind == "trace"]
    assert {(*trace["films"], trace["voltage"].shape[0]) for trace in traces} == {("rigid", "total", "load", 3)}
    alone = swept(tmp_path / "alone", TEXT.replace(WIRED, "")).run
    assert run.waveform_names(1) == [*alone.waveform_names(1), "load"]
    for mine, other in zip(run.points(), alone.points(), strict=True):
        assert {name: value for name, value in mine.items() if name in other} == other
        for film in ("rigid", "total"):
            assert np.array_equal(run.waveform(mine["id"], film), alone.waveform(mine["id"], film))
        load = 1e3 * run.waveform(mine["id"], "load").astype(float)
        newtons = (load - THESIS_LOAD_CELL.zero_mV) / THESIS_LOAD_CELL.sensitivity_mV_per_N
        assert newtons.mean() == pytest.approx(2.4, abs=0.1)  # the preload
        assert np.ptp(newtons) == pytest.approx(mine["load_N"], rel=0.1)


@pytest.mark.slow
def test_it_is_drawn_over_the_force(palpate: Palpate, figures: list[Figure], tmp_path: Path) -> None:
    assert palpate("scene", "plot", written(tmp_path / "drawn"), "--quiet").status == 0
    (output,) = (axes for axes in figures[-1].axes if axes.get_ylabel() == "output (mV)")
    samples = np.asarray(output.lines[0].get_ydata(), dtype=float)
    assert np.ptp(samples) == pytest.approx(3 * THESIS_LOAD_CELL.sensitivity_mV_per_N, rel=0.05)


@pytest.mark.slow
def test_the_page_draws_it_and_triggers_on_it(page: Page, wired: palpate.Finished[Any]) -> None:
    with served(wired.folder.parent, "live", wired.folder.name) as live:
        page.driver.get(live.address)
        page.until(lambda: [row[0] for row in page.readings()] == ["rigid", "total", "load"])
        assert page.js("return document.getElementById('trigger').selectedOptions[0].text") == "load"


def test_the_output_gives_what_the_display_shows_at_each_gage_factor(tmp_path: Path) -> None:
    scene = read_scene(written(tmp_path))
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        sim.operator.place_weight(0.5)
        for gage_factor in (8.98, 4.49):
            sim.devices["strain_indicator"].turn({"gage_factor": gage_factor})
            sim.clock.wait(5.0)
            (recording,) = bench.all(SensorNode)[0].acquire_with([], 1.0)
            shown = bench.role(LoadIndicator).read().reading_mV
            assert 1e3 * recording.voltage[2].mean() == pytest.approx(shown, abs=1.0)
            assert shown > 50


@pytest.mark.slow
def test_a_run_that_ends_within_a_long_dwell_goes_on_with_the_load(
    palpate: Palpate, cut_short: CutShort, tmp_path: Path
) -> None:
    asked = (*SWEEP, "--scene", written(tmp_path / "scene"))
    assert palpate(*asked, "--out", "whole").status == 0
    cut_short(PIECES + 1)
    assert palpate(*asked, "--out", "cut").status == 130
    cut_short(0)
    assert palpate("runs", "resume", "cut", "--quiet").status == 0
    whole, cut = (palpate("runs", "show", name, "--json").object for name in ("whole", "cut"))
    assert cut["digest"] == whole["digest"]
    assert all(abs(point["load_waveform_N"] - point["load_measured_N"]) < 0.05 for point in cut["points"])
    told = palpate("runs", "check", "cut", "--json").object
    assert (told["waveforms"], told["faults"]) == (2 * 3, [])


NODES = {
    "canopennode-io": {"io": {"kind": "canopennode-io", "role": "sensor_node", "volts_per_unit": 0.5 / 32768}},
    "baumer-dsrt": {
        **{
            f"channel_{number}": {"kind": "baumer-dsrt", "role": "sensor_node", "volts_per_unit": 0.5 / 327.67,
                                  "sync_node": 4}
            for number in (1, 2, 3)
        },
        "clock": {"kind": "canopennode-io"},
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ["canopennode-io", pytest.param("baumer-dsrt", marks=pytest.mark.slow)])
def test_nodes_of_makers_sample_it_too(kind: str, tmp_path: Path) -> None:
    """The third channel is that of the third node, if each has one."""
    text = read_scene(written(tmp_path)).with_devices(NODES[kind]).to_toml()
    for point in swept(tmp_path / "makers", text).run.points():
        assert_like(point)


# --- what is wrong is told before anything is sent ---------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("load_channel = 2", "load_channel: channel 2 carries film 'total'; give a free one: 3, 4"),
        (
            "load_channel = 5",
            "load_channel: the bench has no channel 5, but 1 sensor node of 4 channels; give a free one: 3, 4",
        ),
        ("load_channel = 0", "load_channel: 0 is too small; give at least 1"),
        ("load_channel = [3, 3]", "load_channel: [3, 3] is no whole number"),
        ("load_channel = 3\nload_channel = 4", "is not TOML"),
    ],
)
def test_a_channel_that_cannot_be_is_refused_before_anything_is_sent(
    palpate: Palpate, tmp_path: Path, wrong: str, told: str
) -> None:
    scene = written(tmp_path / "wrong", TEXT.replace(WIRED, wrong))
    asked = ("sweep", "loads", "--scene", scene, "--out", "run")
    for words in (asked, (*asked, "--dry-run"), ("scene", "check", scene), ("scene", "plot", scene)):
        assert told in palpate(*words).refusal
    assert not Path("run").exists()


@pytest.mark.parametrize(
    ("without", "told"),
    [
        ({"device.strain_indicator"}, "load_channel: the bench has no load indicator, whose output it samples"),
        (
            {"device.sensor_node_1", "link.can"},
            "load_channel: the bench has no channel 3, but 0 sensor nodes; none is free; add a sensor node",
        ),
    ],
)
def test_a_bench_that_lacks_what_it_needs_is_refused(palpate: Palpate, without: set[str], told: str) -> None:
    assert palpate("new", "bench", "lab", "--quiet").status == 0
    file = Path("lab/bench.toml")
    head, *sections = file.read_text(encoding="utf-8").split("\n\n")
    kept = [section for section in sections if section[1 : section.index("]")] not in without]
    file.write_text("\n\n".join([f"{head}\n{WIRED}", *kept]), encoding="utf-8")
    assert told in palpate("sweep", "loads", "--bench", str(file), "--dry-run").complaint


# --- a real bench: its file, its wire, and a person --------------------------------------------------------


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """The scene of `sim`, and so of `lab`."""
    return read_scene(written(tmp_path / "of_the_bench"))


ON_BENCH = ("sweep", "loads", "--samples", "1", "--loads", "3 N", "--dwell", "0.5 s", "--assume-mounted", "--json")


def measured(palpate: Palpate, bench: str) -> tuple[dict[str, Any], list[str]]:
    """The point that is measured on a bench, and the messages about its load."""
    found = palpate(*ON_BENCH, "--bench", bench).object
    (point,) = found["points"]
    events = palpate("runs", "show", found["run"], "--json").object["events"]
    return point, [event["message"] for event in events if event["kind"] == "load"]


def test_a_real_bench_records_it_by_its_file(lab: str, palpate: Palpate) -> None:
    assert WIRED in Path(lab).read_text(encoding="utf-8")
    point, told = measured(palpate, lab)
    assert (point["load_waveform_N"], told) == (pytest.approx(point["load_measured_N"], rel=0.03), [])


def test_a_channel_without_the_output_is_told_and_the_point_is_kept(lab: str, palpate: Palpate) -> None:
    text = Path(lab).read_text(encoding="utf-8")
    Path(lab).write_text(text.replace(WIRED, "load_channel = 4"), encoding="utf-8")
    point, (told,) = measured(palpate, lab)
    assert point["valid"] and "check load_channel" in told


def test_an_output_that_is_too_large_for_its_channel_is_told_and_costs_no_point(
    lab: str, palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It gives 0.2 V for each mV of the display."""
    output = RigLoadCell.output
    monkeypatch.setattr(RigLoadCell, "output", lambda *of: 200 * output(*of))
    point, (told,) = measured(palpate, lab)
    assert (point["valid"], point["flags"], point["load_waveform_N"]) == (True, [], None)
    assert "is clipped" in told
