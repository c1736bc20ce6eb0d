"""What `palpate model ratio`, `modulus` and `plot` all refuse: one error, exit 2, nothing solved or written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from shutil import copyfile

import pytest

from palpate.instrument.models import surface
from palpate.instrument.models.curve import ratio_curve
from tests.procedures.conftest import Palpate

COMMANDS = {
    "ratio": ("model", "ratio", "--sensed-modulus", "100 kPa"),
    "modulus": ("model", "modulus", "--force-ratio", "0.3"),
    "plot": ("model", "plot", "--sensed-modulus", "100 kPa", "--out", "new.png"),
}


def refused(palpate: Palpate, command: str, *wrong: str) -> str:
    """The one line of the error."""
    said = palpate(*COMMANDS[command], *wrong)
    assert (said.status, said.out) == (2, "")
    assert len(said.complaint.splitlines()) == 1
    assert not list(Path().iterdir())
    return said.complaint


@pytest.fixture
def surfaces(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of stored surfaces, still empty."""
    folder = tmp_path_factory.mktemp("surfaces")
    surface.read_surface.cache_clear()
    ratio_curve.cache_clear()
    monkeypatch.setattr(surface, "STORED", folder)
    yield folder
    surface.read_surface.cache_clear()
    ratio_curve.cache_clear()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--sensed-thickness", "-3 mm", "--sensed-thickness: '-3 mm' is not above 0 and finite"),
        ("--sensed-thickness", "1e999 mm", "is not finite"),
        ("--sensed-poisson", "-1", "Poisson ratio -1 of sample 'sensed object' is not above -1 and at most 0.5"),
        ("--compliant-poisson", "0.50001", "Poisson ratio 0.50001 of neoprene of the compliant ring is outside"),
        ("--compliant-modulus", "0 Pa", "--compliant-modulus: '0 Pa' is not above 0 and finite"),
        ("--compliant-modulus", "1e999 Pa", "is not finite"),
        ("--plate-modulus", "-70 MPa", "--plate-modulus: '-70 MPa' is not above 0 and finite"),
        ("--interface", "glued", "unknown interface 'glued'"),
    ],
)
def test_a_value_outside_its_limits(palpate: Palpate, command: str, option: str, value: str, message: str) -> None:
    assert message in refused(palpate, command, "--model", "column", option, value)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_tolerance_that_no_model_meets_names_the_best_there_is(palpate: Palpate, command: str) -> None:
    complaint = refused(palpate, command, "--tolerance", "1e-9")
    assert "tolerance 1e-09: no model meets it for design 'single'" in complaint
    assert "the best is 'surface', ± 0.0" in complaint and "; give --tolerance 0.0" in complaint


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("tolerance", ["0", "-1e-3", "1e999"])
def test_a_tolerance_that_is_none(palpate: Palpate, command: str, tolerance: str) -> None:
    complaint = refused(palpate, command, "--tolerance", tolerance)
    assert "is not above 0; give" in complaint or "is no share; give" in complaint


def shipped(design: str) -> list[Path]:
    """Files of the curves that come with palpate."""
    found = sorted(Path(surface.__file__).with_name("curves").glob(f"{design}.*"))
    assert found
    return found


@pytest.mark.parametrize("command", COMMANDS)
def test_a_surface_of_another_design(palpate: Palpate, command: str, surfaces: Path) -> None:
    for one, other in zip(shipped("common_base"), shipped("single"), strict=True):
        copyfile(one, surfaces / other.name)
    complaint = refused(palpate, command, "--model", "surface")
    assert "it was written for something else, or by another version" in complaint and "build it again" in complaint


@pytest.mark.parametrize("command", COMMANDS)
def test_a_surface_cut_off_in_its_file(palpate: Palpate, command: str, surfaces: Path) -> None:
    for path in shipped("single"):
        (surfaces / path.name).write_bytes(path.read_bytes()[:1000])
    complaint = refused(palpate, command, "--model", "surface")
    assert f"curve {surfaces}" in complaint and "not readable" in complaint and "build it again" in complaint


def test_a_surface_for_an_object_that_it_does_not_know(palpate: Palpate) -> None:
    complaint = refused(palpate, "ratio", "--model", "surface", "--sensed-thickness", "2 mm")
    assert "has no surface for design 'single' with these dimensions, materials and load" in complaint
    assert "ask model 'solid'" in complaint
