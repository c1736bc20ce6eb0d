"""The command line in this process, sweeps on an open bench, and things that happen in the middle of one."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click
import pytest

import palpate as package
from palpate import get_design
from palpate.extend import Bench, Lab, Recorder, Scene, read_scene
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.commands import main
from palpate.procedures.commands.options import Output
from palpate.procedures.commands.root import palpate as root
from palpate.procedures.console.terminal import Progress, silent
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab import open as session
from palpate.procedures.lab import operator
from palpate.procedures.measurements.loads import LoadSweep, SweepResult
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import NEVER
from palpate.testing import steps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADER = {"procedure": "sweep-loads", "simulated": True, "started": "2025-03-14T15:09:26Z"}

# Nothing but the converter: what is left is the model, the chain and the arithmetic.
IDEAL_SCENE = """
name = "ideal"
purpose = "Everything exact but the converter."
design = "single"

[effects.adc]
"""

# The indicator has no zero offset and four decimals, as in the ideal scene.
IDEAL_CALIBRATION = THESIS_LOAD_CELL.model_copy(
    update={"sensitivity_mV_per_N": 10.306, "zero_mV": 0.0, "resolution_mV": 1e-4}
)


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Figure]]:
    """The figures that are saved, drawn but not written."""
    saved: list[Figure] = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: saved.append(figure))
    yield saved
    for figure in saved:
        figure.draw_without_rendering()


# --- the command line ----------------------------------------------------------------------------------


def changed(words: Sequence[str], *options: str) -> tuple[str, ...]:
    """A command line with some options of one value each in the place of its own, which it would refuse beside them."""
    kept = list(words)
    for option in set(options) & set(words):
        at = kept.index(option)
        del kept[at : at + 2]
    return (*kept, *options)


@dataclass(frozen=True, slots=True)
class Spoken:
    """What a command said, and its exit status."""

    status: object
    out: str
    err: str

    @property
    def object(self) -> dict[str, Any]:
        """The one JSON object on stdout of a command that succeeded."""
        assert self.status == 0, self.err
        value: dict[str, Any] = json.loads(self.out)
        assert isinstance(value, dict)
        return value

    @property
    def complaint(self) -> str:
        """The one message of a command that failed, which said nothing else."""
        assert self.out == ""
        assert "Traceback" not in self.err
        assert [line.startswith("palpate: ") for line in self.err.splitlines()].count(True) == 1, self.err
        assert self.err.startswith("palpate: error: ")
        return self.err.removeprefix("palpate: error: ").rstrip("\n")

    @property
    def refusal(self) -> str:
        """The one message of a command that was refused for what it was given."""
        assert self.status == 2, self.err
        return self.complaint


Palpate = Callable[..., Spoken]


@pytest.fixture
def palpate(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, nothing_left_behind: None
) -> Palpate:
    """Runs `palpate` with some arguments in an empty folder, without a process of its own.

    An empty file stands for each plot: drawing one takes as long as measuring six points.
    """
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _figure, path, **_: Path(path).touch())
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)

    def run(*arguments: str) -> Spoken:
        monkeypatch.setattr(sys, "argv", ["palpate", *arguments])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return Spoken(ended.value.code, said.out, said.err)

    return run


def said_once(folder: Path, *arguments: str) -> dict[str, Any]:
    """The JSON object of `palpate` with some arguments in a folder, for tests that share it; it says nothing else."""
    out, err = StringIO(), StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.delenv("PALPATE_STORE", raising=False)
        patch.setattr(sys, "argv", ["palpate", *arguments, "--json"])
        with pytest.raises(SystemExit) as ended:
            main()
    assert err.getvalue() == ""
    return Spoken(ended.value.code, out.getvalue(), err.getvalue()).object


@pytest.fixture(scope="session")
def default_sweep(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """`palpate sweep loads --json`, once for all tests."""
    return said_once(tmp_path_factory.mktemp("default"), "sweep", "loads")


class Benches(list[SimulatedBench]):
    """The simulated benches that commands open, each doctored before it is used."""

    @staticmethod
    def doctor(sim: SimulatedBench) -> None:
        pass


@pytest.fixture
def benches(monkeypatch: pytest.MonkeyPatch) -> Benches:
    opened = Benches()

    class Doctored(SimulatedBench):
        def __enter__(self) -> Self:
            super().__enter__()
            opened.append(self)
            opened.doctor(self)
            return self

    monkeypatch.setattr(session, "simulated_bench", Doctored)
    return opened


@pytest.fixture
def on_progress(monkeypatch: pytest.MonkeyPatch) -> Callable[[Progress], None]:
    """Has a function called with every progress that a command reports."""

    def install(report: Progress) -> None:
        @contextmanager
        def progress(_self: Output) -> Iterator[Progress]:
            yield report

        monkeypatch.setattr(Output, "progress", progress)

    return install


@pytest.fixture
def lab(sim: SimulatedBench, palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> str:
    """The file of a bench that is served here; what is not real about it is the clock, and who mounts samples.

    Somebody sits at its terminal; what he types is `sys.stdin`.
    """

    class Person(session.ConsoleOperator):
        def mount(self, sample: Sample) -> None:
            super().mount(sample)
            sim.operator.mount(sample)

        def mount_anew(self, sample: Sample) -> None:
            super().mount_anew(sample)
            sim.operator.mount(sample)

    monkeypatch.setattr(session, "WallClock", lambda _begun: sim.clock)
    monkeypatch.setattr(session, "ConsoleOperator", Person)
    monkeypatch.setattr(operator, "at_terminal", lambda: sys.stdin is not None)
    Path("lab.toml").write_text(sim.description.patient().to_toml(), encoding="utf-8")
    return "lab.toml"


def refused(said: Spoken, benches: Benches) -> str:
    """The complaint about a wrong request: no bench was opened, and nothing was written."""
    assert said.status == 2, said.err
    assert (benches, list(Path().iterdir())) == ([], [])
    return said.complaint


def commands(group: click.Group = root, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command and group, by its words after `palpate`."""
    yield path, group
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


# --- without the command line --------------------------------------------------------------------------


def sweep(
    bench: Bench,
    folder: Path,
    samples: tuple[str, ...] = ("1", "2"),
    loads: tuple[float, ...] = (2.0, 3.0),
    dwell: float = 1.0,
    frequency: float = 10.0,
    calibration: LoadCellCalibration = THESIS_LOAD_CELL,
    progress: Progress = silent,
    extrapolate: bool = False,
) -> SweepResult:
    """A sweep on an open bench, recorded in `folder`."""
    asked = LoadSweep(samples, loads, dwell, frequency, extrapolate=extrapolate)
    with Recorder.create(folder, HEADER, steps(progress)) as record:
        result = conduct(asked, Lab(bench, get_design("single"), calibration), record)
        record.finish("complete", result.summary())
    return result


def sweep_scene(scene: Scene, folder: Path, **settings: Any) -> SweepResult:
    """A sweep on the bench of a scene."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        return sweep(bench, folder, **settings)


def scene_of(text: str, folder: Path) -> Scene:
    """The scene that a TOML text describes."""
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return read_scene(str(path))


# --- what happens in the middle ------------------------------------------------------------------------


class _Happening:
    """One moment on the virtual clock."""

    def __init__(self, at_ns: int, action: Callable[[], object]) -> None:
        self._at_ns = at_ns
        self._action = action

    def next_event_ns(self) -> int:
        return self._at_ns

    def advance(self, _start_ns: int, end_ns: int) -> None:
        if end_ns >= self._at_ns:
            self._at_ns = NEVER
            self._action()


def happens_in(sim: SimulatedBench, delay: float, action: Callable[[], object]) -> None:
    """Calls `action` when the bench's clock has gone on by `delay` s."""
    sim.clock.add(_Happening(sim.clock.now_ns() + round(delay * 1e9), action))


def outputs(sim: SimulatedBench) -> tuple[bool, bool, float]:
    """Amplifier enabled, generator's relay closed, generator's amplitude in V."""
    generator = sim.generator.settings
    return bool(sim.amplifier.settings["enable"]), bool(generator["output"]), generator["amplitude"]


OFF = (False, False, 0.0)


@pytest.fixture
def own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs and calibrations of a test are stored for it alone: what it stores must change no other test."""
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path / "store"))


def interrupt_at(points: int) -> Progress:
    """A progress that ends its run by Ctrl-C when it reports so many points."""

    def stop(done: int, _total: int, _what: str) -> None:
        if done == points:
            raise KeyboardInterrupt

    return stop


def resumed_digest(asked: package.Procedure[Any, Any, Any], scene: str, after: int, folder: Path) -> str:
    """Of a run that is cut after so many points, and resumed."""

    with pytest.raises(KeyboardInterrupt), package.open_bench(scene=scene) as bench:
        package.run(asked, bench, out=folder / "cut", listeners=[steps(interrupt_at(after))])
    return package.resume(folder / "cut", type(asked)).run.digest()


def resumes_to_the_same(asked: package.Procedure[Any, Any, Any], scene: str, after: int, folder: Path) -> bool:
    """Whether a run that is cut after so many points resumes to the digest of one that is not cut."""
    with package.open_bench(scene=scene) as bench:
        whole = package.run(asked, bench, out=folder / "whole")
    return resumed_digest(asked, scene, after, folder) == whole.run.digest()
