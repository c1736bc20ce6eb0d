"""What the effects of a scene are worth: with ever fewer of them, what changes and what time is saved."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from palpate.procedures.console.progress import Progress
from palpate.procedures.showing.figure import new_figure, save_in_new
from palpate.procedures.showing.text import new_table, print_all, stamped
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.weights import DRAWS, PRICE, PRICE_OF, Subset, Weight, front, nested, weigh

PLOT = "scene.png"


@dataclass(frozen=True, slots=True)
class SceneFront:
    """The subsets of a scene's effects than which no other that was tried is both nearer to the scene and quicker.

    Attributes:
        scene: name of the scene.
        question: sample, load, frequency and dwell for which all was measured.
        weights: what each of the scene's effects changes and costs by itself.
        tried: the subsets that were tried, from all effects to none.
    """

    scene: str
    question: Question
    weights: tuple[Weight, ...]
    tried: tuple[Subset, ...]

    @classmethod
    def of(cls, name: str, question: Question, progress: Progress) -> Self:
        """Measure a scene by its name or file.

        Raises:
            ConfigError, UnknownName: the scene is wrong.
            EstimateError: the films of the scene give no force ratio.
        """
        scene = read_scene(name)
        weights = weigh(scene, question, progress=progress)
        return cls(scene.name, question, tuple(weights), tuple(nested(scene, question, weights, progress)))

    @property
    def front(self) -> list[Subset]:
        """The best of the tried subsets, from the nearest to the scene on."""
        return front(self.tried, self.question.dwell)

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        best = self.front
        return {
            "simulated": True,
            "scene": self.scene,
            "sample": self.question.sample,
            "load_N": self.question.load,
            "frequency_Hz": self.question.frequency,
            "dwell_s": self.question.dwell,
            "effects": [asdict(each) for each in self.weights],
            "subsets": [{**asdict(each), "change": each.change, "front": each in best} for each in self.tried],
        }


def print_front(found: SceneFront, plot: Path | None) -> None:
    """Print a line for each subset, with what was left out since the line before."""
    title = f"scene {found.scene}, sample {found.question.sample}: fewer effects, less time"
    table = new_table(
        stamped(True, title), "left out, also", "effects left", "force changes", "ratio changes", *PRICE, "on the front"
    )
    best, count, before = found.front, len(found.weights), set[str]()
    for each in found.tried:
        more = ", ".join(name for name in each.without if name not in before) or "nothing"
        table.add_row(
            more, str(count - len(each.without)), f"{each.force:.1e}", f"{each.ratio:.1e}", *each.price.told(),
            "yes" if each in best else "",
        )  # fmt: skip
        before = set(each.without)
    stay = ", ".join(each.name for each in found.weights if each.change is None)
    print_all(
        table,
        f"changes: root mean square of {DRAWS} draws, against the whole scene with the same noise",
        f"processor time: {PRICE_OF}",
        f"on the front: for {found.question.dwell:g} s of bench",
        *([f"always simulated, since the films do not show what they change: {stay}"] if stay else []),
        *([] if plot is None else [f"plot           {plot}"]),
    )


def plot_front(found: SceneFront, folder: Path) -> Path:
    """Draw `scene.png` in a folder: a row for each subset, with its changes on the left and its time on the right.

    Raises RecordError: the folder or the file cannot be written.
    """
    title = f"scene {found.scene}, sample {found.question.sample}: one effect after the other left out"
    figure, (left, right) = new_figure(True, 2, title)
    rows = range(len(found.tried))
    changes = [change for each in found.tried for change in (each.force, each.ratio) if change > 0]
    none = min(changes, default=1e-6) / 10  # a logarithmic axis has no place for 0
    for quantity, style in (("ratio", "C0o"), ("force", "C1s")):
        sizes = [getattr(each, quantity) for each in found.tried]
        left.plot([size or none for size in sizes], rows, style, ms=5, label=quantity)
    left.axvline(none, color="0.5", ls=":", lw=1)
    left.annotate("no change", (none, 0), xytext=(3, -3), textcoords="offset points", fontsize=7, va="top")
    left.set(xscale="log", xlabel="relative change against the whole scene")
    left.legend(fontsize=8)
    dwell = found.question.dwell
    right.barh(rows, [1e3 * each.price.seconds(dwell) for each in found.tried], height=0.6, color="0.6")
    right.set(xlabel=f"processor time of {dwell:g} s of bench (ms)")
    left.set_yticks(rows, ["all effects", *(f"- {each.without[-1]}" for each in found.tried[1:])], fontsize=8)
    right.set_yticks(rows, [""] * len(found.tried))
    for axes in (left, right):
        axes.set_ylim(len(found.tried) - 0.4, -0.6)
    return save_in_new(figure, folder, PLOT)
