"""`palpate runs report`: one page that says what a run measured and of what it was made, and how runs differ."""

from __future__ import annotations

import html
import json
import math
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

import palpate as package
from palpate.extend import Recorder
from tests.frozen.cells import PROCEDURES
from tests.procedures.conftest import HEADER, Palpate, interrupt_at
from tests.runs import flip, made, rehash
from tests.shares import first_of

SWEEP = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N", "--dwell", "0.2 s")
SAVE = Figure.savefig
EVIL = "<script>alert(1)</script>"
VNU = Path(os.environ.get("NODE_PATH", "node_modules")) / "vnu-jar" / "build" / "dist" / "vnu.jar"


class Page:
    """The elements and the texts of a page, whose elements are closed in order."""

    def __init__(self, text: str) -> None:
        root = ElementTree.fromstring(re.sub("<(meta|img|br)([^>]*?)/?>", r"<\1\2/>", text))
        given = [(name.rpartition("}")[2], value) for each in root.iter() for name, value in each.items()]
        self.tags = [each.tag.rpartition("}")[2] for each in root.iter()]
        self.ids = [value for name, value in given if name == "id"]
        self.links = [value for name, value in given if name in ("src", "href", "action", "data")]
        self.texts = list(root.itertext())


def read(path: str | Path) -> Page:
    return Page(Path(path).read_text(encoding="utf-8"))


def values(run: package.Run) -> list[dict[str, Any]]:
    """The points of a run, as they were given to its record."""
    return [{name: value for name, value in each.items() if name not in ("id", "bench_ns")} for each in run.points()]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a complete run of two samples at two loads, with what it is about."""
    folder = tmp_path_factory.mktemp("measured") / "run"
    with package.open_bench(about={"operator": "AB", "what": EVIL}) as bench:
        package.run(package.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0), dwell=0.2), bench, out=folder)
    return folder


@pytest.fixture
def swept(measured: Path, palpate: Palpate) -> Path:
    """A copy of that run, as `run` in the test's folder."""
    return shutil.copytree(measured, Path("run"))


@pytest.fixture
def drawing(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has `palpate` draw what it leaves out in other tests."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", SAVE)


# --- one run -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", first_of([*PROCEDURES]))
def test_each_procedure_s_report_holds_all_that_its_command_printed_and_agrees_with_its_record(
    palpate: Palpate, name: str
) -> None:
    said = palpate(*shlex.split(f"{name} {PROCEDURES[name]} --out run"))
    printed = said.out.partition("time           ")[0]
    report = palpate("runs", "report", "run", "--json").object
    assert report["runs"] == [{"run": str(Path("run").absolute()), "damaged": False, "warning": None}]
    texts = read(report["report"]).texts
    assert {line.strip() for line in printed.splitlines() if line.startswith("SIMULATED")} <= set(texts)
    cells = {word for text in texts for word in text.split()}
    lacking = {
        word for word in printed.split() if "/" not in word[:5] and "─" not in word
    } - cells  # no paths, no lines
    lacking.discard("min")  # a setting of 2 min is recorded as 120 s
    assert len(printed) > 200 and lacking == set()


@pytest.mark.usefixtures("swept")
def test_a_report_says_who_what_by_which_devices_calibrations_and_software_and_with_which_verdicts(
    palpate: Palpate,
) -> None:
    Path("limits.toml").write_text('["force ratio of sample 1"]\nhigh = 0.01\n', encoding="utf-8")
    said = palpate("runs", "report", "run", "--limits", "limits.toml", "--json")
    report, run = json.loads(said.out), package.read("run")
    assert (said.status, report["runs"][0]["verdict"]) == (3, "fail")
    texts = read(report["report"]).texts
    serials, versions = (
        [str(value) for value in dict(run.header[name]).values()]  # type: ignore[call-overload]
        for name in ("devices", "versions")
    )
    sha256 = run.header["calibration_files"]["load_cell"]["sha256"]  # type: ignore[index]
    told = (run.digest(), run.signal_digest(), "operator AB", "SIMULATED", sha256, *serials, *versions)
    told += ("Time over which each point is averaged.", "200 ms", "Verdicts", "fail")
    assert [each for each in told if each not in " ".join(texts)] == []


def test_a_page_needs_nothing_else_takes_no_text_of_a_run_for_markup_and_is_the_same_each_time(
    palpate: Palpate, swept: Path, drawing: None
) -> None:
    folder = swept.rename("<b>&'\"")
    for number in (1, 2):
        rehash(folder, point=lambda data: data.update(sample=EVIL), number=number)
    file, other = (Path(palpate("runs", "report", str(folder), "--json").object["report"]) for _ in range(2))
    page, text = read(file), file.read_text(encoding="utf-8")
    assert not {"script", "b", "link", "iframe", "object", "form"} & set(page.tags)
    assert "svg" in page.tags and "".join(page.texts).count(EVIL) > 3
    assert [link for link in page.links if not link.startswith("#") or "http" in link] == []
    assert len(page.ids) == len(set(page.ids))
    label = re.search("<desc>(.*?)</desc>", text)
    assert label is not None and EVIL in html.unescape(label[1])
    assert 10_000 < len(text) < 2_000_000
    assert (other.name, other.read_text(encoding="utf-8")) == ("report-2.html", text)


@pytest.mark.usefixtures("swept")
def test_a_damaged_run_is_shown_as_far_as_it_is_whole(palpate: Palpate) -> None:
    ratios = [f"{point['force_ratio']:.4g}" for point in package.read("run").points()]
    record = Path("run/run.record")
    flip(record, b'"sample":"2"')
    content = record.read_bytes()
    report = palpate("runs", "report", "run", "--json").object
    (told,) = report["runs"]
    assert told["damaged"] and "point 3" in told["warning"]
    text = " ".join(read(report["report"]).texts)
    assert [each in text for each in ("damaged", *ratios)] == [True, True, True, False, True]
    assert record.read_bytes() == content and "/tmp/tmp" not in Path("run/report.html").read_text(encoding="utf-8")


def test_runs_whose_procedure_is_not_here_are_shown_by_their_points_and_not_compared(palpate: Palpate) -> None:
    for name in ("run", "other"):
        with Recorder.create(Path(name), {**HEADER, "procedure": "of-a-package"}) as record:
            record.point({"what": EVIL, "height_mm": 12.5}, {}, 1)
            record.event("incident", "a cable was loose", 2_000_000_000)
            record.finish("complete", {})
    report = palpate("runs", "report", "run", "other", "--json").object
    assert "of-a-package" in report["runs"][0]["warning"] and report["points"] == [None]
    texts = read(report["report"]).texts
    assert {EVIL, "12.5", "2.0", "incident", "a cable was loose"} <= set(texts)
    assert any("none of both are of one step" in text for text in texts)


def test_a_run_on_the_bench_of_a_file_is_evaluated_anew_without_it(palpate: Palpate, lab: str) -> None:
    assert palpate(*SWEEP, "--bench", lab, "--assume-mounted", "--out", "run").status == 0
    assert package.read("run").header["scene"] is None
    (told,) = palpate("runs", "report", "run", "--json").object["runs"]
    assert told["warning"] is None


@pytest.mark.parametrize("name", first_of([*PROCEDURES]))
def test_a_run_that_ended_early_is_shown_with_the_points_that_it_has(
    palpate: Palpate, drawing: None, name: str, on_progress: Any
) -> None:
    for points in (0, 1):
        on_progress(interrupt_at(points))
        assert palpate(*shlex.split(f"{name} {PROCEDURES[name]} --out {points}")).status == 130
        report = palpate("runs", "report", str(points), "--json").object
        warning = report["runs"][0]["warning"]
        assert warning.startswith("this run is stopped, so points may be missing")
        assert ("it has no point" in warning) == (points == 0)
        texts = read(report["report"]).texts
        assert any(f"{points} point" in text for text in texts) and "Devices" in texts


@pytest.mark.slow
@pytest.mark.usefixtures("swept")
def test_a_header_of_another_kind_makes_a_report_or_one_error(palpate: Palpate) -> None:
    for number, key in enumerate(package.read("run").header):
        copy = Path(shutil.copytree("run", f"{number}"))
        rehash(copy, header=lambda header, key=key: header.update({key: EVIL}))  # type: ignore[misc]
        said = palpate("runs", "report", str(copy), "--json")
        if said.status:
            assert said.complaint  # of one line, without a traceback
        else:
            assert "script" not in read(said.object["report"]).tags


@pytest.mark.usefixtures("swept")
def test_a_run_that_another_version_computed_otherwise_is_told(palpate: Palpate) -> None:
    rehash(Path("run"), point=lambda data: data.update(force_ratio=0.5), number=1)
    (told,) = palpate("runs", "report", "run", "--json").object["runs"]
    assert "samples" in told["warning"]


# --- a run of many points ------------------------------------------------------------------------------


def test_a_long_table_is_cut_in_the_middle_and_says_how_to_get_all(palpate: Palpate) -> None:
    made(Path("run"), HEADER, (({"value": 1e3 + number}, {}) for number in range(1, 501)))
    page = read(palpate("runs", "report", "run", "--json").object["report"])
    assert any("500 points" in text for text in page.texts)
    assert {"1001", "1100", "1401", "1500"} <= set(page.texts) and not {"1101", "1400"} & set(page.texts)
    (told,) = (text for text in page.texts if "left out here" in text)
    assert told.startswith("300 lines") and "palpate runs export" in told


@pytest.mark.slow
@pytest.mark.usefixtures("drawing")
def test_a_figure_of_many_points_is_an_image_of_all_of_them(palpate: Palpate) -> None:
    palpate(*SWEEP, "--out", "run")
    run = package.read("run")
    points = values(run)
    made(Path("many"), run.header, ((points[number % len(points)], {}) for number in range(4100)))
    report = Path(palpate("runs", "report", "many", "--json").object["report"])
    page = read(report)
    assert "image" in page.tags and all(link.startswith(("#", "data:image/png")) for link in page.links)
    assert sum("is drawn as an image" in text for text in page.texts) == 1
    assert report.stat().st_size < 1e6


# --- the figure of a run -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.usefixtures("drawing")
def test_the_figure_of_a_run_is_drawn_anew_as_svg_or_png(palpate: Palpate) -> None:
    palpate(*SWEEP, "--out", "run")
    for name, begin in (("plot.svg", b"<?xml"), ("plot.png", b"\x89PNG")):
        found = palpate("runs", "plot", "run", "--out", name, "--json").object
        assert found == {"run": str(Path("run").absolute()), "simulated": True, "warning": None} | {
            "picture": str(Path(name).absolute())
        }
        assert Path(name).read_bytes().startswith(begin)
    assert Path("plot.png").read_bytes() == Path("run/plot.png").read_bytes()
    assert "plot.svg exists and is not overwritten" in palpate("runs", "plot", "run", "--out", "plot.svg").complaint
    assert ".png or .svg" in palpate("runs", "plot", "run", "--out", "plot.pdf").complaint
    assert Path(palpate("runs", "plot", "run").out.strip()).parent == Path("runs/plots").absolute()


def test_a_run_without_a_figure_is_told_why(palpate: Palpate) -> None:
    Recorder.create(Path("run"), HEADER).finish("complete", {})
    said = palpate("runs", "plot", "run", "--out", "plot.svg").complaint
    assert "has no figure: it has no point" in said and not Path("plot.svg").exists()


# --- several runs --------------------------------------------------------------------------------------


def test_two_runs_are_compared_with_the_uncertainty_of_their_difference(palpate: Palpate, drawing: None) -> None:
    for seed in ("1", "2"):
        palpate("test", "modulus", "--sample", "1", "--steps", "4", "--extrapolate", "--seed", seed, "--out", seed)
    report = palpate("runs", "report", "1", "2", "--json").object
    one, other = (
        {each["budget"]["quantity"]: each["budget"] for each in run.summary["budgets"]}  # type: ignore[attr-defined]
        for run in map(package.read, ("1", "2"))
    )
    (found,) = report["differences"]
    assert [each["quantity"] for each in found] == list(one)
    for each in found:
        first, second = one[each["quantity"]], other[each["quantity"]]
        assert each["difference"] == second["value"] - first["value"]
        assert each["independent_u"] == pytest.approx(math.hypot(first["u"], second["u"]))
        assert each["shared_u"] == pytest.approx(math.sqrt(_shared_variance(first, second)))
        assert each["told_apart"] == (abs(each["difference"]) > each["half_width"])
        assert each["half_width"] > 1.95 * each["independent_u"]
    assert any(each["shared_u"] < 0.9 * each["independent_u"] for each in found)
    page = read(report["report"])
    assert Path(report["report"]) == Path("1/report.html").absolute()
    assert page.tags.count("svg") == 2 and len(page.ids) == len(set(page.ids)) > 100
    assert {"Comparison", "Run 1: 1", "Run 2: 2", "told apart"} <= set(page.texts)


def _shared_variance(one: dict[str, Any], other: dict[str, Any]) -> float:
    """The variance of a difference where the inputs of kind B are the same: cᵀ R c, each input once."""
    contributions: dict[tuple[str, int], float] = {}
    for number, (sign, budget) in enumerate(((-1, one), (1, other))):
        for each in budget["components"]:
            key = (each["name"], 0 if each["kind"] == "B" else number)
            contributions[key] = contributions.get(key, 0.0) + sign * each["contribution"]
    variance = sum(value**2 for value in contributions.values())
    for number, budget in enumerate((one, other)):
        for each in budget["correlations"]:
            a, b = ((name, number) for name in each["of"])
            if number == 0 or a in contributions:  # a pair of kind B is in both
                variance += 2 * each["coefficient"] * contributions[a] * contributions[b]
    return variance


@pytest.mark.usefixtures("swept")
def test_points_are_compared_with_those_of_the_same_step_whatever_their_order(palpate: Palpate) -> None:
    run = package.read("run")
    changed = values(run)[::-1]
    changed[1]["force_ratio"] += 3 * changed[1]["force_ratio_u"]
    changed[2]["valid"] = False
    extra = {**changed[0], "load_N": 5.0}
    made(Path("other"), run.header, ((each, {}) for each in (*changed, extra)))
    report = palpate("runs", "report", "run", "other", "--json").object
    (found,) = report["points"]
    first, *rest = found["greatest"]
    assert first["step"] == {"sample": "2", "load_N": 2.0, "set": 1}
    assert (first["quantity"], first["unit"]) == ("force_ratio", "")
    assert first["in_u"] == pytest.approx(3 / math.sqrt(2)) and first["u"] == pytest.approx(2**0.5 * first["first_u"])
    assert {each["difference"] for each in rest} == {0.0}
    assert (found["compared"], found["alone"], found["beyond_2_u"]) == (12, [4, 4], 1)
    assert found["by_chance"] == pytest.approx(12 * 0.0455, rel=1e-3)
    texts = read(report["report"]).texts
    assert "Points of run 2 less those of run 1" in texts and "+2.1" in texts
    assert any("Beyond 2 u are 1 of 12 values" in text and "4 of run 1 and 4 of run 2" in text for text in texts)


@pytest.mark.slow
@pytest.mark.usefixtures("swept")
def test_the_points_of_one_step_are_compared_in_their_order_and_only_the_greatest_are_told(palpate: Palpate) -> None:
    run = package.read("run")
    point = values(run)[0]
    for name, sign in (("one", 1), ("two", -1)):
        points = ({**point, "load_measured_N": 2 + sign * 1e-3 * number} for number in range(40))
        made(Path(name), run.header, ((each, {}) for each in points))
    report = palpate("runs", "report", "one", "two", "--json").object
    (found,) = report["points"]
    assert [each["step"]["set"] for each in found["greatest"]] == list(range(40, 20, -1))
    assert found["greatest"][0]["difference"] == pytest.approx(-0.078)
    assert "Points of run 2 less those of run 1, the greatest ones" in read(report["report"]).texts


@pytest.mark.slow
def test_settings_that_differ_in_the_middle_of_a_long_list_are_told(palpate: Palpate) -> None:
    lists = [f"1.5 N, 1.6 N, 2 N, 2.1 N, {middle} N, 3 N, 3.1 N" for middle in (2.6, 2.7)]
    for number, loads in enumerate(lists):
        palpate("sweep", "loads", "--samples", "1", "--loads", loads, "--dwell", "0.2 s", "--out", str(number))
    texts = read(palpate("runs", "report", "0", "1", "--json").object["report"]).texts
    assert [texts.count(loads) for loads in lists] == [2, 2]  # beside each other, and in its own part


@pytest.mark.slow
def test_a_setting_that_is_a_table_is_told_in_words(palpate: Palpate) -> None:
    palpate("measure", "modulus", "--sample", "4", "--time", "90 s", "--out", "run")
    texts = read(palpate("runs", "report", "run", "--json").object["report"]).texts
    assert any("material Natural 1523, modulus 48263.3" in each for each in texts)


# --- what is refused -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("swept")
def test_bad_input_is_one_error_with_its_remedy_and_leaves_no_file(palpate: Palpate) -> None:
    palpate("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N", "--out", "cell")
    Path("there.html").write_text("mine", encoding="utf-8")
    Path("link.html").symlink_to("nowhere.html")
    before = sorted(Path().rglob("*"))
    told = {
        ("nowhere",): "nowhere",
        ("run", "cell"): "'sweep-loads'",
        ("run", "cell/../run"): "run and cell/../run are one run; name each run once",
        ("run", "--out", "there.html"): "there.html exists and is not overwritten; choose another --out",
        ("run", "--out", "link.html"): "link.html exists and is not overwritten",
        ("run", "--out", "page.pdf"): "page.pdf does not end in .html; choose another --out",
        ("run", "--out", "no/where.html"): "there is no folder no; make it",
        ("run", "--limits", "none.toml"): "none.toml",
    }
    assert [words for words in told if told[words] not in palpate("runs", "report", *words).complaint] == []
    assert (sorted(Path().rglob("*")), Path("there.html").read_text(encoding="utf-8")) == (before, "mine")


# --- by the checkers of others -------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("java"), reason="no java; install one, such as Debian's default-jre-headless")
@pytest.mark.skipif(not VNU.exists(), reason="no vnu.jar: npm install vnu-jar, and name its node_modules by NODE_PATH")
def test_the_checker_of_the_w3c_finds_no_error(palpate: Palpate, drawing: None) -> None:
    pages = []
    for number, name in enumerate(PROCEDURES):
        palpate(*shlex.split(f"{name} {PROCEDURES[name]} --out {number}"))
        pages.append(palpate("runs", "report", str(number), "--json").object["report"])
    palpate(*shlex.split(f"softness {PROCEDURES['softness']} --seed 2 --out other"))
    pages.append(palpate("runs", "report", str(list(PROCEDURES).index("softness")), "other", "--json").object["report"])
    pages.append(str(Path(str(list(PROCEDURES).index("calibrate load-cell")), "certificate.html").absolute()))
    said = subprocess.run(["java", "-jar", VNU, *pages], capture_output=True, text=True, check=False)
    assert said.stderr == "" and said.returncode == 0
