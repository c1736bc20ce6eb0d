"""The signal generator sets all of a waveform at once, and keeps its phase."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from palpate.drivers.devices.exciter import SignalGenerator
from palpate.extend import Bench, ModbusDevice, SimulatedDevice
from palpate.instrument.errors import LinkTimeout, RangeError, SettingsLost
from palpate.procedures.testing.wire import listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.exciter import SimulatedSignalGenerator
from palpate.testing import ModbusConformance
from tests.drivers.benches import drive


class TestSignalGenerator(ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("signal_generator"), sim.generator


def volts_at(generator: SimulatedSignalGenerator, *times: float) -> npt.NDArray[np.float64]:
    """Output voltage `times` s after now."""
    now = generator.clock.now_ns()
    return generator.voltage().at(np.array([now + round(time * 1e9) for time in times]))


def test_a_frequency_change_is_one_request_and_keeps_the_phase(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.device("signal_generator").sine(10.0, 2.0)
    bench.device("signal_generator").output(True)
    sim.clock.wait(0.1234567)
    before = volts_at(sim.generator, 0.0)
    slope = np.diff(volts_at(sim.generator, 0.0, 1e-6))
    wire = listen(bench.device("signal_generator").link, monkeypatch)
    bench.device("signal_generator").sine(20.0, 2.0)
    assert [request[0] for request in wire.requests] == [16]
    assert volts_at(sim.generator, 0.0) == pytest.approx(before, abs=1e-12)
    assert np.diff(volts_at(sim.generator, 0.0, 1e-6)) == pytest.approx(2 * slope, rel=1e-3)


def test_a_peak_above_the_rail_is_refused_before_it_is_sent(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = listen(bench.device("signal_generator").link, monkeypatch)
    for amplitude, offset in ((6.0, 4.000001), (9.0, -1.1), (math.nan, 0.0), (0.1, math.nan)):
        with pytest.raises(RangeError, match="signal generator: "):
            bench.device("signal_generator").sine(10.0, amplitude, offset)
    assert wire.requests == []


def test_the_generator_says_why_it_refused(bench: Bench) -> None:
    generator = bench.device("signal_generator")
    reasons = []
    for address, microvolts in ((0x14, 5_000_000), (0x12, 6_000_000), (0x12, 10_000_001), (0x12, 1)):
        registers = [microvolts >> 16, microvolts & 0xFFFF]
        reply = generator.link.client.write_registers(address, registers, device_id=generator.unit)
        reasons.append((reply.isError(), generator.contract.choice("error", generator.get("error"))))
    assert reasons == [(False, "none"), (True, "amplitude_plus_offset"), (True, "range"), (False, "none")]
    assert generator.read() == (10.0, 1e-6, 5.0)


@pytest.mark.parametrize(
    ("shape", "harmonic"),
    [
        ("sine", lambda k: 1.0 if k == 1 else 0.0),
        ("square", lambda k: 4 / (np.pi * k)),
        ("triangle", lambda k: 8 / (np.pi * k) ** 2 * (-1) ** (k // 2)),
    ],
)
def test_a_waveform_has_the_harmonics_of_its_shape(
    shape: str, harmonic: Callable[[int], float], bench: Bench, sim: SimulatedBench
) -> None:
    bench.device("signal_generator").set(frequency=10.0, amplitude=3.0, offset=0.5, waveform=shape)
    bench.device("signal_generator").output(True)
    bench.device("signal_generator").set(phase_reset=1)
    spectrum = np.fft.rfft(volts_at(sim.generator, *(np.arange(100) / 1000))) / 50
    assert spectrum[0] / 2 == pytest.approx(0.5)
    for k in range(1, 30):
        expected = -3j * harmonic(k) if k % 2 and k <= 25 else 0.0
        assert spectrum[k] == pytest.approx(expected, abs=1e-9), k


# --- a stranger ----------------------------------------------------------------------------------------


def as_a_stranger(generator: SignalGenerator, microvolts: int) -> None:
    """Writes an amplitude that our driver does not know of."""
    reply = generator.link.client.write_registers(
        generator.contract["amplitude"].address, [microvolts >> 16, microvolts & 0xFFFF], device_id=generator.unit
    )
    assert not reply.isError()


def test_a_setting_that_a_stranger_has_changed_and_taken_back_is_noticed_once(
    bench: Bench, sim: SimulatedBench
) -> None:
    drive(bench)
    bench.check_settings()
    as_a_stranger(bench.device("signal_generator"), 3_000_000)
    as_a_stranger(bench.device("signal_generator"), 1_000_000)
    with pytest.raises(SettingsLost, match=r"signal generator at .*: counts \d+ writes instead of \d+"):
        bench.check_settings()
    bench.recover()
    bench.check_settings()


def test_a_generator_that_was_off_meanwhile_is_noticed_though_it_holds_its_settings(
    bench: Bench, sim: SimulatedBench
) -> None:
    before = dict(sim.generator.settings)
    sim.generator.reset()
    sim.generator.turn(before)
    with pytest.raises(SettingsLost, match=r"counts \d+ writes instead of \d+"):
        bench.check_settings()


@pytest.mark.parametrize("carried_out", [False, True])
def test_a_write_that_was_not_confirmed_may_have_been_taken_or_not(
    carried_out: bool, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    transact = bench.device("signal_generator").link.transact

    def unconfirmed(*asked: Any, **timing: Any) -> None:
        if carried_out:
            transact(*asked, **timing)
        raise LinkTimeout("no answer")

    bench.device("signal_generator").sine(10.0, 0.0)
    with monkeypatch.context() as patch, pytest.raises(LinkTimeout):
        patch.setattr(bench.device("signal_generator").link, "transact", unconfirmed)
        bench.device("signal_generator").sine(10.0, 0.0)
    bench.check_settings()
    as_a_stranger(bench.device("signal_generator"), 0)
    with pytest.raises(SettingsLost, match="writes instead of"):
        bench.check_settings()
