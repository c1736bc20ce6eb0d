"""All devices together live on the virtual clock, and on nothing else."""

from __future__ import annotations

from collections.abc import Callable

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import Recording
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.own import SYNC_COB_ID, SYNC_PRODUCER
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from tests.conftest import latched


def everything(contract: Contract, read: Callable[[str], float]) -> bytes:
    return b"".join(contract.pack(f.name, read(f.name)) for f in contract.fields if f.access != "wo")


def live(scene: Scene, pieces: int) -> tuple[Recording, list[bytes]]:
    """0.7 s in which a move ends, a tare is taken, a watchdog trips and a node samples; then all that can be read."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(SAMPLES["4"])
        bench.device("positioner").move(18e-3, speed=5e-3)
        bench.drive()
        bench.device("signal_generator").sine(10.0, 2.5)
        bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0.333)
        bench.device("strain_indicator").peak_to_peak(0.25)
        bench.device("positioner").set(target=18.3e-3, speed=1.1e-3, command="move")
        bench.device("strain_indicator").set(command="clear_tare")
        node = bench.device("sensor_node_1")
        node.arm()
        node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
        for _ in range(pieces):
            sim.clock.wait(0.7 / pieces)
        assert node.get("sample_counter") == 700
        assert latched(sim) == {"watchdog"}
        recording = node.collect(700)
        devices = (sim.generator, sim.amplifier, sim.indicator, sim.positioner)
        state = [everything(device.contract, device.read) for device in devices]
        return recording, [*state, sim.amplifier.read("temperature").hex().encode()]


def test_a_wait_gives_the_same_however_it_is_cut(scene: Scene) -> None:
    (recording, whole), *others = (live(scene, pieces) for pieces in (1, 7, 70))
    for cut_recording, cut in others:
        assert cut == whole
        assert cut_recording.voltage.tobytes() == recording.voltage.tobytes()
