"""A CAN link when its adapter fails, or a node answers late or what nobody asked."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import can
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.links.can import CanLink
from palpate.instrument.errors import LinkError
from palpate.procedures.testing.wire import impatient_node
from palpate.simulators.bench import SimulatedBench


def test_a_bus_that_cannot_be_opened_is_a_link_error_that_names_it(sim: SimulatedBench) -> None:
    link = CanLink(sim.description.links["can"].model_copy(update={"interface": "socketcan", "channel": "can_none"}))
    with pytest.raises(LinkError, match=r"CAN bus socketcan:can_none cannot be opened"):
        link.open()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_adapter_that_was_pulled_out_is_a_link_error_in_use_and_in_closing(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged(*_: object, **__: object) -> None:
        raise can.CanOperationError("adapter unplugged")

    link = CanLink(sim.description.links["can"])
    link.open()
    node = link.add_node(1)
    monkeypatch.setattr(link.network.bus, "recv", unplugged)
    notifier: Any = link.network.notifier
    notifier._readers[0].join()
    with pytest.raises(LinkError, match=r"^node: CAN bus virtual:.* failed: adapter unplugged"):
        link.upload("node", node, 0x1000, 0)
    with pytest.raises(LinkError, match=r"virtual:.* failed: adapter unplugged"):
        link.close()
    link.close()


def test_a_transfer_that_a_signal_breaks_off_leaves_its_answer_to_nobody(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = bench.device("sensor_node_1")
    sdo: Any = node._node.sdo

    looks = iter([0.0])  # before the request is sent

    def interrupted() -> float:
        for now in looks:
            return now
        raise KeyboardInterrupt

    with sim.clock.lock, impatient_node(node, monkeypatch), monkeypatch.context() as patch:
        patch.setattr(sdo, "now", interrupted)  # which is looked at again when the request is sent
        with pytest.raises(KeyboardInterrupt):
            node.set("sync_period", 0.5)
    assert node.get("sync_period") == 0.5


def test_threads_take_turns_on_a_bus(bench: Bench) -> None:
    node = bench.device("sensor_node_1")
    wanted = ["probe", "heartbeat", "vendor", "sync_period"]
    with ThreadPoolExecutor(len(wanted)) as pool:
        answers = list(pool.map(lambda name: {node.get(name) for _ in range(50)}, wanted))
    assert answers == [{0x12345678}, {1.0}, {0x50414C50}, {0.001}]
