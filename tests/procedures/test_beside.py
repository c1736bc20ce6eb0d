"""A field of any device of the bench is read beside each point, of every procedure, without a line for it there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import palpate
from palpate.extend import Scene, read_scene
from tests.drivers.benches import installed
from tests.procedures.conftest import Palpate

SCENE = """
name = "beside"
purpose = "An oven of another package stands beside the sensor."
design = "single"

[effects.white_noise]

[device.oven]
kind = "acme-oven"
"""
ROOM = """
[beside.room]
device = "oven"
field = "temperature"
unit = "degC"
u = 0.3
"""
SWEEP = palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.5)


def scene_with(tmp_path: Path, *tables: str) -> Path:
    tmp_path.mkdir(exist_ok=True)
    path = tmp_path / "scene.toml"
    path.write_text("\n".join((SCENE, *tables)), encoding="utf-8")
    return path


def swept(tmp_path: Path, *tables: str) -> palpate.Finished[Any]:
    with installed("oven"), palpate.open_bench(scene=scene_with(tmp_path, *tables)) as bench:
        return palpate.run(SWEEP, bench, out=tmp_path / "run")


def test_a_device_of_another_package_is_read_beside_each_point_and_told_everywhere(
    tmp_path: Path, palpate: Palpate
) -> None:
    with installed("oven"):
        chosen = ("--scene", str(scene_with(tmp_path, ROOM)), "--out", str(tmp_path / "run"))
        found = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", *chosen, "--json").object
        assert [(p["beside_room_degC"], p["beside_room_degC_u"]) for p in found["points"]] == [(20.0, 0.3)] * 2
        (told,) = found["beside"]
        assert (told["name"], told["mean"], told["unit"], told["u"], told["readings"]) == ("room", 20.0, "degC", 0.3, 2)
        export = ("runs", "export", str(tmp_path / "run"), "--to", "csv", "--out", str(tmp_path / "csv"), "--json")
        assert palpate(*export).object["files"] == [
            str(tmp_path / "csv" / f"{of}.csv") for of in ("points", "waveforms")
        ]
        assert "beside_room_degC" in (tmp_path / "csv" / "points.csv").read_text().splitlines()[0]
        report = palpate("runs", "report", str(tmp_path / "run"), "--json").object
        assert report["runs"][0]["warning"] is None
        page = Path(report["report"]).read_text(encoding="utf-8")
        assert re.search("20 degC .u 0.3., [a-z_]+ of oven", page) and "beside_room_degC" in page
        weights = ("--scene", str(scene_with(tmp_path, ROOM)), "--out", str(tmp_path / "cell"))
        assert "beside         room 20 degC (u 0.3)" in palpate("calibrate", "load-cell", *weights).out
    report = palpate("runs", "report", str(tmp_path / "run"), "--json").object  # where its package is not installed
    assert "oven" in report["runs"][0]["warning"]
    assert "beside_room_degC" in Path(report["report"]).read_text(encoding="utf-8")
    assert "| room | 20 degC (u 0.3) |" in (tmp_path / "cell" / "certificate.md").read_text(encoding="utf-8")


def test_the_plot_has_a_panel_for_what_is_read_beside_each_point(tmp_path: Path, figures: list[Figure]) -> None:
    swept(tmp_path, ROOM).plot()
    _, _, room = figures[0].axes
    assert room.get_ylabel() == "room (degC; bars: u)"
    (bars,) = room.collections
    assert [[y for _, y in segment] for segment in bars.get_segments()] == [[19.7, 20.3]] * 2


def test_a_point_outside_the_limits_is_marked_or_not_used_as_the_file_says(tmp_path: Path) -> None:
    marked = swept(tmp_path / "marked", ROOM, "high = 19.5").result.points
    assert [(point.valid, point.flags) for point in marked] == [(True, ("surroundings",))] * 2
    with pytest.raises(palpate.EstimateError, match="what was read beside the point is outside its limits"):
        swept(tmp_path / "invalid", ROOM, 'high = 19.5\noutside = "invalidate"')
    run = palpate.read(tmp_path / "invalid" / "run")
    assert [point["valid"] for point in run.points()] == [False, False]
    assert [event["message"] for event in run.events() if event["kind"] == "beside"] == [
        "room is 20 degC, the limit is at most 19.5 degC"
    ] * 2


def test_the_point_is_kept_where_a_device_beside_it_is_silent_and_one_reading_serves_all_points_of_an_interval(
    tmp_path: Path,
) -> None:
    """The oven falls silent between the two points."""
    silent = '[[fault]]\nkind = "no_reply"\non = "oven"\nat = "89 s"\nlasts = "1000 s"'
    each, once = (swept(tmp_path / name, ROOM, every, silent) for name, every in (("1", ""), ("2", 'every = "1000 s"')))
    assert [[point["beside_room_degC"] for point in done.run.points()] for done in (each, once)] == [
        [20.0, None], [20.0, 20.0],
    ]  # fmt: skip
    assert [(point.valid, point.flags) for point in each.result.points] == [(True, ()), (True, ("surroundings",))]
    (told,) = each.outcome["beside"]
    assert (told["mean"], told["readings"], told["silent"]) == (20.0, 1, 1)
    (message,) = [event["message"] for event in each.run.events() if event["kind"] == "beside"]
    assert message.startswith("room could not be read: oven")


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (ROOM.replace('"oven"', '"kiln"'), "beside.room: unknown device of this bench 'kiln'"),
        (ROOM.replace('"temperature"', '"humidity"'), "unknown field of oven that can be read 'humidity'"),
        (ROOM.replace("degC", "K"), "temperature of oven has the unit degC, not 'K'; write unit = 'degC'"),
        (ROOM + "low = 30.0\nhigh = 20.0", "low = 30 is not below high = 20; exchange them"),
        (ROOM + 'outside = "invalidate"', 'outside = "invalidate" needs a limit; give low, high or both'),
        (ROOM + "highest = 30.0", "highest"),
        (ROOM.replace("u = 0.3", "u = -1.0"), "-1.0 is too small; give at least 0"),
        (ROOM.replace("beside.room", 'beside."<b>"'), "'<b>' is no name"),
        (
            ROOM.replace("room", "a").replace("degC", "").replace("temperature", "heater")
            + ROOM.replace("room", "a_u").replace("degC", "").replace("temperature", "heater"),
            "beside.a_u: it has the column beside_a_u of beside.a, too; give it another name",
        ),
    ],
)
def test_what_cannot_be_read_beside_is_refused_before_anything_is_sent(
    tmp_path: Path, palpate: Palpate, wrong: str, told: str
) -> None:
    with installed("oven"):
        asked = ("sweep", "loads", "--scene", str(scene_with(tmp_path, wrong)), "--out", str(tmp_path / "run"))
        for said in (palpate(*asked), palpate(*asked, "--dry-run")):
            assert (said.status, told in said.err) == (2, True), said.err
    assert not (tmp_path / "run").exists()


# --- a real bench: its file, its wire, and a person --------------------------------------------------------


@pytest.fixture
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Scene]:
    """The scene of `sim`, and so of `lab`: with the oven, and with the faults that the test asks for."""
    with installed("oven"):
        yield read_scene(str(scene_with(tmp_path / "of_the_bench", ROOM, *getattr(request, "param", ()))))


SWEPT = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--assume-mounted", "--json")


def fault(kind: str, at: int, lasts: int) -> tuple[str]:
    """The table of a fault, which begins with the first request after `at`."""
    return (f'[[fault]]\nkind = "{kind}"\non = "oven"\nat = "{at} s"\nlasts = "{lasts} s"',)


@pytest.mark.parametrize(
    "scene",
    [
        fault("no_reply", 30, 1),
        *(
            pytest.param(fault(kind, 30, 1), marks=pytest.mark.slow)
            for kind in ("connection_refused", "device_failure")
        ),
    ],
    indirect=True,
)
def test_a_device_that_is_silent_beside_a_real_bench_costs_no_point_and_is_read_again(
    lab: str, palpate: Palpate
) -> None:
    found = palpate(*SWEPT, "--bench", lab).object
    assert [(p["valid"], p["flags"]) for p in found["points"]] == [(True, ["surroundings"]), (True, [])]
    assert [p["beside_room_degC"] for p in found["points"]] == [None, 20.0]
    assert [(each["readings"], each["silent"]) for each in found["beside"]] == [(1, 1)]
    events = palpate("runs", "show", found["run"], "--json").object["events"]
    (told,) = [event["message"] for event in events if event["kind"] == "beside"]
    assert told.startswith("room could not be read: oven at 127.0.0.1:")


@pytest.mark.parametrize("scene", [fault("no_reply", 0, 1000)], indirect=True)
def test_a_device_beside_that_is_not_there_at_all_is_told_before_anything_is_measured(
    lab: str, palpate: Palpate
) -> None:
    said = palpate(*SWEPT, "--bench", lab)
    assert said.status == 1
    assert "oven at 127.0.0.1:" in said.complaint
    assert "check unit in [device.oven]" in said.complaint
