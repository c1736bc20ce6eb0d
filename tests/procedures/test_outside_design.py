"""A sensor design of a package that palpate knows nothing of: scenes and benches name it, records say whose it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.lab.about import added_by
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.conftest import Install

WIDE = """
from dataclasses import replace
from palpate.instrument.sensor.designs import SINGLE
DESIGN = replace(SINGLE, name="wide", ring=replace(SINGLE.ring, outer_radius=4.5e-3), thesis_force_ratio={})
"""
ODD = """
from wide_designs import DESIGN, replace
DESIGN = replace(DESIGN, name="odd", films=DESIGN.films[:1])
"""


@pytest.fixture
def wide(install: Install) -> None:
    places = {"wide": "wide_designs:DESIGN", "odd": "odd_designs:DESIGN"}
    install("acme", "palpate.designs", places, wide_designs=WIDE, odd_designs=ODD)


@pytest.mark.usefixtures("wide")
def test_a_scene_and_a_bench_name_it_and_a_record_says_whose_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\npurpose = "Mine."\ndesign = "wide"\nmodel = "column"\n', encoding="utf-8")
    scene = read_scene(str(path))
    assert scene.design.ring.outer_radius == 4.5e-3
    with SimulatedBench(scene) as sim:
        assert sim.description.design == "wide"
        assert added_by(sim.description, scene) == {"acme": "1.2"}
        tables = sim.description.model_dump(mode="json", exclude_none=True)
    with pytest.raises(ConfigError, match=r"bench.toml: design: .*unknown design 'wine' \(did you mean 'wide'\?\)"):
        check({**tables, "design": "wine"}, BenchDescription, "bench.toml")


@pytest.mark.usefixtures("wide")
def test_what_cannot_be_a_design_is_refused_and_hinders_no_other(install: Install) -> None:
    install("lost", "palpate.designs", {"lost": "no_such_designs:LOST", "other": "wide_designs:DESIGN"})
    with pytest.raises(ConfigError, match=r"^design 'lost' of lost 1.2 \(no_such_designs:LOST\): cannot be loaded"):
        get_design("lost")
    with pytest.raises(ConfigError, match=r"^design 'other' of lost 1.2 .*is no Design that is called 'other'"):
        get_design("other")
    with pytest.raises(
        ConfigError, match=r"^design 'odd' of acme 1.2 .*RangeError: design 'odd': film 'rigid': there must"
    ):
        get_design("odd")
    with pytest.raises(UnknownName, match=r"valid: .*single, .*wide"):
        get_design("none")
    assert get_design("wide").name == "wide"
