"""Tables and plots say what was measured, each column once, and SIMULATED where it was, and fit who reads them."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO, StringIO, TextIOWrapper
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any
from xml.etree import ElementTree

import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

import palpate
from palpate import RecordError, as_dataset, get_design, read
from palpate.extend import Column, Design, Recorder, gathered
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.quantity import counted
from palpate.procedures.engine.catalogue import SHIPPED
from palpate.procedures.measurements.load_cell.report import (
    LoadCellPoint,
    LoadCellResult,
    plot_load_cell,
    show_load_cell,
)
from palpate.procedures.measurements.loads import LoadPoint, evaluate, plot_sweep, show_sweep
from palpate.procedures.records.run import Run, RunSummary, list_runs
from palpate.procedures.showing import text
from palpate.procedures.showing.figure import logarithmic, name_all, new_figure, plot_over_loads, save, with_u, write
from palpate.procedures.showing.runs import print_run, print_runs
from palpate.procedures.showing.text import STAMP, new_table, number, percent, print_all, stamped, where
from tests.conftest import Install
from tests.procedures.conftest import HEADER, Palpate
from tests.shares import first_of

DESIGN = get_design("single")
MARKUP = "a[bold]b[/red] :bug: [/]"  # as a part of the name of a folder
OUTCOME = {
    "simulated": True,
    "model": "experiment",
    "evidence": "input",
    "calibration": f"cal {MARKUP}",
    "mounting": "confirmed",
    "calibration_file": "cell.toml",
    "certificate": "certificate.html",
    "bench_seconds": 100.0,
    "wall_seconds": 0.5,
    "run": f"/{MARKUP}",
}


def point(sample: str, load: float, force_ratio: float, valid: bool = True) -> LoadPoint:
    return LoadPoint(sample, load, 22.4, load, 0.03, 4e-3, 0.137, 0.6, 2.0, force_ratio, 0.0123, 1e-4, 1.1, valid)


SWEEP = evaluate([point("1", 2.0, 0.3), point("1", 3.0, 0.4, valid=False), point("2", 2.0, 0.15)], DESIGN)
CALIBRATION = LoadCellResult(
    THESIS_LOAD_CELL,
    [
        LoadCellPoint(0.0, 1, direction, gf, gf * 9.80665e-3, 1.81 + 0.101 * gf, ())
        for direction in ("loading", "unloading")
        for gf in (140.0, 240.0)
    ],
)


def stamps(figure: Figure) -> list[bool]:
    """Whether the title, and then each panel, says SIMULATED."""
    return [
        figure.get_suptitle().startswith(STAMP),
        *(any(text.get_text() == STAMP for text in axes.texts) for axes in figure.axes),
    ]


# --- plots ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("simulated", [True, False])
def test_a_plot_is_stamped_if_and_only_if_it_is_simulated(
    figures: list[Figure], tmp_path: Path, simulated: bool
) -> None:
    assert plot_sweep(SWEEP, DESIGN, simulated, tmp_path) == tmp_path / "plot.png"
    assert plot_load_cell(CALIBRATION, simulated, tmp_path) == tmp_path / "plot.png"
    assert [stamps(figure) for figure in figures] == [[simulated] * 3] * 2


def test_the_plot_of_a_sweep_shows_the_points_and_the_means(figures: list[Figure], tmp_path: Path) -> None:
    plot_sweep(SWEEP, DESIGN, True, tmp_path)
    left, right = figures[0].axes
    (one,) = (c for c in left.containers if c.get_label() == "sample 1")
    (bad,) = (line for line in left.lines if line.get_label() == "not valid")
    assert [[list(axis) for axis in line.get_data()] for line in (one[0], bad)] == [
        [[2.0, 3.0], [0.3, 0.4]], [[3.0], [0.4]],
    ]  # fmt: skip
    assert [label.get_text() for label in right.get_xticklabels()] == ["1", "2"]
    (ours,) = (c[0] for c in right.containers if c.get_label() == "this run")
    (thesis,) = (line for line in right.lines if str(line.get_label()).startswith("thesis"))
    assert [list(line.get_ydata()) for line in (ours, thesis)] == [[0.3, 0.15], [0.314, 0.142]]


def test_a_sweep_without_a_valid_point_can_be_plotted_and_printed(
    figures: list[Figure], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = evaluate([point("1", 2.0, 0.3, valid=False)], DESIGN)
    plot_sweep(nothing, DESIGN, True, tmp_path)
    print_all(*show_sweep(nothing, DESIGN, OUTCOME))
    assert " NO" in capsys.readouterr().out


def test_the_plot_of_a_calibration_shows_the_deviation_from_the_line(figures: list[Figure], tmp_path: Path) -> None:
    plot_load_cell(CALIBRATION, True, tmp_path)
    readings, deviations = (
        next(each for each in axes.containers if each.get_label() == "loading") for axes in figures[0].axes
    )
    loads, values = readings[0].get_data()
    lines = [THESIS_LOAD_CELL.reading(load) for load in loads]
    assert list(deviations[0].get_ydata()) == pytest.approx(
        [value - line for value, line in zip(values, lines, strict=True)]
    )
    shown = len(next(each.readings_mV for each in CALIBRATION.points if each.direction == "loading"))
    for bars in (readings[2], deviations[2]):
        heights = [high - low for (_, low), (_, high) in bars[0].get_segments()]
        assert heights == pytest.approx([2 * THESIS_LOAD_CELL.reading_u(shown)] * len(heights))


def test_a_plot_that_is_slow_to_place_its_legend_gives_no_warning(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    figure, (ax,) = new_figure(False, 1, "slow")
    ax.plot([0, 1], label="line")
    ax.legend()
    monkeypatch.setattr("matplotlib.legend.time.perf_counter", count(0.0, 2.0).__next__)  # s; above 1 s it would warn
    assert save(figure, tmp_path).is_file()


def test_a_plot_that_cannot_be_written_is_a_record_error(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"cannot write .*plot\.png: No such file or directory"):
        plot_sweep(SWEEP, DESIGN, True, tmp_path / "gone")


# --- tables --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("design", "model", "evidence", "said"),
    [
        (DESIGN, "experiment", "input", "input: model experiment is the thesis' own means;"),
        (DESIGN, "column", "predicted", "predicted: model column knows nothing of the thesis' means"),
        (DESIGN, None, None, ""),
        (get_design("array"), "column", "predicted", ""),
    ],
)
def test_the_means_beside_the_thesis_say_what_their_agreement_is_worth(
    capsys: pytest.CaptureFixture[str], design: Design, model: str | None, evidence: str | None, said: str
) -> None:
    print_all(*show_sweep(SWEEP, design, {**OUTCOME, "model": model, "evidence": evidence}))
    means = capsys.readouterr().out.partition("Mean force ratio")[2].partition("softness order")[0]
    assert ("evidence" in means, said in means) == (bool(said), True)
    assert means.count(f" {evidence} ") == 2 * bool(said)


def test_the_order_stands_beside_that_of_the_thesis_means_and_of_its_figure(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = evaluate([point("3", 2.0, 0.2), point("5", 2.0, 0.1)], get_design("common_base"))
    print_all(*show_sweep(found, get_design("common_base"), OUTCOME))
    assert "hard to soft: 3 > 5   (thesis: 3 > 5; its figure at 3 N: 5 > 3)" in capsys.readouterr().out


@pytest.mark.parametrize("simulated", [True, False])
def test_a_table_is_stamped_if_and_only_if_it_is_simulated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, simulated: bool
) -> None:
    outcome: dict[str, Any] = {**OUTCOME, "simulated": simulated}
    with Recorder.create(tmp_path / "run", {**HEADER, "simulated": simulated}) as record:
        record.point({"load_N": 2.0}, {}, 1)
    for show, tables in (
        (lambda: print_all(*show_sweep(SWEEP, DESIGN, outcome)), 2),
        (lambda: print_all(*show_load_cell(CALIBRATION, None, outcome)), 1),
        (lambda: print_runs(list_runs(tmp_path), tmp_path), 1),
        (lambda: print_run(Run.open(tmp_path / "run"), "digest", "signals", ""), 2),
    ):
        show()
        assert capsys.readouterr().out.count("SIMULATED") == tables * simulated


def test_names_and_messages_are_shown_as_they_are(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder = tmp_path / MARKUP.replace("/", "\\")
    with Recorder.create(folder, HEADER) as record:
        record.point({"sample": MARKUP}, {}, 1)
        record.event("odd", MARKUP, 2)
    of_a_sweep = {name: value for name, value in OUTCOME.items() if name != "calibration_file"}
    print_run(Run.open(folder), "digest", "signals", "")
    print_all(*show_sweep(SWEEP, DESIGN, of_a_sweep), *where(of_a_sweep, Path(f"/{MARKUP}/plot.png")))
    print_runs([RunSummary(folder, datetime(2025, 3, 14, tzinfo=UTC), fault=MARKUP)], folder)
    text = capsys.readouterr().out
    assert (text.count(folder.name), text.count(MARKUP), f"damaged: {MARKUP}" in text) == (3, 6, True)


def test_a_title_that_is_longer_than_its_table_stands_on_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table(stamped(True, "a title of many more words than its only column is wide"), "N")
    table.add_row("1")
    print_all(table)
    assert capsys.readouterr().out.startswith(f"{STAMP} a title of many more words than its only column is wide\n")


@pytest.mark.parametrize("encoding", first_of(["ascii", "utf-8"]))
def test_a_folder_whose_name_is_no_text_is_shown_escaped(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, encoding: str
) -> None:
    name = os.fsdecode(b"day-\xff")
    assert palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--out", name, "--quiet").status == 0
    raw = BytesIO()
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(raw, encoding, errors="strict"))
    assert palpate("runs", "show", name).status == 0
    assert rb"day-\udcff" in raw.getvalue()


def test_without_a_stdout_there_is_no_table_and_no_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    print_runs([], Path("runs"))


def test_a_terminal_narrower_than_the_table_does_not_break_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    for name, value in (("TERM", "xterm"), ("COLUMNS", "40")):
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stdout", terminal)
    path = "/" + 30 * "folder/" + "plot.png"
    print_all(*show_sweep(SWEEP, DESIGN, OUTCOME), *where({**OUTCOME, "run": path}, Path(path)))
    assert terminal.getvalue().count(path) == 2


# --- what figures have in common -----------------------------------------------------------------------


@pytest.mark.parametrize("limits", [(24.0, 115.0), (31.0, 33.0), (2.0, 5000.0)])
def test_labels_of_a_logarithmic_axis_do_not_touch(limits: tuple[float, float]) -> None:
    figure, (axes, _) = new_figure(False, 2, "a title")
    logarithmic(axes, *limits)
    figure.draw_without_rendering()
    left, right = axes.get_window_extent().intervalx
    boxes = [label.get_window_extent() for label in axes.get_xticklabels(which="both") if label.get_text()]
    inside = [box for box in boxes if left <= (box.x0 + box.x1) / 2 <= right]
    assert len(inside) >= 2
    assert all(one.x1 < other.x0 for one, other in pairwise(sorted(inside, key=lambda box: box.x0)))


@dataclass(frozen=True)
class Set:
    load_N: float
    force_ratio: float
    force_ratio_u: float = 0.01
    valid: bool = True


def test_repeated_loads_have_one_line_through_the_mean_of_the_valid_sets() -> None:
    _, (axes,) = new_figure(False, 1, "a title")
    sets = [Set(2, 0.30), Set(3, 0.32), Set(4, 0.31, valid=False), Set(2, 0.32), Set(3, 0.9, valid=False)]
    plot_over_loads(axes, 0, "sample 1", sets)
    lines = [line for line in axes.lines if line.get_linestyle() == "-" and line.get_marker() == "None"]
    assert [list(map(tuple, line.get_xydata())) for line in lines] == [[(2, pytest.approx(0.31)), (3, 0.32)]]


def test_bars_and_bands_do_not_cover_the_stamp() -> None:
    _, (axes,) = new_figure(True, 1, "a title")
    axes.axhspan(0, 1)
    axes.barh([0, 1], [1, 2])
    axes.errorbar([0, 1], [0, 1], [1, 1])
    (stamp,) = axes.texts
    assert stamp.get_text() == "SIMULATED"
    drawn = max(each.get_zorder() for each in (*axes.patches, *axes.lines, *axes.collections))
    assert drawn < stamp.get_zorder() < axes.legend([], []).get_zorder()


# --- the file: its format, and its text for who cannot see it -------------------------------------------


def drawn() -> Figure:
    figure, (left, right) = new_figure(True, 2, "films <1> & 2")
    left.plot([0, 1], [0, 1], label="F1")
    left.set(xlabel="load (N)", ylabel="voltage (mV)")
    right.set(xlabel="time (s)", ylabel="change (%)")
    name_all(left)
    return figure


TOLD = "SIMULATED: films <1> & 2. Panel 1: voltage (mV) over load (N); F1. Panel 2: change (%) over time (s)."


def test_a_png_or_svg_says_what_it_shows_and_is_the_same_each_time(tmp_path: Path) -> None:
    for kind in ("png", "svg"):
        for name in ("one", "other"):
            write(drawn(), tmp_path / f"{name}.{kind}")
        assert (tmp_path / f"one.{kind}").read_bytes() == (tmp_path / f"other.{kind}").read_bytes()
    with Image.open(tmp_path / "one.png") as image:
        told = [("title", image.info["Title"]), ("desc", image.info["Description"])]
    root = ElementTree.parse(tmp_path / "one.svg").getroot()
    assert [(each.tag.partition("}")[2], each.text) for each in root[:2]] == told
    assert [text for _, text in told] == ["SIMULATED: films <1> & 2", TOLD]


@dataclass(frozen=True)
class Pressed:
    volts: Annotated[tuple[float, ...], Column("voltages", "V", u="volts_u")]
    volts_u: tuple[float, ...]
    mean: Annotated[float | None, Column("mean", "V")] = None


def test_values_for_a_plot_have_the_uncertainties_of_their_column() -> None:
    rows = [Pressed((1.0, 2.0), (0.1, 0.2)), Pressed((3.0, 4.0), (0.3, 0.4), 3.5)]
    assert with_u(rows, "volts", 1e3, 1) == ([2e3, 4e3], [200.0, 400.0])
    values, u = with_u(rows, "mean")
    assert values == [pytest.approx(float("nan"), nan_ok=True), 3.5]
    assert u is None
    assert with_u([], "mean") == ([], None)


# --- the plots of procedures ----------------------------------------------------------------------------

WITHOUT_UNIT = ("strain", "sample", "object", "force ratio", "mean force ratio", "number of the set", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        "sweep loads --samples 1,2 --loads 2N,3N",
        "sweep frequency",
        "sweep temperature",
        "sweep position",
        "calibrate load-cell",
        "calibrate films",
        "characterise",
        "test modulus --sample 1",
        "softness --samples 1,3",
        "measure modulus --sample 1 --time 3min --relative-to-model",
    ],
)
def test_a_plot_has_bars_units_and_a_legend_that_covers_no_point(
    command: str, palpate: Palpate, figures: list[Figure]
) -> None:
    assert palpate(*command.split(), "--quiet").status == 0
    (figure,) = figures
    figure.draw_without_rendering()
    assert any(each.has_yerr for each in figure.axes[0].containers if isinstance(each, ErrorbarContainer))
    for axes in figure.axes:
        if (legend := axes.get_legend()) is not None:
            assert legend.get_window_extent().y0 >= axes.get_window_extent().y1
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert "(" in label or label in WITHOUT_UNIT, label


# --- A field of a point is said once, by its column; and what is printed for people fits their  --------


PROCEDURE = """
from dataclasses import dataclass
from typing import Annotated

from palpate import get_sample
from palpate.extend import Column, DynamicLoadWork, Measurement, Plan, Procedure, SimpleResult, Step, gathered


@dataclass(frozen=True)
class WaitPoint:
    sample: str
    force_ratio: Annotated[float, Column("force ratio of the sensor", head="ratio", cell="z.4f")]
    settling_s: Annotated[float, Column("how long the films took", "s", "settled\\nms", "z.0f", 1e3, u="settling_u")]
    settling_u: float = 0.1


@dataclass(frozen=True, slots=True)
class WaitStep(Step):
    sample: str


@dataclass(frozen=True)
class Waiting(Procedure):
    name, point = "waiting", WaitPoint

    def plan(self, target):
        return Plan(self.name, [WaitStep(1.0, 5.0, None, "1", what="load set 1", group="mount")])

    def begin(self, plan, lab, record):
        return Work(lab, record, (2.0,), 10.0, ("1",))

    def evaluate(self, points, plan, lab):
        return SimpleResult(points)


class Work(DynamicLoadWork):
    def arrange(self, step):
        self.press(get_sample(step.sample))

    def take(self, step):
        measured = self.measured(2.0, step.what, 1.0)
        return Measurement(gathered(WaitPoint, step, measured, measured.forces(self.lab.design)))
"""


def installed(install: Install, old: str = "", new: str = "") -> None:
    module = {"acme_waiting": PROCEDURE.replace(old, new)}
    install("acme-lab", "palpate.procedures", {"waiting": "acme_waiting:Waiting"}, **module)


def test_a_new_column_of_a_sweep_is_one_place_is_recorded_and_a_dataset_says_what_it_is(
    install: Install, palpate: Palpate
) -> None:
    installed(install)
    lines = palpate("measure", "waiting", "--scene", "ideal", "--out", "printed").out.splitlines()
    heads, units, _, row = (line.split() for line in lines[2:6])
    assert (heads, units) == (["settled"], ["ratio", "ms"])
    (point,) = palpate("measure", "waiting", "--scene", "ideal", "--out", "told", "--json").object["points"]
    assert (row, list(point)) == (
        [f"{point['force_ratio']:.4f}", f"{1e3 * point['settling_s']:.0f}"],
        ["sample", "force_ratio", "settling_s", "settling_u"],
    )
    run = read(Path("told"))
    (recorded,) = run.points()
    assert {name: recorded[name] for name in point} == point
    settling = as_dataset(run).settling_s
    about = {"units": "s", "long_name": "how long the films took", "ancillary_variables": "settling_u"}
    assert (settling.attrs, settling.values.tolist()) == (about, [point["settling_s"]])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('u="settling_u"', 'u="settled_u"', "WaitPoint.settling_s: u 'settled_u' is no field of it; name one"),
        ('head="ratio"', 'after="load_N"', "WaitPoint.force_ratio: after 'load_N' is no field of it; name one"),
        ("sample: str\n    force", 'sample: "Text"\n    force', "WaitPoint: name 'Text' is not defined; import it"),
        ("[float, Column", "[float, Column(), Column", "WaitPoint.force_ratio has 2 columns; give it one"),
        ("@dataclass(frozen=True)\nclass WaitPoint", "class WaitPoint", "is no dataclass, and so it has no columns"),
    ],
)
def test_a_column_that_cannot_be_is_refused_before_anything_is_sent(
    install: Install, palpate: Palpate, old: str, new: str, said: str
) -> None:
    installed(install, old, new)
    found = palpate("measure", "waiting", "--scene", "ideal", "--out", "run")
    assert (found.status, said in found.complaint) == (2, True)
    assert not Path("run").exists()


def test_a_value_that_its_format_cannot_print_is_told_with_its_field(install: Install, palpate: Palpate) -> None:
    installed(install, '"z.4f"', '"d"')
    said = palpate("measure", "waiting", "--scene", "ideal", "--out", "run").complaint
    assert "WaitPoint.force_ratio: 0.3" in said and "cannot be printed as 'd'" in said


@dataclass(frozen=True)
class Point:
    load_N: float
    dwell_s: float = 1.0


LOAD, DWELL = SimpleNamespace(load_N=2.0), SimpleNamespace(dwell_s=3.0)


def test_a_point_is_gathered_from_what_has_its_names() -> None:
    assert (gathered(Point, LOAD), gathered(Point, LOAD, DWELL)) == (Point(2.0, 1.0), Point(2.0, 3.0))
    assert gathered(Point, LOAD, LOAD, load_N=4.0) == Point(4.0, 1.0)


@pytest.mark.parametrize(
    ("sources", "given", "message"),
    [
        ((LOAD, LOAD), {}, r"^Point.load_N: .* and .* both have it; say which is meant: load_N="),
        ((DWELL,), {}, r"^Point.load_N: it is in none of its sources \(SimpleNamespace\)"),
        ((LOAD,), {"load": 3.0}, r"^Point.load: there is no such field; leave load=... out"),
    ],
)
def test_what_is_not_sure_is_not_gathered(
    sources: tuple[SimpleNamespace, ...], given: dict[str, float], message: str
) -> None:
    with pytest.raises(palpate.ConfigError, match=message):
        gathered(Point, *sources, **given)


# --- What is printed for people: blocks of columns in a narrow terminal, the singular for one,  -------

SHOWING = Path(text.__file__).parent
COLUMNS = ("id", *(f"quantity_{n}" for n in range(20)))


@pytest.mark.parametrize("width", [20, 40, 80, 400])
def test_a_table_too_wide_for_the_terminal_is_printed_in_blocks_that_repeat_its_first_column(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=width, force_terminal=True, color_system=None))
    table = new_table(stamped(False, "T"), *COLUMNS)
    for row in range(2):
        table.add_row(str(row), *(f"{row}.{n}" for n in range(20)))
    print_all(table)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert all(len(line.rstrip()) <= width for line in lines)
    heads = [line.split() for line in lines if "quantity_" in line]
    assert (len(heads), [name for head in heads for name in head if name != "id"]) == (
        {20: 20, 40: 10, 80: 4, 400: 1}[width],
        list(COLUMNS[1:]),
    )
    assert {head[0] for head in heads} == {"id"}
    cells = [line.split()[1:] for line in lines if line.split()[0] == "1"]
    assert ([cell for some in cells for cell in some], lines[0].strip()) == ([f"1.{n}" for n in range(20)], "T")


def test_a_terminal_gets_no_line_wider_than_itself_but_one_that_a_single_word_makes_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=40, force_terminal=True, color_system=None))
    path = "/" + 5 * "a-folder/" + "plot.png"
    words = "the scatter of mountings was never measured and counts as none"
    print_all(f"note           {words}", words, f"  best now  {words}\nplot           {path}")
    assert capsys.readouterr().out.splitlines() == [
        "note           the scatter of mountings",
        "               was never measured and",
        "               counts as none",
        "the scatter of mountings was never",
        "measured and counts as none",
        "  best now  the scatter of mountings was",
        "            never measured and counts as",
        "            none",
        f"plot           {path}",
    ]


def test_where_the_output_is_no_terminal_a_line_stays_whole(capsys: pytest.CaptureFixture[str]) -> None:
    line = "note           " + 40 * "word "
    print_all(line)
    assert capsys.readouterr().out == f"{line}\n"


def test_one_is_singular() -> None:
    assert [counted(n, "point") for n in range(3)] == ["0 points", "1 point", "2 points"]


def test_no_table_has_a_negative_zero() -> None:
    assert (percent(-1e-6), number(-0.0)) == ("0.00", "0")
    measurements = SHOWING.parent / "measurements"
    shown = [
        file.read_text(encoding="utf-8").partition("# --- what it shows")[2] for file in measurements.rglob("*.py")
    ]
    texts = [*(file.read_text(encoding="utf-8") for file in SHOWING.glob("*.py")), *filter(None, shown)]
    fixed = [found for text in texts for found in re.findall(r":\+?\.\df\}", text)]
    columns = [file.read_text(encoding="utf-8") for file in measurements.rglob("*.py")]
    fixed += [found for text in columns for found in re.findall(r"\"\+?\.\df\"", text)]
    assert sum(map(bool, shown)) == len(SHIPPED)
    assert fixed == []  # a z after the colon or quote, or the sign, makes -0.0 into 0.0
