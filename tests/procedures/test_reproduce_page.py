"""The page that `palpate reproduce` writes: every table and figure of the thesis on it, and what the figures hold."""

from __future__ import annotations

import csv
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

from palpate import LoadCellSeries, ModulusTest, get_design
from palpate.extend import Lab
from palpate.instrument.models import springs
from palpate.instrument.models.evidence import REPEATS, Evidence
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import contents, read_table
from palpate.instrument.uncertainty import budget
from palpate.procedures.console.terminal import silent
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


def read_csv(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Data of the one line whose label begins so."""
    (found,) = [each for each in axes.get_lines() if str(each.get_label()).startswith(label)]
    return np.asarray(found.get_xdata(), dtype=float), np.asarray(found.get_ydata(), dtype=float)


# --- the page ------------------------------------------------------------------------------------------


def test_everything_is_measured_judged_and_on_one_page(whole: Whole) -> None:
    scenes = [arrangement.scene for arrangement in chapter5.ARRANGEMENTS]
    sweeps = [(scene, *by) for scene, procedure, *by in whole.opened if procedure == "sweep-loads"]
    assert sweeps == [
        (scene, *by) for by in ((None, None), ("surface", "physical"), ("surface", "identified")) for scene in scenes
    ]
    assert [procedure for _, procedure, *_ in whole.opened[9:]] == ["calibrate-load-cell", *2 * ["test-modulus"]]
    assert whole.done.orders == {"single": True, "common_base": True, "different_base": True}
    tables = whole.done.all_tables()
    assert {table.number for table in tables if table.again} == {"5.5", "5.6", "5.8", "5.8 (definitions)", *REPEATS}
    for table, file in whole.done.tables:
        rows = read_csv(file)
        assert len(rows) == len(table.rows)
        assert {"printed", "thesis", "repaired", "ours", "difference", "error_percent_of_theory"} <= rows[0].keys()
        columns = read_table(table.number).columns if table.arrangement else {}
        assert {*columns} <= {row.quantity for row in table.rows}
    assert whole.page.count("blind run, ") == 6
    assert "SIMULATED" in whole.page


def test_each_class_is_counted_alone_and_a_row_that_is_repeated_once(whole: Whole) -> None:
    """Nowhere is there a count over all classes."""
    summary, tables, verdicts = whole.done.summary(), whole.done.all_tables(), whole.done.verdicts()
    once = [row.within for table in tables if not table.again for row in table.judged]
    counted = {name: (one["judged"], one["within"]) for name, one in summary["evidence"].items()}
    assert [sum(each) for each in zip(*counted.values(), strict=True)] == [len(once), sum(once)]
    written = {
        one["class"]: (int(one["judged"]), int(one["within"]))
        for one in read_csv(whole.done.models.folder / "classes.csv")
    }
    assert written == counted
    assert len(summary["outside"]) == sum(row.within is False for table in tables for row in table.rows)
    for evidence, verdict in verdicts.items():
        section = whole.page.partition(f"<h3>{evidence.value.capitalize()}</h3>")[2].partition("</div>")[0]
        assert escape(verdict.counted()) in section and escape(REQUIRED[evidence]) in section
    assert f" of {len(once)} rows" not in whole.page


def test_a_row_shows_its_class_in_a_word_and_the_legend_says_what_it_means(whole: Whole) -> None:
    for each in Evidence:
        assert f'<tr class="{each.value}"><td><b>{each.value}</b><td>{escape(each.meaning)}' in whole.page
        assert re.search(
            rf'<tr class="{each.value}[ a-z]*"[^>]*>(<td>[^<]*</td>){{3}}<td>{each.value}</td>', whole.page
        )


def test_the_terminal_has_the_tables_and_verdicts_and_leaves_the_rest_to_the_page(
    whole: Whole, capsys: pytest.CaptureFixture[str]
) -> None:
    print_everything(whole.done)
    said = capsys.readouterr().out
    lines, tables = said.splitlines(), whole.done.all_tables()
    assert len(lines) < len(tables) + 45
    assert [line for verdict in whole.done.verdicts().values() for line in verdict.brief() if line not in said] == []
    first = {line.split()[0].rstrip("*") for line in lines if line.split()}
    assert first >= {table.number for table in tables if " " not in table.number}
    assert f"page      {whole.done.page}" in said


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


def test_the_page_needs_no_other_file_and_its_links_lead_to_every_table_and_part(whole: Whole) -> None:
    """What is counted elsewhere is marked."""
    assert re.findall(r'(?:src|href)="(?!data:|#)', whole.page) == []
    places, linked = (re.findall(rf'{key}="{mark}([^"]*)"', whole.page) for key, mark in (("id", ""), ("href", "#")))
    assert len(set(places)) == len(places)
    assert {anchor(part) for part in PARTS} <= set(linked) <= set(places)
    overview, tables = whole.page.partition('id="table-by-table"')[2].partition("<h1")[0], whole.done.all_tables()
    assert overview.count("<a href=") == len(tables)
    assert len(re.findall(r"</a> \*</td>", overview)) == sum(table.again for table in tables)
    assert [each for table in tables for each in counts(table).values() if f"<td>{each}</td>" not in overview] == []


def test_what_stands_on_the_page_is_escaped(tmp_path: Path) -> None:
    cell = replace(row(1.0, 1.0, 0.1, reason='"quoted" <b>'), row="<u>")
    table = RowTable('9.9 <i> "', "a & b", "<script>", (cell,), ("x < y",))
    page = write_page(Everything(Reproduction(tmp_path), [(table, tmp_path / "none.csv")]), tmp_path).read_text()
    assert "<script>" not in page
    heading = 'id="table-9.9-&lt;i&gt;-&quot;">Table 9.9 &lt;i&gt; &quot;: a &amp; b'
    shown = (heading, "&quot;quoted&quot; &lt;b&gt;", "x &lt; y", "<td>&lt;u&gt;</td>")
    assert [text for text in shown if text not in page] == []


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
    """No curve beside experiments is fitted, whatever it was fitted to among the theories."""
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
    for figure in WITH_THEORIES:
        (axes,) = whole.panels(figure.number)
        curves = [label for each in axes.get_lines() if ": " in (label := str(each.get_label())) and "ours" in label]
        assert curves and all(label.rstrip(")").endswith("predicted") for label in curves)
        benches = [str(each.get_label()) for each in axes.containers]
        assert benches[0].endswith(": bench, input")
        assert benches[1:] == ["ours: bench by physical set, predicted", "ours: bench by identified set, predicted"]


def test_the_right_panel_is_ours_less_the_thesis(whole: Whole) -> None:
    left, right = whole.panels("Figure 4.13")
    marks, curve = line(left, "thesis, 3D"), line(left, "ours, 3D, ring 24 kPa: identified")
    between = np.interp(np.log(marks[0]), np.log(curve[0]), curve[1])
    differences = [np.asarray(each.get_ydata(), dtype=float) for each in right.get_lines()]
    alike = [d for d in differences if len(d) == len(marks[0]) and np.abs(d - (between - marks[1])).max() < 2e-3]
    assert len(alike) == 1


def test_area_ratios_end_at_the_share_of_the_tooth_and_at_one_and_over_lambda_both_rings_fall_on_one_curve(
    whole: Whole,
) -> None:
    (axes,) = whole.panels("Figure 4.4")
    for ratio in AREA_RATIOS:
        lambdas, ratios = line(axes, f"A = {ratio:g}: columns")
        assert ratios == pytest.approx((1 + lambdas) / (1 + ratio + lambdas))
    wide = with_area_ratio(get_design("single"), 20.0)
    assert springs.ratio_of_modulus(wide, 1e-3, 3e-3) == pytest.approx(1 / 21, rel=1e-5)
    left, _ = whole.panels("Figure 4.7")
    soft, stiff = (line(left, f"ours, 3D, ring {ring} kPa: identified") for ring in (24, 33))
    assert (axes.get_xscale(), "λ" in left.get_xlabel()) == ("log", True)
    assert soft[0][0] == pytest.approx(14.9e3 / 24e3 * 3.88 / 3)
    assert np.interp(np.log(soft[0]), np.log(stiff[0]), stiff[1]) == pytest.approx(soft[1], abs=2e-3)


def test_orders_have_the_thesis_left_ours_right_and_show_who_changes_places(whole: Whole) -> None:
    for design, (number, source) in BY_RATIO.items():
        (axes,) = whole.panels(number)
        texts = [text.get_text() for text in axes.texts]
        samples = re.findall(r"sample (\d)", " ".join(texts))
        ratios = get_design(design).thesis_force_ratio
        assert tuple(samples[:6]) == get_design(design).thesis_softness_order
        assert samples[6:] == sorted(ratios, key=lambda name: -ratios[name])
        moved = {str(each.get_color()) for each in axes.get_lines()} - {"k"}
        assert bool(moved) == (number == "Figure 5.4")
        assert {f"{ratio:.3f}" for ratio in read_table(source).values("force_ratio")} <= {t.split()[-1] for t in texts}


def test_experiments_are_squares_circles_and_diamonds_at_the_samples_moduli(whole: Whole) -> None:
    (axes,) = whole.panels("Figure 5.6")
    found = {str(each.get_marker()) for each in axes.get_lines() if str(each.get_label()).startswith("thesis")}
    assert found == {"s", "o", "D"}
    for words, design in (("single sensor", "single"), ("different bases", "different_base")):
        thesis = get_design(design).thesis_force_ratio
        assert dict(zip(*line(axes, f"thesis, {words}"), strict=True)) == {
            SAMPLES[name].modulus: thesis[name] for name in thesis
        }
    measured = {each.get_label(): each.lines for each in axes.containers}
    (ours, _, (bars,)), found = measured["ours, single sensor: bench, input"], swept(chapter5.ARRANGEMENTS[0]).samples
    assert ours.get_xydata().tolist() == [[SAMPLES[each.sample].modulus, each.force_ratio] for each in found]
    lengths = [high - low for (_, low), (_, high) in bars.get_segments()]
    assert lengths == pytest.approx([2 * (each.force_ratio_u or 0) for each in found])


def test_no_legend_is_cut_off(whole: Whole) -> None:
    papers = [
        (figure.bbox, legend.get_window_extent()) for figure in whole.figures.values() for legend in figure.legends
    ]
    assert [(box.x0, box.x1) for paper, box in papers if box.x0 < paper.x0 or box.x1 > paper.x1] == []
