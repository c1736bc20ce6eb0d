"""`palpate measure NAME` carries out any procedure that is known; the settings are its options."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields
from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate.procedures.commands.root import palpate as root
from palpate.procedures.console.terminal import Progress, silent
from palpate.procedures.engine.catalogue import SHIPPED, procedure_class
from palpate.procedures.engine.settings import asked_of
from palpate.procedures.records.run import Run
from tests.conftest import Install
from tests.procedures.conftest import Benches, Palpate, interrupt_at, refused
from tests.runs import rehash

RELAXATION = (Path(__file__).parents[1] / "examples" / "relaxation.py").read_text(encoding="utf-8")
GROUP = "palpate.procedures"
COMPLETING = {"_PALPATE_COMPLETE": "bash_complete", "COMP_CWORD": "2"}
RELAX = ("measure", "relaxation", "--scene", "ideal")


@pytest.fixture
def relaxation(install: Install) -> Path:
    """A package that palpate knows nothing of adds a procedure; where it stands."""
    return install("acme-lab", GROUP, {"relaxation": "acme_relaxation:Relaxation"}, acme_relaxation=RELAXATION)


# --- of a package --------------------------------------------------------------------------------------


def test_the_settings_of_a_packages_procedure_are_options_with_their_units(relaxation: Path, palpate: Palpate) -> None:
    said = " ".join(palpate("measure", "relaxation", "--help").out.split())
    assert [
        text
        for text in (
            "--sample TEXT [default: 2]",
            "--force <N> With which the probe presses. [default: 2 N]",
            "--readings INTEGER [default: 4]",
            "--bench FILE",
        )
        if text not in said
    ] == []


def test_it_is_planned_and_measures_and_interrupted_it_goes_on_and_its_log_is_replayed(
    relaxation: Path, palpate: Palpate, on_progress: Callable[[Progress], None]
) -> None:
    asked = (*RELAX, "--force", "200 gf", "--readings", "2")
    planned = palpate(*asked, "--dry-run", "--json").object
    assert (len(planned["points"]), planned["expected_seconds"]) == (2, 10)
    found = palpate(*asked, "--out", "whole", "--log", "log.pcapng", "--json").object
    assert [point["load_N"] for point in found["points"]] == pytest.approx([1.96, 1.96], rel=0.1)
    whole = Run.open(Path("whole"))
    assert whole.header["settings"] == {"sample": "2", "force": pytest.approx(1.96133), "readings": 2}

    on_progress(interrupt_at(1))
    assert (palpate(*asked, "--out", "cut").status, len(Run.open(Path("cut")).points())) == (130, 1)
    on_progress(silent)
    assert "procedure    relaxation, from acme-lab 1.2\n" in palpate("runs", "show", "cut").out
    rehash(Path("cut"), header=lambda header: header["versions"].update({"acme-lab": "1.1"}))
    changed = 'versions.acme-lab: "1.1" in the record, "1.2" now\nchange it back'
    assert changed in palpate("runs", "resume", "cut").complaint
    rehash(Path("cut"), header=lambda header: header["versions"].update({"acme-lab": "1.2"}))
    assert palpate("runs", "resume", "cut", "--quiet").status == 0
    assert palpate("bus", "replay", "log.pcapng", "--out", "again", "--quiet").status == 0
    assert (Run.open(Path("cut")).digest(), Run.open(Path("again")).points()) == (whole.digest(), whole.points())


ODD_VALUES = RELAXATION.replace("/ 1e9, self.load()", "/ 1e9, np.float32('nan')").replace(
    "from palpate.extend", "import numpy as np\nfrom palpate.extend"
)


def test_json_has_numbers_of_numpy_and_null_for_nan_as_the_record_has(install: Install, palpate: Palpate) -> None:
    install("acme-lab", GROUP, {"relaxation": "acme_odd_values:Relaxation"}, acme_odd_values=ODD_VALUES)
    found = palpate(*RELAX, "--readings", "1", "--out", "run", "--json").object
    assert (found["points"][0]["load_N"], found["relaxed"]) == (None, None)
    assert [point["load_N"] for point in Run.open(Path("run")).points()] == [None]


SHARED = """
@dataclass(frozen=True, kw_only=True)
class Resting(Relaxation):
    rest: Annotated[float, Setting("s", "Rest before each reading.")] = 0.0
class First(Resting):
    name = "first"
class Second(Resting):
    name = "second"
"""


def test_a_setting_of_a_base_class_is_an_option_of_all_its_procedures(install: Install, palpate: Palpate) -> None:
    names = {"first": "acme_shared:First", "second": "acme_shared:Second"}
    install("acme-lab", GROUP, names, acme_shared=RELAXATION + SHARED)
    for name in names:
        assert "--rest <s>" in palpate("measure", name, "--help").out
        assert "--rest: '1 N' is in N where s belongs" in palpate("measure", name, "--rest", "1 N").complaint


# --- what is refused -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("relaxaton",), "unknown procedure 'relaxaton' (did you mean 'relaxation'?); valid: calibrate-films, "),
        (("relaxation", "--force", "2"), "--force: '2' has no unit where N belongs; write for example '2 N'"),
        (("relaxation", "--force", "2 s"), "--force: '2 s' is in s where N belongs"),
        (("relaxation", "--readings", "2.5"), "--readings: '2.5' is no whole number; write for example '3'"),
        (("relaxation", "--force", "1 N", "--force", "2 N"), "--force is given 2 times"),
        (("relaxation", "--readings", "0"), "procedure 'relaxation' has no steps with these settings"),
        (("relaxation", "--readings", "0", "--dry-run"), "procedure 'relaxation' has no steps with these settings"),
        (
            ("sweep-loads", "--loads", "2 N:3 N"),
            "--loads: loads '2 N:3 N': give first:last:step",
        ),
    ],
)
def test_a_wrong_word_is_named_with_its_option(
    relaxation: Path, palpate: Palpate, benches: Benches, words: tuple[str, ...], message: str
) -> None:
    assert message in refused(palpate("measure", *words), benches)


HEAD = "from dataclasses import dataclass, field\nfrom typing import Annotated, Literal\nfrom palpate.extend import *\n"
KIND = "\n@dataclass(frozen=True)\nclass Odd(Procedure):\n    name = 'odd'\n"
WRONG_TEXT = """
    day: Annotated[object, Setting(read=date.fromisoformat)]
    def plan(self, target): ...
    def begin(self, plan, lab, record): ...
    def evaluate(self, points, plan, lab): ...
"""


def test_a_text_that_a_packages_own_reader_refuses_is_named_with_its_option(
    install: Install, palpate: Palpate, benches: Benches
) -> None:
    install("acme-odd", GROUP, {"odd": "acme_odd:Odd"}, acme_odd=f"from datetime import date\n{HEAD}{KIND}{WRONG_TEXT}")
    said = refused(palpate("measure", "odd", "--day", "today"), benches)
    assert said == "--day: 'today': Invalid isoformat string: 'today'"


WRONG = {
    "    curve: dict[str, float]": "field 'curve' is of kind dict[str, float], which `palpate measure` cannot ask for",
    "    pair: tuple[float, float]": "field 'pair' is of kind tuple[float, float], which `palpate measure` cannot ask",
    "    load: float = 2.0": "field 'load' has no unit; write Annotated[float, Setting(",
    "    days: Annotated[int, Setting('s')]": "field 'days' is of kind int and has the unit 's'; make it a float",
    "    seed: int = 1": "field 'seed' cannot be the option --seed, which the command has already; give the field",
    "    a_b: int\n    _a_b: int": "field '_a_b' cannot be the option --a-b, which the command has already",
    "    lost: Nowhere": "its annotations cannot be read (name 'Nowhere' is not defined); import what they name",
    "    made: int = field(default_factory=lambda: 1 // 0)": "field 'made' has no default: its factory fails (Zero",
    "class Odd(Odd):\n    load: int = 3": "'load' is no field of a dataclass; put @dataclass(frozen=True) above the",
    "    def __post_init__(self): raise ValueError('not today')": "procedure 'odd': not today",
    "    load: int = 3": "procedure 'odd': Can't instantiate abstract class Odd",
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_setting_that_no_option_can_be_is_named_with_its_kind(
    install: Install, palpate: Palpate, benches: Benches, wrong: str
) -> None:
    text = f"from __future__ import annotations\n{HEAD}{KIND}{wrong}\n" + (
        "Odd.__abstractmethods__ = frozenset()\n" if "post_init" in wrong else ""
    )
    install("acme-odd", GROUP, {"odd": "acme_odd:Odd"}, acme_odd=text)
    assert WRONG[wrong] in refused(palpate("measure", "odd"), benches)


def test_a_broken_package_and_two_of_one_name_are_told_and_hinder_no_other(
    relaxation: Path, install: Install, palpate: Palpate
) -> None:
    install("broken", GROUP, {"lost": "acme_lost:Lost"}, acme_lost="import no_such_module")
    for name in ("first", "second"):
        install(name, GROUP, {"twin": f"acme_{name}:Twin"})
    said = palpate("measure", "lost")
    assert (said.status, said.out) == (2, "")
    assert said.complaint == (
        "procedure 'lost' of broken 1.2 (acme_lost:Lost): cannot be loaded: ModuleNotFoundError: No module named "
        "'no_such_module'; mend its package, or uninstall it"
    )
    assert "procedure 'twin': first 1.2 and second 1.2 both have one" in palpate("measure", "twin").complaint
    listed = " ".join(palpate("measure", "--help").out.split())
    assert "twin Cannot be used: procedure 'twin': first 1.2 and second 1.2 both have one" in listed
    assert "sweep-loads Load each sample with each load and" in listed
    assert (palpate(*RELAX, "--dry-run", "--quiet").status, palpate("runs", "list").status) == (0, 0)
    completed = CliRunner().invoke(root, prog_name="palpate", env={**COMPLETING, "COMP_WORDS": "palpate measure t"})
    assert "test-modulus" in completed.output


# --- ours ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_every_setting_of_ours_is_an_option_that_says_what_it_is_and_a_text_for_its_default(name: str) -> None:
    own = {each.name: each for each in fields(procedure_class(name))}
    asked = asked_of(procedure_class(name))
    assert {each.name for each in asked} == own.keys()
    for each in asked:
        assert each.setting.help.endswith(".")
        if each.default and each.kind is not bool:
            field = own[each.name]
            default = field.default if field.default_factory is MISSING else field.default_factory()
            assert each.value(each.default) == default
