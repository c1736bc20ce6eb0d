"""The files of a new device, effect or procedure pass their tests as they stand, and nothing is written over."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pint  # noqa: F401  (what an inner session imports is forgotten with it, and dask comes with pint)
import pytest

import palpate.drivers.devices
import palpate.instrument.contracts
import palpate.procedures
import palpate.simulators.devices
import palpate.simulators.effects
import palpate.testing
from palpate.instrument import additions as modules
from palpate.instrument.bench import kinds
from palpate.instrument.errors import UsageError
from palpate.procedures.templates.new_device import BUSES, FILES, new_device, new_package
from palpate.procedures.templates.new_files import EFFECT, PROCEDURE, new_effect, new_procedure
from tests.procedures.conftest import Palpate

pytest_plugins = ["pytester"]


PACKAGES = {
    "drivers/devices": palpate.drivers.devices,
    "simulators/devices": palpate.simulators.devices,
    "simulators/effects": palpate.simulators.effects,
    "instrument/contracts": palpate.instrument.contracts,
    "procedures": palpate.procedures,
}


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A source tree with nothing in it, whose modules can be imported and are forgotten again."""
    for place in (FILES | EFFECT | PROCEDURE).values():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
    before = {package: set(vars(package)) for package in PACKAGES.values()}
    for folder, package in PACKAGES.items():
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path / folder)])
    yield tmp_path
    for package, names in before.items():
        for name in set(vars(package)) - names:
            delattr(package, name)


def conform(pytester: pytest.Pytester, test: Path, *choice: str) -> pytest.RunResult:
    """One file of tests, in this process, with the fixtures of all."""
    alone = pytester.makefile(".ini", pytest="")  # else a project's in a folder above, such as one that $TMPDIR lies in
    options = ("--disable-plugin-autoload", "--import-mode=importlib", "-p", "tests.conftest", "-c", str(alone))
    return pytester.runpytest_inprocess(*options, *choice, str(test))


@pytest.mark.parametrize(
    ("bus", "passed"),
    [("modbus-tcp", 21), pytest.param("modbus-rtu", 22, marks=pytest.mark.slow), ("canopen", 18)],  # time-outs
)
def test_the_files_pass_as_they_stand(
    bus: str, passed: int, tree: Path, pytester: pytest.Pytester, nothing_left_behind: None
) -> None:
    files = new_device("force_gauge", bus, tree)
    assert conform(pytester, files[-1]).parseoutcomes() == {"passed": passed}


def test_a_new_effect_passes_as_it_stands_and_a_wrong_one_does_not(tree: Path, pytester: pytest.Pytester) -> None:
    effect, test = new_effect("cable_sag", tree)
    assert conform(pytester, test).parseoutcomes() == {"passed": 5}
    effect.write_text(
        effect.read_text(encoding="utf-8").replace("1 - self.loss", "1 - self.loss / 2"), encoding="utf-8"
    )
    failed = conform(pytester, test)
    failed.stdout.fnmatch_lines(["FAILED *::test_it_takes_its_loss_from_the_films_under_the_teeth_alone*"])


def test_a_new_procedure_passes_as_it_stands(tree: Path, pytester: pytest.Pytester) -> None:
    assert conform(pytester, new_procedure("repeatability", tree)[-1]).parseoutcomes() == {"passed": 5}


@pytest.mark.parametrize(("bus", "passed"), [("modbus-tcp", 22), ("modbus-rtu", 23)])
@pytest.mark.slow  # time-outs
def test_a_package_passes_as_it_stands(
    bus: str, passed: int, tmp_path: Path, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"gauge_{bus[-3:]}"  # of its own: what a package has imported stays
    *_, test = new_package(name, bus, tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path / name))
    entries = [EntryPoint(name.replace("_", "-"), f"{name}:KIND", kinds.GROUP)]
    monkeypatch.setattr(modules, "entry_points", lambda group: entries)
    modules.additions.cache_clear()
    assert conform(pytester, test).parseoutcomes() == {"passed": passed}
    modules.additions.cache_clear()


def test_a_package_is_written_into_a_folder_of_its_own_and_over_nothing(palpate: Palpate) -> None:
    spoken = palpate("new", "device", "force_gauge", "--json")
    names = ("pyproject.toml", "force_gauge.py", "tests/force_gauge.toml", "tests/test_force_gauge.py")
    assert spoken.object == {"files": [f"force_gauge/{name}" for name in names]}
    assert '"FORCE-GAUGE"' in Path("force_gauge/force_gauge.py").read_text(encoding="utf-8")
    refused = palpate("new", "device", "force_gauge")
    assert refused.status == 2
    assert refused.complaint == "force_gauge exists already; choose another name"


@pytest.mark.parametrize(
    ("bus", "claim"),
    [
        ("modbus-tcp", "test_every_register_travels_as_its_golden_frame"),
        ("canopen", "test_every_object_travels_as_its_golden_frames"),
    ],
)
def test_a_wrong_scale_does_not_pass(bus: str, claim: str, tree: Path, pytester: pytest.Pytester) -> None:
    contract, *_, test = new_device("force_gauge", bus, tree)
    contract.write_text(contract.read_text(encoding="utf-8").replace('"V", 1e-6)', '"V", 1e-5)'), encoding="utf-8")
    conform(pytester, test, "-k", claim).stdout.fnmatch_lines([f"FAILED *::{claim}*"])


@pytest.mark.parametrize("bus", BUSES)
def test_the_command_names_the_files(bus: str, palpate: Palpate) -> None:
    for place in (FILES | EFFECT | PROCEDURE).values():
        Path(place).parent.mkdir(parents=True, exist_ok=True)
    spoken = palpate("new", "device", "oven", "--bus", bus, "--json")
    assert spoken.object == {"files": [place.format("oven") for place in FILES.values()]}
    for kind, places in {"effect": EFFECT, "procedure": PROCEDURE}.items():
        assert palpate("new", kind, "oven", "--json").object == {
            "files": [each.format("oven") for each in places.values()]
        }
        Path(places[f"{kind}.py.txt"].format("oven")).unlink()
    refused = palpate("new", "device", "oven")
    assert refused.status == 2
    assert refused.complaint == "instrument/contracts/oven.py exists already; choose another name"


@pytest.mark.parametrize("name", ["", "Oven", "2nd_oven", "oven__2", "oven_", "../oven", "class", "a" * 21, "öfen"])
def test_what_is_no_name_is_refused(name: str, tree: Path) -> None:
    with pytest.raises(UsageError, match=f"^{name!r} is no name of a device: "):
        new_device(name, "modbus-tcp", tree)


@pytest.mark.parametrize(
    ("name", "bus"), [("wire", "modbus-tcp"), ("serial_line", "modbus-rtu"), ("can_link", "canopen")]
)
def test_a_name_that_its_files_need_for_something_else_is_refused(name: str, bus: str, tree: Path) -> None:
    with pytest.raises(UsageError, match=f"^{name!r}: a class .* is used in its files already"):
        new_device(name, bus, tree)
    assert not any(path.is_file() for path in tree.rglob("*"))


def test_a_file_that_exists_is_left_alone_and_nothing_else_is_written(tree: Path) -> None:
    golden = tree / "tests/golden/oven.toml"
    golden.write_text("mine", encoding="utf-8")
    with pytest.raises(UsageError, match=r"oven\.toml exists already; choose another name"):
        new_device("oven", "modbus-tcp", tree)
    assert [path for path in tree.rglob("*") if path.is_file()] == [golden]
    assert golden.read_text(encoding="utf-8") == "mine"


def test_a_folder_that_is_no_source_tree_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"is no source tree of palpate, .*--to"):
        new_device("oven", "modbus-tcp", tmp_path)
    assert list(tmp_path.iterdir()) == []
