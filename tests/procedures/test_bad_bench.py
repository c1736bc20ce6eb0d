"""A bench or a disk that cannot ends a command with one clear message, outputs off and points kept."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.contracts.declaration import Identity
from palpate.procedures.records.run import Run
from palpate.procedures.virtual.served_bench import Person
from palpate.simulators.bench import SimulatedBench
from tests.conftest import hasty
from tests.drivers.benches import altered
from tests.procedures.conftest import Benches, Palpate, outputs

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
