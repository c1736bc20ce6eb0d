"""`palpate new` makes packages that pass their tests as they stand, and writes over nothing."""

from __future__ import annotations

import keyword
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy.fft  # noqa: F401  (it can be loaded once, and what a test with `pytester` imports is forgotten with it)
import pytest

import palpate.testing  # noqa: F401
from palpate.instrument.errors import UsageError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.templates.new_files import new_bench, new_device, new_package
from tests.conftest import Install
from tests.procedures.conftest import Palpate

pytest_plugins = ["pytester"]

NEW: dict[str, Callable[[str, Path], list[Path]]] = {
    "device": lambda name, folder: new_device(name, "modbus-tcp", "sensor", folder),
    "design": partial(new_package, "design"),
    "effect": partial(new_package, "effect"),
    "procedure": partial(new_package, "procedure"),
    "bench": lambda name, folder: new_bench(name, (), folder),
}


def conform(pytester: pytest.Pytester, test: Path, *choice: str) -> pytest.RunResult:
    """One file of tests, in this process, with the fixtures of palpate's plugin."""
    import pint  # noqa: F401  (what an inner session imports is forgotten with it, and dask comes with pint)

    alone = pytester.makefile(".ini", pytest="")  # else a project's in a folder above, such as one that $TMPDIR lies in
    options = ("--disable-plugin-autoload", "--import-mode=importlib", "-p", "tests.conftest", "-c", str(alone))
    return pytester.runpytest_inprocess(*options, *choice, str(test))


@pytest.fixture
def installed(install: Install, monkeypatch: pytest.MonkeyPatch) -> Callable[[list[Path]], Path]:
    """Puts a written package where Python finds it, as `pip install -e` does; gives its test."""

    def put(files: list[Path]) -> Path:
        project = tomllib.loads(files[0].read_text(encoding="utf-8"))["project"]
        for group, entries in project["entry-points"].items():
            install(project["name"].replace("-", "_"), group, entries)
        monkeypatch.syspath_prepend(str(files[0].parent))
        return files[-1]

    return put


Put = Callable[[list[Path]], Path]

# --- packages ------------------------------------------------------------------------------------------


@pytest.mark.slow  # time-outs
@pytest.mark.parametrize(
    ("bus", "kind"),  # CI installs a sensor on Modbus RTU and a CANopen actuator, and runs their tests
    [("modbus-tcp", "registers"), ("canopen", "sensor")],
)
def test_a_device_passes_as_it_stands(
    bus: str, kind: str, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    name = f"gauge_{bus[-3:]}_{kind[:5]}"  # of its own: what a package has imported stays
    found = conform(pytester, installed(new_device(name, bus, kind, tmp_path))).parseoutcomes()
    assert found.keys() <= {"passed", "skipped"}
    assert found["passed"] >= 19


@pytest.mark.parametrize("bus", ["modbus-tcp", "canopen"])
@pytest.mark.parametrize(
    "kind", ["sensor", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("actuator", "registers"))]
)
def test_a_wrong_scale_does_not_pass(
    kind: str, bus: str, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    files = new_device(f"wrong_{bus[:3]}_{kind[:5]}", bus, kind, tmp_path)
    text = files[1].read_text(encoding="utf-8")
    assert '"V", 1e-6' in text
    files[1].write_text(text.replace('"V", 1e-6', '"V", 1e-5'), encoding="utf-8")
    conform(pytester, installed(files), "-k", "golden").stdout.fnmatch_lines(["FAILED *_travels_as_its_golden_frame*"])


@pytest.mark.slow
def test_an_effect_passes_as_it_stands_and_a_wrong_one_does_not(
    tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    pyproject, effect, test = new_package("effect", "cable_sag", tmp_path)
    installed([pyproject, effect, test])
    quick = ("-k", "loss or zero or name or gains")
    assert conform(pytester, test, *quick).parseoutcomes() == {"passed": 5, "deselected": 11}
    text = effect.read_text(encoding="utf-8")
    effect.write_text(text.replace("1 - self.loss", "1 - self.loss / 2"), encoding="utf-8")
    failed = conform(pytester, test, *quick)
    failed.stdout.fnmatch_lines(["FAILED *::test_it_takes_its_loss_from_the_films_under_the_teeth_alone*"])


def test_a_design_passes_as_it_stands_and_has_nothing_of_the_thesis(
    tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    test = installed(new_package("design", "grasper_7", tmp_path))
    assert conform(pytester, test).parseoutcomes() == {"passed": 1}
    design = get_design("grasper_7")
    assert (design.thesis_force_ratio, design.thesis_softness_order) == ({}, ())


@pytest.mark.parametrize("sweeps", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_bench_passes_as_it_stands_with_a_device_of_ones_own(
    sweeps: bool, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    installed(new_device("own_gauge", "canopen", "sensor", tmp_path))
    *_, test = new_bench("corner", ("sample_changer", "own-gauge"), tmp_path)
    found = conform(pytester, test.parents[1], *(() if sweeps else ("-k", "not sweep"))).parseoutcomes()
    assert found == ({"passed": 3} if sweeps else {"passed": 2, "deselected": 1})
    assert "[device.own_gauge]" in (tmp_path / "corner" / "scene.toml").read_text(encoding="utf-8")


# --- the command ---------------------------------------------------------------------------------------


def test_the_command_writes_into_a_folder_of_its_own_and_over_nothing(palpate: Palpate) -> None:
    spoken = palpate("new", "device", "force_gauge", "--bus", "modbus-rtu", "--kind", "sensor", "--json")
    names = ("pyproject.toml", "force_gauge.py", "tests/force_gauge.toml", "tests/test_force_gauge.py")
    assert spoken.object == {"files": [f"force_gauge/{name}" for name in names]}
    assert '"FORCE-GAUGE"' in Path("force_gauge/force_gauge.py").read_text(encoding="utf-8")
    for kind in NEW:
        refused = palpate("new", kind, "force_gauge")
        assert refused.status == 2
        assert refused.complaint == "force_gauge exists already; choose another name"
    said = palpate("new", "effect", "cable_sag").out
    assert said.startswith("cable_sag/pyproject.toml\n")
    assert "\n  pytest cable_sag\n\nThen put in your physics" in said


NO_NAMES = (
    "", "Oven", "2nd_oven", "oven__2", "oven_", "../oven", "a/b", "oven\n", "a" * 21, "öfen", "ⅷ",
    *filter(str.islower, keyword.kwlist),
)  # fmt: skip


@pytest.mark.parametrize("kind", NEW)
def test_what_is_no_name_is_refused_and_what_exists_left_alone_even_a_link_to_nothing(
    kind: str, tmp_path: Path
) -> None:
    for name in NO_NAMES:
        with pytest.raises(UsageError, match="is no name of a"):
            NEW[kind](name, tmp_path)
    (tmp_path / "oven_7").symlink_to("nowhere")
    with pytest.raises(UsageError, match=r"exists already; choose another name|begins with a letter"):
        NEW[kind]("oven_7", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["oven_7"]


@pytest.mark.parametrize(
    ("kind", "name", "why"),
    [
        ("device", "positioner", "palpate or an installed package has one of that name"),
        ("device", "acme_oven", "palpate or an installed package has one of that name"),
        ("effect", "white_noise", "palpate or an installed package has one of that name"),
        ("procedure", "sweep_loads", "palpate or an installed package has one of that name"),
        ("device", "json", "there is a Python module of that name already"),
        ("effect", "numpy", "there is a Python module of that name already"),
        ("procedure", "tests", "there is a Python module of that name already"),
        ("device", "path", "a class Path is used in its files already"),
        ("effect", "question", "a class Question is used in its files already"),
        ("procedure", "recorder", "a class Recorder is used in its files already"),
        ("effect", "sag_2", "a word of an effect's name begins with a letter; write 'sag2'"),
    ],
)
def test_a_name_that_means_something_else_is_refused(
    kind: str, name: str, why: str, tmp_path: Path, install: Install
) -> None:
    install("acme", "palpate.devices", {"acme-oven": "acme:KIND"})
    with pytest.raises(UsageError, match=f"^{name!r}: {why}"):
        NEW[kind](name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_bench_with_a_device_that_cannot_be_is_refused(palpate: Palpate) -> None:
    for words, why in (
        (("--device", "oven"), "unknown kind of device 'oven'; valid: "),
        (("--device", "positioner"), "--device positioner: every bench has one; leave it out"),
        (2 * ("--device", "sample_changer"), "--device sample_changer: give a kind once; copy its section"),
    ):
        assert palpate("new", "bench", "corner", *words).complaint.startswith(why)
    assert not Path("corner").exists()


def test_no_two_names_give_one_identity(tmp_path: Path) -> None:
    """Whole names are coded, not their initials."""
    found = set()
    for name in ("force_gauge", "fine_gauge", "force_gauge2"):
        for bus in ("modbus-tcp", "canopen"):
            files = new_device(name, bus, "sensor", tmp_path / bus)
            lines = files[1].read_text(encoding="utf-8").splitlines()
            found |= {line for line in lines if line.startswith(("CONTRACT =", "VENDOR, PRODUCT"))}
    assert len(found) == 9  # on CANopen two lines each
