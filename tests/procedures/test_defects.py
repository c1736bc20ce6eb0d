"""A defect in the code of an installed package is one message at the command line; the run keeps the traceback."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from palpate.procedures.records.run import Run
from tests.conftest import Install
from tests.procedures.conftest import IDEAL_SCENE, Palpate

slow = pytest.mark.slow
RELAXATION = (Path(__file__).parents[1] / "examples" / "relaxation.py").read_text(encoding="utf-8")
FAILING = f"""{RELAXATION}
FAILS = [""]

def fails(hook):
    if FAILS[0] == hook:
        return {{}}["gone"]

class FailingWork(Holding):
    def take(self, step):
        FAILS[0] += "!"  # the second point fails
        fails("take!!")
        return super().take(step)

@dataclass(frozen=True)
class Failing(Relaxation):
    name = "failing"
    def check(self, target):
        fails("check")
    def plan(self, target):
        fails("plan")
        return super().plan(target)
    def begin(self, plan, lab, record):
        fails("begin")
        return FailingWork(lab, self.sample, self.force)
    def evaluate(self, points, plan, lab):
        FAILS[0] = FAILS[0].rstrip("!")
        fails("evaluate")
        return super().evaluate(points, plan, lab)
"""
OVEN = """
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.contracts.contract import Contract, Identity, probe
from palpate.simulators.wire.device import SimulatedDevice
CONTRACT = Contract("bad-oven", "oven", "modbus", Identity("Acme", "BO", "1.0"), (probe(0),))
KIND = DeviceKind(CONTRACT, ("modbus-tcp",), "acme_bad:Driver", "acme_bad:Simulated")
class Driver(ModbusDevice):
    contract = CONTRACT
    def connect(self):
        raise OSError("no such thing")
class Simulated(SimulatedDevice):
    contract = CONTRACT
"""
MEASURE = ("measure", "failing", "--scene", "ideal", "--readings", "2", "--out", "run", "--quiet")


@pytest.mark.parametrize(
    ("hook", "function", "points"),
    [
        pytest.param("check", "Failing.check", None, marks=slow),
        pytest.param("plan", "Failing.plan", None, marks=slow),
        pytest.param("begin", "Failing.begin", 0, marks=slow),
        ("take", "FailingWork.take", 1),
        pytest.param("evaluate", "Failing.evaluate", 2, marks=slow),
    ],
)
def test_a_defect_of_a_procedure_names_package_and_hook_and_its_run_keeps_traceback_and_points(
    install: Install, palpate: Palpate, hook: str, function: str, points: int | None
) -> None:
    install("acme", "palpate.procedures", {"failing": "acme_failing:Failing"}, acme_failing=FAILING)
    importlib.import_module("acme_failing").FAILS[0] = hook
    said = palpate(*MEASURE)
    message, *notes = said.complaint.splitlines()
    assert re.fullmatch(
        rf"acme 1.2: {function} failed: KeyError: 'gone' \(acme_failing.py, line \d+\); mend that package", message
    )
    assert (said.status, bool(notes), Path("run").exists()) == (1, points is not None, points is not None)
    if points is not None:
        run = Run.open(Path("run"))
        assert notes[0].startswith("the traceback is kept in ")
        assert (run.status, len(run.points())) == ("failed", points)
        (kept,) = [each["message"] for each in run.events() if each["kind"] == "traceback"]
        assert kept.startswith("Traceback (most recent call last):") and kept.endswith("KeyError: 'gone'\n")


@slow
def test_a_defect_of_a_driver_names_its_package(install: Install, palpate: Palpate, tmp_path: Path) -> None:
    install("acme", "palpate.devices", {"bad-oven": "acme_bad:KIND"}, acme_bad=OVEN)
    (tmp_path / "bad.toml").write_text(IDEAL_SCENE + '[device.oven]\nkind = "bad-oven"\n', encoding="utf-8")
    said = palpate("sweep", "loads", "--scene", "bad.toml", "--samples", "1", "--loads", "2 N", "--quiet")
    assert (said.status, said.complaint) == (
        1,
        "acme 1.2: Driver.connect failed: OSError: no such thing (acme_bad.py, line 11); mend that package",
    )


@slow
def test_a_defect_of_ours_shows_its_traceback_and_the_run_keeps_it(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.procedures.measurements.loads import LoadSweep

    monkeypatch.setattr(LoadSweep, "evaluate", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError) as raised:
        palpate("sweep", "loads", "--scene", "ideal", "--samples", "1", "--loads", "2 N", "--out", "run", "--quiet")
    assert raised.value.__notes__[0].startswith("the traceback is kept in ")
    assert [each["kind"] for each in Run.open(Path("run")).events()][-2:] == ["traceback", "failed"]
