"""A source of a maker holds one value: what it cannot do is refused by name, and it is off on every way out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from palpate.extend import Bias, read_scene
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, RangeError
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import open_bench

KINDS = {
    "ea-psb": "its voltage never goes below zero",
    "apm-sp-300": "that it gives 10 Hz is not confirmed by any document",
    "waveshare-ao-8ch": "at 9600 baud it manages five writes in a cycle of 10 Hz",
}
LEVELS = {"ea-psb": 40.0, "apm-sp-300": 110.0, "waveshare-ao-8ch": 4.0}  # V, V RMS, mA


@pytest.fixture(scope="module", params=KINDS)
def sim(request: pytest.FixtureRequest) -> Iterator[SimulatedBench]:
    with SimulatedBench(read_scene("ideal").with_devices({"source": {"kind": request.param}})) as simulated:
        yield simulated


@pytest.mark.parametrize(("kind", "reason"), KINDS.items())
def test_a_source_that_makes_no_sine_is_refused_as_exciter_with_the_reason(kind: str, reason: str) -> None:
    said = f"device.source: role: a {kind} cannot be the exciter: {reason}; it serves as bias alone"
    with pytest.raises(ConfigError, match=re.escape(said)):
        read_scene("ideal").with_devices({"source": {"kind": kind, "role": "exciter"}})


def test_a_source_holds_a_value_and_is_off_when_the_bench_ends(sim: SimulatedBench) -> None:
    twin = sim.devices["source"]
    level = LEVELS[twin.kind.name]
    with open_bench(sim) as bench:
        assert any("has no watchdog, so that it stays on" in each for each in bench.cautions)
        bias: Any = bench.role(Bias)
        bias.hold(level)
        assert (bias.level(), twin.output) == (pytest.approx(level, rel=1e-4), pytest.approx(level, rel=1e-4))
        bias.hold(level / 2)
        assert twin.output == pytest.approx(level / 2, rel=1e-4)
    assert twin.output == 0.0


@pytest.mark.parametrize("fails", [False, True])
def test_an_interrupt_says_that_outputs_are_off_only_if_the_source_is_off_too(
    sim: SimulatedBench, fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def off() -> None:
        raise LinkError("source: does not answer")

    with pytest.raises(KeyboardInterrupt) as ended, open_bench(sim) as bench:
        bias: Any = bench.role(Bias)
        bias.hold(LEVELS[sim.devices["source"].kind.name])
        if fails:
            monkeypatch.setattr(bias, "off", off)
        raise KeyboardInterrupt
    failure = f"{bias.name} could not be switched off: source: does not answer; switch it off by hand, now"
    assert ended.value.__notes__ == [failure if fails else "the outputs are off"]


def test_a_value_below_zero_is_refused_before_anything_is_sent(sim: SimulatedBench) -> None:
    with open_bench(sim) as bench:
        asked = sim.servers.transactions
        with pytest.raises(RangeError, match="-1"):
            bench.role(Bias).hold(-1.0)
        assert sim.servers.transactions == asked


def test_a_source_that_is_not_under_remote_control_refuses_a_value() -> None:
    scene = read_scene("ideal").with_devices({"source": {"kind": "ea-psb"}})
    with SimulatedBench(scene) as sim, open_bench(sim) as bench:
        with pytest.raises(DeviceError, match="voltage = 3"):
            bench.device("source").give(voltage=3.0)
        bench.role(Bias).hold(3.0)
        assert sim.devices["source"].output == pytest.approx(3.0, abs=1e-3)
