"""A bench, a disk or a package that cannot ends a command with one clear message, outputs off and points kept."""

from __future__ import annotations

import importlib
import re
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate import Run
from palpate.extend import BenchDescription, Identity
from palpate.procedures.virtual.served_bench import Person
from palpate.simulators.bench import SimulatedBench
from tests.conftest import Install, hasty
from tests.drivers.benches import altered
from tests.procedures.conftest import IDEAL_SCENE, Benches, Palpate, outputs

SWEEP = ("sweep", "loads")
SMALL = (*SWEEP, "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s")


def bench_file(description: BenchDescription) -> str:
    Path("lab.toml").write_text(hasty(description).to_toml(), encoding="utf-8")
    return "lab.toml"


# --- devices -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "name", "update", "message"),
    [
        ("link", "shaker_amplifier", {"port": None}, "nothing answers at 127.0.0.1:"),
        ("link", "line", {"port": "/dev/ttyNONE"}, "there is no serial port /dev/ttyNONE"),
        ("device", "strain_indicator", {"unit": 9}, "unit 9: no valid answer"),
        ("device", "sensor_node_1", {"node": 9}, "sensor node 9 at virtual:"),
        (
            "link",
            "can",
            {"interface": "socketcan", "channel": "can_none"},
            "CAN bus socketcan:can_none cannot be opened",
        ),
    ],
)
def test_an_absent_device_is_named(
    palpate: Palpate,
    lab: str,
    sim: SimulatedBench,
    closed_port: int,
    form: str,
    name: str,
    update: dict[str, Any],
    message: str,
) -> None:
    update = {key: closed_port if value is None else value for key, value in update.items()}
    said = palpate(*SWEEP, "--bench", bench_file(altered(sim.description, **{form: {name: update}})))
    assert said.status == 1
    assert message in said.complaint
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("device", "setting", "value", "message"),
    [
        ("generator", "", 0.0, "identifies itself as Acme G-9 1.0, the contract is for Palpate SG-1 1.0"),
        ("amplifier", "probe", 0x56781234, "word-order probe reads 0x56781234, should read 0x12345678"),
        ("node", "product", 1.0, "sensor node 1 at virtual:"),
        ("node", "probe", 0x78563412, "byte-order probe reads 0x78563412"),
    ],
)
def test_a_device_of_another_identity_or_word_order_is_refused(
    palpate: Palpate, benches: Benches, device: str, setting: str, value: float, message: str
) -> None:
    def doctor(sim: SimulatedBench) -> None:
        if setting:
            {"amplifier": sim.amplifier, "node": sim.nodes[0]}[device].settings[setting] = float(value)
        else:
            stranger = replace(sim.generator.contract, identity=Identity("Acme", "G-9", "1.0"))
            sim.generator.contract = stranger  # type: ignore[misc]

    benches.doctor = doctor  # type: ignore[method-assign]
    said = palpate(*SWEEP)
    assert (said.status, message in said.complaint) == (1, True)
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("fault", "message", "left_on"),
    [
        pytest.param("line silence", "strain indicator at ", (False, False), marks=pytest.mark.slow),  # time-outs
        ("signal_generator connection_refused", "signal generator at ", (False, True)),
        ("shaker_amplifier connection_refused", "shaker amplifier at ", (False, False)),  # its watchdog sees to it
        pytest.param("can bus_off", "sensor node 1 at ", (False, False), marks=pytest.mark.slow),
    ],
)
def test_a_device_cut_off_in_the_middle_ends_the_run_with_the_other_outputs_off(
    palpate: Palpate, benches: Benches, on_progress: Any, fault: str, message: str, left_on: tuple[bool, bool]
) -> None:
    """An output that cannot be reached is left to the amplifier's watchdog, and that is said."""

    def shorten(sim: SimulatedBench) -> None:
        sim.description = hasty(sim.description)

    def progress(done: int, _total: int, what: str) -> None:
        if (done, what) == (1, "sample 1, 3 N"):
            Person(benches[0]).do(f"fault {fault}")

    benches.doctor = shorten  # type: ignore[method-assign]
    on_progress(progress)
    said = palpate(*SMALL, "--out", "day", "--json")
    assert (said.status, said.complaint.startswith(message)) == (1, True), said.err
    assert f"points already taken are kept in {Path('day').absolute()}" in said.err
    assert outputs(benches[0])[:2] == left_on
    assert ("outputs could not all be switched off" in said.err) is ("refused" in fault)
    run = Run.open(Path("day"))
    assert (run.status, [p["load_N"] for p in run.points()]) == ("failed", [2.0])


# --- the disk ------------------------------------------------------------------------------------------


def test_a_second_run_in_the_same_folder_or_one_among_other_files_is_refused(
    palpate: Palpate, benches: Benches
) -> None:
    Path("mine").mkdir()
    Path("mine/bench.toml").write_text("precious")
    assert palpate(*SMALL, "--out", "day", "--quiet").status == 0
    before = {path: path.read_bytes() for folder in ("day", "mine") for path in Path(folder).iterdir()}
    for command in (SWEEP, ("calibrate", "load-cell")):
        for out, why in (("day", "day already holds a run; choose another --out"), ("mine", "mine holds other files")):
            said = palpate(*command, "--out", out)
            assert (said.status, said.complaint.startswith(why)) == (2, True)
    assert {path: path.read_bytes() for folder in ("day", "mine") for path in Path(folder).iterdir()} == before
    assert len(benches) == 1


@contextmanager
def no_file_above(size: int) -> Iterator[None]:
    """A disk that is full after `size` bytes of a file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_from_the_start_leaves_nothing(palpate: Palpate) -> None:
    with no_file_above(1000):
        said = palpate(*SMALL)
    assert said.status == 1
    assert "cannot write" in said.complaint
    assert not Path("runs").exists()


# --- a defect in the code of an installed package is one message; the run keeps the traceback ---------

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
