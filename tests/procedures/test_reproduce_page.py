"""The page that `palpate reproduce` writes: every table and figure of the thesis on it, and what the figures hold."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from palpate.instrument.models import springs
from palpate.instrument.models.evidence import REPEATS, Evidence
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import contents, read_table
from palpate.instrument.uncertainty import budget
from palpate.procedures.console.terminal import silent
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
from palpate.procedures.measurements.modulus import ModulusTest
from palpate.procedures.reproduce import chapter5, everything
from palpate.procedures.reproduce.criterion import REQUIRED
from palpate.procedures.reproduce.figures import AREA_RATIOS, BY_RATIO, RATIO_FIGURES, WITH_THEORIES, with_area_ratio
from palpate.procedures.reproduce.models import Reproduction
from palpate.procedures.reproduce.page import PARTS, Everything, anchor, print_everything, write_page
from palpate.procedures.reproduce.rows import RowTable, counts
from tests.procedures.test_reproduce_all import pressed, row, swept, traces, weighed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

pytestmark = pytest.mark.slow  # the fixture takes three seconds


@dataclass(frozen=True, slots=True)
class Whole:
    """One `reproduce` of everything, its benches and their noise left out."""

    done: Everything
    opened: list[tuple[str | None, ...]]
    page: str
    figures: dict[str, Figure]

    def panels(self, number: str) -> list[Axes]:
        """The axes of a figure."""
        picture = next(picture for picture in self.done.models.pictures if picture.number == number)
        return self.figures[picture.file.name].axes

    def caption(self, number: str) -> str:
        return next(picture.caption for picture in self.done.models.pictures if picture.number == number)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Whole]:
    folder = tmp_path_factory.mktemp("whole")
    opened: list[tuple[str | None, ...]] = []
    figures: dict[str, Figure] = {}

    @contextmanager
    def recorded(
        _folder: Path,
        _seed: None,
        scene: str,
        procedure: str,
        model: str | None = None,
        parameters: str | None = None,
        *,
        listener: object,
    ) -> Iterator[Any]:
        opened.append((scene, procedure, model, parameters))
        record = SimpleNamespace(folder=folder)
        yield SimpleNamespace(bench=None, record=record, model=model or "experiment")

    def keep(figure: Figure, path: Path, **_: object) -> None:
        figures[Path(path).name] = figure
        Path(path).write_bytes(b"drawn")

    def found(procedure: Any, lab: Lab, *_: object) -> Any:
        if isinstance(procedure, ModulusTest):
            return pressed(procedure.sample)
        return weighed() if isinstance(procedure, LoadCellSeries) else swept(arrangements[lab.design.name])

    arrangements = {each.design: each for each in chapter5.ARRANGEMENTS}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budget, "TRIALS", 2000)
        patch.setattr("matplotlib.figure.Figure.savefig", keep)
        patch.setattr(everything, "conduct", found)
        patch.setattr(everything, "recorded", recorded)
        patch.setattr(everything, "read_traces", lambda _folder, design, _: traces(swept(arrangements[design.name])))
        done = Everything(Reproduction(folder))
        everything.run(done, None, silent)
    yield Whole(done, opened, (folder / "index.html").read_text(encoding="utf-8"), figures)


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Data of the one line whose label begins so."""
    (found,) = [each for each in axes.get_lines() if str(each.get_label()).startswith(label)]
    return np.asarray(found.get_xdata(), dtype=float), np.asarray(found.get_ydata(), dtype=float)


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


# --- the page ------------------------------------------------------------------------------------------


def test_everything_is_measured_judged_and_on_one_page(whole: Whole) -> None:
    scenes = [arrangement.scene for arrangement in chapter5.ARRANGEMENTS]
    assert [(scene, *by) for scene, procedure, *by in whole.opened if procedure == "sweep-loads"] == [
        (scene, *by) for by in ((None, None), ("surface", "physical"), ("surface", "identified")) for scene in scenes
    ]
    assert [procedure for _, procedure, *_ in whole.opened[9:]] == ["calibrate-load-cell", *2 * ["test-modulus"]]
    assert whole.done.orders == {"single": True, "common_base": True, "different_base": True}
    summary = whole.done.summary()
    assert [(run["parameters"], run["design"]) for run in summary["blind"]["runs"]] == [
        (parameters, each.design) for parameters in ("physical", "identified") for each in chapter5.ARRANGEMENTS
    ]
    assert whole.page.count("blind run, ") == 6
    tables = whole.done.all_tables()
    assert {table.number for table in tables if table.again} == {"5.5", "5.6", "5.8", "5.8 (definitions)", *REPEATS}
    once = [row.within for table in tables if not table.again for row in table.judged]
    assert sum(one["judged"] for one in summary["evidence"].values()) == len(once)
    assert sum(one["within"] for one in summary["evidence"].values()) == sum(once)
    assert len(summary["outside"]) == sum(row.within is False for table in tables for row in table.rows)
    with (whole.done.models.folder / "classes.csv").open(encoding="utf-8") as lines:
        assert [(one["class"], int(one["judged"]), int(one["within"])) for one in csv.DictReader(lines)] == [
            (name, one["judged"], one["within"]) for name, one in summary["evidence"].items()
        ]
    assert set(summary["softness_order_evidence"].values()) == {"input"}
    assert {one["table"] for one in summary["outside"]} >= {"5.2", "5.3"}
    for table, file in whole.done.tables:
        with file.open(encoding="utf-8") as lines:
            rows = list(csv.DictReader(lines))
        assert len(rows) == len(table.rows)
        assert {"printed", "thesis", "repaired", "ours", "difference", "error_percent_of_theory"} <= rows[0].keys()
    assert "SIMULATED" in whole.page
    with (whole.done.models.folder / "slips.csv").open(encoding="utf-8") as lines:
        slips = {(slip["table"], slip["row"], slip["column"]): slip for slip in csv.DictReader(lines)}
    assert (slips["A2.1", "95400", "force_rigid_N"]["printed"], slips["A2.1", "95400", "force_rigid_N"]["best"]) == (
        "-0.3089", "-0.3221",
    )  # fmt: skip
    assert slips["5.6", "3", "force2_N"]["reason"] in whole.page


def test_a_row_shows_its_class_at_a_glance_and_the_legend_says_what_it_means(whole: Whole) -> None:
    """A word shows it, and a border that differs in colour and in kind."""
    for each in Evidence:
        assert f'<tr class="{each.value}"><td><b>{each.value}</b><td>{escape(each.meaning)}' in whole.page
        assert re.search(
            rf'<tr class="{each.value}[ a-z]*"[^>]*>(<td>[^<]*</td>){{3}}<td>{each.value}</td>', whole.page
        )
    borders = [re.search(rf"\.{each.value} > td:first-child {{ border-left: ([^;]*);", whole.page) for each in Evidence]
    styles = [found.group(1).split() for found in borders if found]
    assert [len(set(styles_of)) for styles_of in zip(*styles, strict=True)] == [1, 3, 3]


def test_the_page_gives_each_class_its_own_share_and_no_count_over_all(whole: Whole) -> None:
    verdicts = whole.done.verdicts()
    for evidence, verdict in verdicts.items():
        section = whole.page.partition(f"<h3>{evidence.value.capitalize()}</h3>")[2].partition("</div>")[0]
        assert escape(verdict.counted()) in section and escape(REQUIRED[evidence]) in section
    every = sum(verdict.count.judged for verdict in verdicts.values())
    assert all(verdict.count.judged < every for verdict in verdicts.values())
    assert f" of {every} rows" not in whole.page


def test_the_page_leads_to_every_table_and_part_and_marks_what_is_counted_elsewhere(whole: Whole) -> None:
    top, _, rest = whole.page.partition('id="table-by-table"')
    overview = rest.partition("<h1")[0]
    for part in PARTS:
        assert f'<a href="#{anchor(part)}">{part}</a>' in top
    tables = whole.done.all_tables()
    assert overview.count("<a href=") == len(tables)
    assert len(re.findall(r"</a> \*</td>", overview)) == sum(table.again for table in tables)
    for _, count in (found for table in tables for found in counts(table).items()):
        assert f"<td>{count}</td>" in overview


def test_every_column_of_an_experiment_has_its_rows_and_the_oscilloscope_counts_as_input(whole: Whole) -> None:
    for table in (table for table, _ in whole.done.tables):
        columns = read_table(table.number).columns if table.arrangement else {}
        assert {*columns} <= {row.quantity for row in table.rows}
    shown = [row for table, _ in whole.done.tables for row in table.rows if row.quantity == "oscilloscope_mV"]
    assert len(shown) == 90
    assert {row.evidence for row in shown} == {Evidence.INPUT}


def test_the_page_says_what_could_turn_the_sign_and_where_every_cause_is_gone_through(whole: Whole) -> None:
    section = whole.page.partition('id="models-beside-the-experiments"')[2].partition("<h1")[0]
    assert section.count("<li>blind run, ") == 6
    assert "change of sign" in section
    root = Path(__file__).parents[2]
    assert (root / re.search(r"docs/\w+\.md", section).group()).is_file()  # type: ignore[union-attr]


def test_the_terminal_has_the_tables_and_verdicts_and_leaves_the_rest_to_the_page(
    whole: Whole, capsys: pytest.CaptureFixture[str]
) -> None:
    print_everything(whole.done)
    lines = capsys.readouterr().out.splitlines()
    tables = whole.done.all_tables()
    assert len(lines) < len(tables) + 45
    said = "\n".join(lines)
    for evidence, verdict in whole.done.verdicts().items():
        assert f"{evidence.value.upper()}: {evidence.meaning}" in said
        assert all(line in said for line in verdict.brief())
    first = {line.split()[0].rstrip("*") for line in lines if line.split()}
    assert first >= {table.number for table in tables if " " not in table.number}
    assert f"page      {whole.done.page}" in said


def test_a_class_that_is_not_met_says_why_in_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    biased = RowTable("9.9", "", "", tuple(replace(row(1.0, 1.15, 0.1), row=str(n)) for n in range(9)))
    unanswered = RowTable("9.8", "", "", (row(1.0, math.nan, 0.1, evidence=Evidence.PREDICTED),))
    print_everything(Everything(Reproduction(tmp_path), [(table, tmp_path / "a") for table in (biased, unanswered)]))
    said = capsys.readouterr().out
    assert "BIASED: Table 9.9, force_ratio: +1.50" in said
    assert "without an answer: 1 rows" in said
    assert said.count("NOT MET") == 2


def test_every_number_of_the_thesis_is_on_the_page(whole: Whole) -> None:
    headings = re.findall(r"<h2 id=[^>]*>([^:<]+):", whole.page)
    listed = re.findall(r"<tr><td>(?:<a href=[^>]*>)?((?:Table|Figure) [^<]+)(?:</a>)?</td>", whole.page)
    assert listed == list(contents())
    for content in contents().values():
        of_chapters = content.number.split()[1].startswith(("4.", "5."))
        if content.ours == "compared" or (content.number.startswith("Figure") and of_chapters):
            assert content.number in headings, content.number


def test_what_the_thesis_draws_from_data_is_drawn_here_under_its_number_and_nothing_else_is(
    whole: Whole,
) -> None:
    numbers = [picture.number for picture in whole.done.models.pictures]
    drawn = [content.number for content in contents().values() if content.ours == "drawn"]
    assert numbers == ["Table A2.7", *drawn]
    for picture in whole.done.models.pictures:
        kind, place = picture.number.split()
        assert picture.file.name == f"{kind.lower()}_{place.replace('.', '_')}.png"
        section = whole.page.partition(f">{picture.number}: ")[2].partition("<h2")[0]
        assert section.count("<img") == 1, picture.number
        # The canvas is one of this figure and no other.
        assert picture.number in whole.figures[picture.file.name].get_suptitle()
    assert whole.page.count("<img") == len(numbers)


def test_every_cell_of_a_theory_is_on_the_page_as_printed_and_marked_where_it_is_off(whole: Whole) -> None:
    for comparison, _ in whole.done.models.tables:
        number = comparison.table.number
        section = next(
            part for part in whole.page.split("<h2 ") if re.match(rf'id="[^"]*">Table {number}( \(theories\))?:', part)
            and "every cell beside ours" in part
        )  # fmt: skip
        body = section.partition("every cell beside ours")[2].partition("</details>")[0]
        rows = re.findall(r"<tr([^>]*)>(<td.*)</tr>", body)
        assert len(rows) == sum(len(column.cells) for column in comparison.columns)
        assert sum("class=repaired" in kind for kind, _ in rows) == len(comparison.table.repaired()) or number == "5.8"
        off = sum(
            int((abs(column.difference(series)) > column.goal).sum())
            for column in comparison.columns if column.goal is not None for series in column.ours
        )  # fmt: skip
        assert body.count("<td class=outside>") == off
    first = whole.page.partition(">Table 4.1:")[2].partition("</details>")[0]
    assert "<details open>" in first and "<td>-0.3089</td><td>0.3221</td>" in first


def test_the_page_needs_no_other_file_and_its_links_lead_somewhere(whole: Whole) -> None:
    assert re.findall(r'(?:src|href)="(?!data:|#)', whole.page) == []
    places = re.findall(r'id="([^"]*)"', whole.page)
    assert len(set(places)) == len(places)
    assert set(re.findall(r'href="#([^"]*)"', whole.page)) <= set(places)


def test_what_stands_on_the_page_is_escaped(tmp_path: Path) -> None:
    cell = replace(row(1.0, 1.0, 0.1, reason='"quoted" <b>'), row="<u>")
    table = RowTable('9.9 <i> "', "a & b", "<script>", (cell,), ("x < y",))
    done = Everything(Reproduction(tmp_path), [(table, tmp_path / "none.csv")])
    page = write_page(done, tmp_path).read_text(encoding="utf-8")
    assert "<script>" not in page
    for text in (
        "Table 9.9 &lt;i&gt; &quot;: a &amp; b",
        "&quot;quoted&quot; &lt;b&gt;",
        "x &lt; y",
        "<td>&lt;u&gt;</td>",
    ):
        assert text in page
    assert 'id="table-9.9-&lt;i&gt;-&quot;"' in page


# --- what the figures hold -----------------------------------------------------------------------------


def test_marks_are_what_the_thesis_prints_on_each_ring(whole: Whole) -> None:
    for number, tables in (("4.8", ("A2.1", "A2.2")), ("4.10", ("A2.5", "A2.6")), ("4.12", ("A2.3", "A2.4"))):
        left, right = whole.panels(f"Figure {number}")
        for source, ring in zip(tables, (24, 33), strict=True):
            (words,) = {each.lines[0].words for each in RATIO_FIGURES if each.number == f"Figure {number}"}
            moduli, ratios = line(left, f"thesis, {words}, ring {ring} kPa: Table {source}")
            table = read_table(source)
            ratio = abs(table.values("force_ratio" if "force_ratio" in table.columns else "force_rigid_N"))
            assert moduli.tolist() == table.keys()[:-1].tolist()  # 140 GPa is off the axis
            assert ratios.tolist() == ratio[:-1].tolist()
        assert left.get_xscale() == right.get_xscale() == "log"


def test_a_curve_says_whether_it_was_fitted_to_the_marks_beside_it(whole: Whole) -> None:
    left, _ = whole.panels("Figure 4.15")
    said = {str(each.get_label()) for each in left.get_lines() if str(each.get_label()).startswith("ours")}
    assert said == {
        "ours, 3D, ring 24 kPa: physical set, predicted", "ours, 3D, ring 24 kPa: identified set, fitted",
        "ours, 3D, ring 33 kPa: physical set, predicted", "ours, 3D, ring 33 kPa: identified set, predicted",
        "ours, 2D, ring 24 kPa: beam, fitted", "ours, 2D, ring 33 kPa: beam, predicted",
    }  # fmt: skip
    assert "Ours, fitted: 3D, ring 24 kPa by the identified set; 2D, ring 24 kPa by the beam." in whole.caption(
        "Figure 4.15"
    )
    # No curve beside experiments is fitted, whatever it was fitted to among the theories.
    for figure in WITH_THEORIES:
        (axes,) = whole.panels(figure.number)
        curves = [
            str(each.get_label()) for each in axes.get_lines() if str(each.get_label()).endswith(("ted", "input"))
        ]
        assert curves and all(label.endswith("predicted") for label in curves), curves


def test_of_table_a2_7_the_set_that_was_fitted_to_it_is_called_so(whole: Whole) -> None:
    left, right = whole.panels("Table A2.7")
    said = {str(each.get_label()) for axes in (left, right) for each in axes.get_lines()}
    for place in ("left tooth", "right tooth", "both teeth"):
        assert {f"ours, {place}: capped set, fitted", f"ours, {place}: identified set, predicted"} <= said
        assert f"thesis, {place}" in said


def test_the_right_panel_is_ours_less_the_thesis(whole: Whole) -> None:
    left, right = whole.panels("Figure 4.13")
    marks, curve = line(left, "thesis, 3D"), line(left, "ours, 3D, ring 24 kPa: identified")
    between = np.interp(np.log(marks[0]), np.log(curve[0]), curve[1])
    differences = [np.asarray(each.get_ydata(), dtype=float) for each in right.get_lines()]
    alike = [d for d in differences if len(d) == len(marks[0]) and np.abs(d - (between - marks[1])).max() < 2e-3]
    assert len(alike) == 1


def test_over_lambda_both_rings_fall_on_nearly_one_curve(whole: Whole) -> None:
    left, _ = whole.panels("Figure 4.7")
    assert "λ" in left.get_xlabel()
    soft, stiff = (line(left, f"ours, 3D, ring {ring} kPa: identified") for ring in (24, 33))
    assert soft[0][0] == pytest.approx(14.9e3 / 24e3 * 3.88 / 3)
    assert np.interp(np.log(soft[0]), np.log(stiff[0]), stiff[1]) == pytest.approx(soft[1], abs=2e-3)


def test_area_ratios_end_at_the_share_of_the_tooth_and_at_one(whole: Whole) -> None:
    (axes,) = whole.panels("Figure 4.4")
    for ratio in AREA_RATIOS:
        lambdas, ratios = line(axes, f"A = {ratio:g}: columns")
        assert ratios == pytest.approx((1 + lambdas) / (1 + ratio + lambdas))
    own = get_design("single")
    wide = with_area_ratio(own, 20.0)
    assert springs.ratio_of_modulus(wide, 1e-3, 3e-3) == pytest.approx(1 / 21, rel=1e-5)
    assert axes.get_xscale() == "log"


def test_orders_have_the_thesis_left_ours_right_and_show_who_changes_places(whole: Whole) -> None:
    for design, (number, source) in BY_RATIO.items():
        (axes,) = whole.panels(number)
        samples = [re.search(r"sample (\d)", text).group(1) for text in texts(axes) if "sample" in text]  # type: ignore[union-attr]
        assert tuple(samples[:6]) == get_design(design).thesis_softness_order
        ratios = get_design(design).thesis_force_ratio
        assert samples[6:] == sorted(ratios, key=lambda name: -ratios[name])
        moved = {str(each.get_color()) for each in axes.get_lines()} - {"k"}
        assert bool(moved) == (number == "Figure 5.4")
        printed = read_table(source).values("force_ratio")
        assert {f"{ratio:.3f}" for ratio in printed} <= {text.split()[-1] for text in texts(axes)}
    (axes,) = whole.panels("Figure 5.2")
    assert [text[7] for text in texts(axes)[:6]] == ["1", "6", "4", "3", "5", "2"]


def test_experiments_are_squares_circles_and_diamonds_at_the_samples_moduli(whole: Whole) -> None:
    from matplotlib.container import ErrorbarContainer

    (axes,) = whole.panels("Figure 5.6")
    found = {str(each.get_marker()) for each in axes.get_lines() if str(each.get_label()).startswith("thesis")}
    assert found == {"s", "o", "D"}
    for words, design in (("single sensor", "single"), ("different bases", "different_base")):
        moduli, ratios = line(axes, f"thesis, {words}")
        thesis = get_design(design).thesis_force_ratio
        assert dict(zip(moduli, ratios, strict=True)) == {SAMPLES[name].modulus: thesis[name] for name in thesis}
    assert sum(isinstance(each, ErrorbarContainer) for each in axes.containers) == 3
    assert axes.get_xlim() == (1e4, 1e6)


def test_the_single_sensors_experiments_stand_with_2d_and_3d_the_pairs_with_3d(whole: Whole) -> None:
    theories = {number: {label.partition(":")[0] for label in labels} for number, labels in _theories(whole).items()}
    assert theories == {
        "Figure 5.7": {"thesis, 3D", "thesis, 2D"},
        "Figure 5.8": {"thesis, common base"},
        "Figure 5.9": {"thesis, different bases"},
    }


def test_benches_that_know_nothing_of_the_experiments_stand_beside_them_as_predicted(whole: Whole) -> None:
    from matplotlib.container import ErrorbarContainer

    for figure in WITH_THEORIES:
        (axes,) = whole.panels(figure.number)
        said = [str(each.get_label()) for each in axes.containers if isinstance(each, ErrorbarContainer)]
        assert said[0].endswith(": bench, input")
        assert said[1:] == ["ours: bench by physical set, predicted", "ours: bench by identified set, predicted"]


def test_a_curve_and_a_bench_of_other_models_are_told_apart(whole: Whole) -> None:
    """The curve of the single sensor is of a round one and the bench of a square one, so they lie apart."""
    labels = [str(each.get_label()) for each in whole.panels("Figure 5.7")[0].get_lines()]
    fitted = "fitted (beside experiments: predicted)"  # to the theories of the thesis, which are the crosses
    assert f"ours, 3D: axisymmetric, identified, {fitted}" in labels
    assert f"ours, 2D: beam, {fitted}" in labels
    assert "ours, 3D: axisymmetric, physical, predicted" in labels
    captions = [whole.caption(figure.number) for figure in WITH_THEORIES]
    assert ["model axisymmetric) and the benches of the square one" in each for each in captions] == [
        True,
        False,
        False,
    ]


def test_moduli_that_the_thesis_misprints_are_not_called_as_printed(whole: Whole) -> None:
    (axes,) = whole.panels("Figure 5.2")
    assert "sample 4   48.3 kPa, as given" in texts(axes)
    assert "4823.30 and 2579.03 Pa are printed" in whole.caption("Figure 5.2")


def test_no_legend_is_cut_off(whole: Whole) -> None:
    for name, figure in whole.figures.items():
        for legend in figure.legends:
            box, paper = legend.get_window_extent(), figure.bbox
            assert (box.x0 >= paper.x0, box.x1 <= paper.x1) == (True, True), name


def _theories(whole: Whole) -> dict[str, list[str]]:
    return {
        figure.number: [
            str(each.get_label())
            for each in whole.panels(figure.number)[0].get_lines()
            if str(each.get_label()).startswith("thesis") and "experiment" not in str(each.get_label())
        ]
        for figure in WITH_THEORIES
    }
