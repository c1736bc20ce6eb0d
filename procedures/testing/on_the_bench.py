"""Tests that a device kind of an installed package must pass on a bench with the usual devices."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.errors import BenchError
from palpate.procedures.testing.conformance import NAME, guest_scene
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import with_faults

STRIKES = 4  # number of the request that a fault strikes; the first ones identify the device
LONG = 10.0  # s, in which a node sends more heartbeats than that


class OnTheBench:
    """A bench file finds the device, and each fault that can strike it causes at most an error that names it."""

    kind: ClassVar[str]

    def test_a_bench_file_finds_it(self, tmp_path: Path) -> None:
        file = tmp_path / "bench.toml"
        with SimulatedBench(guest_scene(self.kind)) as sim:
            file.write_text(sim.description.patient().to_toml(), encoding="utf-8")
            with Bench(read_bench(file), sim.clock, sim.operator) as bench:
                assert bench.device(NAME).serial
                assert bench.simulated

    def test_what_can_go_wrong_with_it_is_noticed_and_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from palpate.simulators.faults import inject

        monkeypatch.setattr(inject, "TIMEOUT", "0.3 s")
        scene = guest_scene(self.kind)
        standing = [place for place in places(0, scene.devices) if place.name == NAME]
        kinds = [kind for kind in FAULTS if kind != "front_panel" and struck(fault_class(kind).targets, standing)]
        assert kinds, f"no fault can strike a {self.kind}"
        for kind in kinds:
            faulty = with_faults(scene, [{"kind": kind, "on": NAME, "transaction": STRIKES}])
            with SimulatedBench(faulty) as sim:
                try:
                    with Bench(sim.description, sim.clock, sim.operator) as bench:
                        bench.clock.wait(LONG)
                        for _ in range(2 * STRIKES):
                            bench.device(NAME).get("probe")
                except BenchError as error:
                    assert device_kind(self.kind).contract.title in str(error), kind
                assert sim.injection.given[0].summary().endswith("once"), kind
