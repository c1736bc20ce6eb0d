"""A bench or a disk that cannot ends a command with one clear message, outputs off and points kept."""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.contracts.declaration import Identity
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from tests.conftest import hasty
from tests.drivers.benches import altered
from tests.procedures.conftest import Benches, Palpate, outputs

SWEEP = ("sweep", "loads")
SMALL = (*SWEEP, "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s")


def nothing_in_runs() -> bool:
    return not Path("runs").exists() or not list(Path("runs").iterdir())


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
    assert nothing_in_runs()


def test_two_devices_of_one_number_on_a_line_are_refused(palpate: Palpate, lab: str, sim: SimulatedBench) -> None:
    device = {**sim.description.device, "positioner": {"kind": "positioner", "link": "line", "unit": 1}}
    said = palpate(*SWEEP, "--bench", bench_file(sim.description.model_copy(update={"device": device})))
    assert (said.status, said.complaint) == (
        2, "lab.toml: strain_indicator and positioner both have the address 1 on line; correct one",
    )  # fmt: skip
    assert nothing_in_runs()


def other_identity(sim: SimulatedBench) -> None:
    stranger = replace(sim.generator.contract, identity=Identity("Acme", "G-9", "1.0"))
    sim.generator.contract = stranger  # type: ignore[misc]


def other_word_order(sim: SimulatedBench) -> None:
    sim.amplifier.settings["probe"] = float(0x56781234)


def other_node(sim: SimulatedBench) -> None:
    sim.nodes[0].settings["product"] += 1


def other_byte_order(sim: SimulatedBench) -> None:
    sim.nodes[0].settings["probe"] = float(0x78563412)


@pytest.mark.parametrize(
    ("doctor", "message"),
    [
        (other_identity, "identifies itself as Acme G-9 1.0, the contract is for Palpate SG-1 1.0"),
        (other_word_order, "word-order probe reads 0x56781234, should read 0x12345678"),
        (other_node, "sensor node 1 at virtual:"),
        (other_byte_order, "byte-order probe reads 0x78563412"),
    ],
)
def test_a_device_of_another_identity_or_word_order_is_refused(
    palpate: Palpate, benches: Benches, doctor: Callable[[SimulatedBench], None], message: str
) -> None:
    benches.doctor = doctor  # type: ignore[method-assign]
    said = palpate(*SWEEP)
    assert said.status == 1
    assert message in said.complaint
    assert nothing_in_runs()


LINE, GENERATOR, AMPLIFIER, NODE = range(4)


@pytest.mark.parametrize(
    ("cut", "message", "left_on", "told"),
    [
        pytest.param(LINE, "strain indicator at ", (False, False), False, marks=pytest.mark.slow),  # time-outs
        (GENERATOR, "signal generator at ", (False, True), True),
        (AMPLIFIER, "shaker amplifier at ", (False, False), True),  # its watchdog has seen to it
        pytest.param(NODE, "sensor node 1 at ", (False, False), False, marks=pytest.mark.slow),
    ],
    ids=["line", "generator", "amplifier", "node"],
)
def test_a_device_cut_off_in_the_middle_ends_the_run_with_the_other_outputs_off(
    palpate: Palpate, benches: Benches, on_progress: Any,
    cut: int, message: str, left_on: tuple[bool, bool], told: bool,
) -> None:  # fmt: skip
    def shorten(sim: SimulatedBench) -> None:
        sim.description = hasty(sim.description)

    def progress(done: int, _total: int, what: str) -> None:
        if (done, what) != (1, "sample 1, 3 N"):
            return
        if cut == NODE:
            can = benches[0].can
            can._network.unsubscribe(can._local[1].sdo.rx_cobid)
        else:
            benches[0].servers._open[cut].close()

    benches.doctor = shorten  # type: ignore[method-assign]
    on_progress(progress)
    said = palpate(*SMALL, "--out", "day", "--json")
    assert said.status == 1
    assert said.complaint.startswith(message)
    assert f"points already taken are kept in {Path('day').absolute()}" in said.err
    # an output that cannot be reached is left to the amplifier's watchdog, and that is said
    assert outputs(benches[0])[:2] == left_on
    assert ("outputs could not all be switched off" in said.err) is told
    run = Run.open(Path("day"))
    assert [p["load_N"] for p in run.points()] == [2.0]
    assert run.status == "failed"


# --- the disk ------------------------------------------------------------------------------------------


def test_a_second_run_in_the_same_folder_is_refused(palpate: Palpate, benches: Benches) -> None:
    assert palpate(*SMALL, "--out", "day", "--quiet").status == 0
    before = {path: path.read_bytes() for path in Path("day").iterdir()}
    for command in (SWEEP, ("calibrate", "load-cell")):
        said = palpate(*command, "--out", "day")
        assert said.status == 2
        assert said.complaint == "day already holds a run; choose another --out"
    assert {path: path.read_bytes() for path in Path("day").iterdir()} == before
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
    assert nothing_in_runs()
