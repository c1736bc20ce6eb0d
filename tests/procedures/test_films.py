"""A point waits until its films have settled, says why one is rejected, and fits what is good; films are calibrated."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from palpate import (
    FilmSeries,
    FrequencySweep,
    LoadSweep,
    RangeError,
    Run,
    SoftnessTest,
    get_design,
    get_sample,
    read_calibration,
)
from palpate.extend import Bench, DeviceError, FilmCalibration, Films, Lab, LoadServo, Recorder, read_scene
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.signals.dwell import RequiredDwell
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.measurements import work as dynamic_load
from palpate.procedures.steps import films as module
from palpate.procedures.steps.film_point import DwellChoice, FilmPoint, measure, recording_seconds
from palpate.procedures.steps.films import FilmRecord, check_nodes
from palpate.procedures.steps.flags import UNSETTLED
from palpate.procedures.steps.servo import READINGS, IndicatorMean
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, IDEAL_CALIBRATION, Palpate, scene_of
from tests.procedures.test_load_cell import CREATED

RATE = 250.0  # Hz, at 10 Hz
LOAD = 3.0  # N, peak to peak
TRUE = np.array([7e-3, 68.6e-3 * LOAD / 2])  # V, amplitudes


class Signals(Films):
    """Films that give what they are told at each time of the bench's clock; the bench has nothing mounted."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench, get_design("single"), 10.0, 4.0)
        self.random = np.random.default_rng(7)
        self.decay, self.drift, self.noise, self.off = 0.0, 0.0, 0.0, 0.0
        self.gain, self.second = 1.0, 0.0
        self.bad: dict[int, tuple[int, slice, float]] = {}
        self.lengths: list[float] = []

    def acquire(self, duration: float) -> FilmRecord:
        now = 1e-9 * self.bench.clock.now_ns()
        self.bench.clock.wait(duration)
        self.lengths.append(duration)
        time = np.arange(round(duration * RATE)) / RATE
        t = time + now
        sine = self.gain * TRUE[:, None] * (1 + self.drift * t) * np.sin(2 * np.pi * (self.frequency + self.off) * t)
        sine += self.second * TRUE[:, None] * np.sin(4 * np.pi * self.frequency * t)
        volts = sine + self.decay * np.exp(-t) + self.noise * self.random.standard_normal((2, len(t)))
        record = FilmRecord(RATE, time, volts, np.zeros(volts.shape, bool))
        if bad := self.bad.get(len(self.lengths)):
            film, where, value = bad
            record.voltage[film, where] = value
            record.clipped[film, where] = np.isfinite(value)
        return record


class Held(LoadServo):
    """A load of 3 N, but for what is in `drifts`."""

    def __init__(self, *drifts: float) -> None:
        self.calibration = IDEAL_CALIBRATION
        self.drifts = list(drifts)
        self.asked: list[float] = []

    def watch(self) -> None:
        pass

    def set(self, load: float) -> float:
        self.asked.append(load)
        return load

    def read(self, count: int = READINGS) -> IndicatorMean:
        return IndicatorMean(IDEAL_CALIBRATION.reading(3.0 + (self.drifts.pop(0) if self.drifts else 0.0)))


@pytest.fixture
def signals(bench: Bench) -> Signals:
    return Signals(bench)


def measured(
    signals: Signals, servo: Held, folder: Path, dwell: float | DwellChoice = 1.0
) -> tuple[FilmPoint, list[str]]:
    """The point, and the messages of the record's events."""
    with Recorder.create(folder, HEADER) as record:
        point = measure(signals, servo, 3.0, dwell, record, "a point")
        record.finish("complete", {})
    return point, [event["message"] for event in Run.open(folder).events()]


# --- settling ------------------------------------------------------------------------------------------


def test_a_steady_signal_takes_two_short_records(signals: Signals) -> None:
    signals.noise = 20e-6
    watched: list[int] = []
    _, took, settled = signals.settle(lambda: watched.append(len(signals.lengths)))
    assert (settled, signals.lengths, watched, took) == (True, [0.2, 0.2], [1, 2], pytest.approx(0.4))


@pytest.mark.parametrize(("decay", "noise"), [(0.02, 5e-6), (0.2, 0.0), (2.0, 0.0), (2.0, 5e-6)])
def test_what_is_left_of_a_transient_is_below_the_uncertainty(signals: Signals, decay: float, noise: float) -> None:
    signals.decay, signals.noise = decay, noise
    fit, took, settled = signals.settle(lambda: None)
    assert settled
    assert took < 12.0
    signals.noise = 0.0
    record = signals.acquire(1.0)
    left = abs(fit_sine(record.time, record.voltage, 10.0).amplitude - TRUE)
    assert (left <= np.maximum(0.2 * fit.amplitude_u, 1e-4 * TRUE)).all()


@pytest.mark.parametrize(("dwell", "noise"), [(1.05, 100e-6), (10.0, 100e-6)])
def test_before_a_dwell_over_which_it_leaks_more_a_transient_falls_below_its_uncertainty(
    signals: Signals, tmp_path: Path, dwell: float, noise: float
) -> None:
    """Over 10.5 cycles a falling offset leaks into the amplitude eight times as much as over 10, over 100 four times;
    and noise of 10 s spoils a tenth as much as that of 0.2 s."""
    signals.decay, signals.noise = 0.05, noise
    point, _ = measured(signals, Held(), tmp_path / "run", dwell)
    began = 1e-9 * signals.bench.clock.now_ns() - dwell
    offset = signals.decay * np.exp(-began - point.record.time)
    turned = TRUE[:, None] * np.sin(2 * np.pi * (10 * (began + point.record.time)))
    left = abs(fit_sine(point.record.time, turned + offset, 10.0).amplitude - TRUE)
    assert point.valid
    assert (left <= 0.5 * point.fit.amplitude_u).all()


def test_steady_films_are_settled_before_a_dwell_of_many_broken_cycles(signals: Signals) -> None:
    """A bend that stayed for 10 s would leak a hundred times as much as one that decays."""
    signals.noise = 100e-6
    _, took, settled = signals.settle(lambda: None, 10.05)
    assert settled
    assert took <= 4.0


def test_what_never_settles_is_flagged_at_the_limit(signals: Signals) -> None:
    signals.drift = 0.05
    _, took, settled = signals.settle(lambda: None)
    assert not settled
    assert took == pytest.approx(module.SETTLING_LIMIT, abs=0.21)


# --- rejected and repeated -----------------------------------------------------------------------------
# Each attempt records twice until it has settled, then for the dwell: the dwells are records 3, 6 and 9.


def test_a_good_point_is_measured_once(signals: Signals, tmp_path: Path) -> None:
    point, events = measured(signals, Held(), tmp_path / "run")
    assert (point.valid, point.flags, point.attempts, events, signals.lengths) == (True, (), 1, [], [0.2, 0.2, 1.0])
    assert (point.fit.amplitude, point.load_measured_N) == (pytest.approx(TRUE), pytest.approx(3.0))


@pytest.mark.parametrize(("value", "flag"), [(np.nan, "not finite"), (0.1, "clipped")])
@pytest.mark.parametrize(("dwells", "valid", "attempts"), [((3,), True, 2), ((3, 6, 9), False, 3)])
def test_a_bad_sample_is_left_out_its_record_repeated_and_the_point_flagged_where_it_stays_bad(
    signals: Signals, tmp_path: Path, dwells: tuple[int, ...], valid: bool, attempts: int, value: float, flag: str
) -> None:
    signals.bad = {number: (1, slice(20, 40), value) for number in dwells}
    point, events = measured(signals, Held(), tmp_path / "run")
    assert (point.valid, point.flags, point.attempts, events, point.fit.amplitude) == (
        valid,
        () if valid else (flag,),
        attempts,
        [f"a point, attempt {number}: {flag}" for number in range(1, attempts)],
        pytest.approx(TRUE),
    )


def test_a_load_that_drifts_off_is_set_anew(signals: Signals, tmp_path: Path) -> None:
    servo = Held(0.5)
    point, events = measured(signals, servo, tmp_path / "run")
    assert (servo.asked, point.valid, point.attempts, events) == ([3.0], True, 2, ["a point, attempt 1: drifted"])


def test_a_film_without_a_finite_sample_is_named(signals: Signals, tmp_path: Path) -> None:
    signals.bad = {3: (1, slice(None), np.nan)}
    with pytest.raises(DeviceError, match="film 'total' on channel 2 gives no finite samples"):
        measured(signals, Held(), tmp_path / "run")


def test_a_fault_of_a_node_rejects_the_point(signals: Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counts = iter([0, 1, 1, 1])
    monkeypatch.setattr(signals, "emergencies", lambda: next(counts))
    assert measured(signals, Held(), tmp_path / "run")[1] == ["a point, attempt 1: fault"]


# --- a dwell that is chosen at the point ---------------------------------------------------------------


@pytest.mark.parametrize(("asked", "lengths"), [(0.2, [0.2]), (1.3, [4.0]), (5.0, [4.0, 5.0])])
def test_a_longer_dwell_is_chosen_by_a_pilot_that_counts_where_it_is_long_enough(
    signals: Signals, tmp_path: Path, asked: float, lengths: list[float]
) -> None:
    signals.noise = 20e-6
    point, _ = measured(signals, Held(), tmp_path / "run", lambda fit: RequiredDwell(asked, fit.amplitude_u[1]))
    assert (signals.lengths, sum(lengths)) == ([0.2, 0.2, *lengths], pytest.approx(recording_seconds(asked, 10.0)))
    assert (point.dwell_s, point.fit.samples, point.record.voltage.shape) == (asked, asked * RATE, (2, asked * RATE))
    assert point.relative_u_predicted is not None and point.relative_u_predicted < 20e-6 * np.sqrt(
        3 / (RATE * lengths[0])
    )


# --- hum ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "marked"), [(10.0, False), (48.0, True)])
def test_a_point_that_hum_may_spoil_is_marked(signals: Signals, tmp_path: Path, frequency: float, marked: bool) -> None:
    signals.frequency = frequency
    _, events = measured(signals, Held(), tmp_path / "run", 0.1)
    assert [event.split(";")[1] for event in events] == [" of 1 mV of hum up to 0.9 mV may be in an amplitude"] * marked


def test_a_load_that_swings_within_a_turn_of_the_mains_is_marked(signals: Signals, tmp_path: Path) -> None:
    """Two lines closer than one over the dwell cannot be told apart, whether hum shows or not."""
    signals.frequency, signals.noise = 45.0, 20e-6
    near, _ = measured(signals, Held(), tmp_path / "near", 0.18)
    far, _ = measured(signals, Held(), tmp_path / "far", 0.3)
    assert (near.flags, far.flags) == (("hum",), ())


# --- distortion ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("second", "noise", "dwell", "told"),
    [(0.04, 20e-6, 1.0, ["rigid", "total"]), (0.004, 20e-6, 1.0, []), (0.04, 2e-3, 1.0, ["total"]), (0.04, 0, 0.2, [])],
    ids=["distorted", "below the limit", "noise hides it in one film", "too short to tell"],
)
def test_harmonics_of_the_drive_are_told_with_their_uncertainty_where_they_are_sure(
    signals: Signals, tmp_path: Path, second: float, noise: float, dwell: float, told: list[str]
) -> None:
    """Thesis 5.4.1: soft samples distorted the sine."""
    signals.second, signals.noise = second, noise
    point, events = measured(signals, Held(), tmp_path / "run", dwell)
    assert (point.valid, [re.findall(r"film '(\w+)'", event)[0] for event in events]) == (True, told)
    assert all(re.search(r"harmonics of (3\.[89]|4\.[012])\d% \(u 0\.\d\d%\) of the drive", event) for event in events)


# --- two that know one quantity -------------------------------------------------------------------------


@pytest.mark.parametrize(("share", "flags"), [(1.08, ()), (0.735, ("force",)), (1.29, ("force",))])
def test_films_that_tell_of_another_force_than_the_load_cell_are_flagged(
    signals: Signals, tmp_path: Path, share: float, flags: tuple[str, ...]
) -> None:
    """A calibration of 13.3 mV/N in place of 10.3 sets 3.87 N for 3 N, and reads 3 N."""
    signals.gain = share
    point, events = measured(signals, Held(), tmp_path / "run")
    assert (point.flags, point.valid, (point.attempts, len(events))) == (flags, not flags, (3, 2) if flags else (1, 0))


@pytest.mark.parametrize(("off", "flags"), [(0.0, ()), (1e-3, ()), (5e-3, ("frequency",)), (-0.1, ("frequency",))])
def test_a_drive_of_another_frequency_than_was_set_is_flagged(
    signals: Signals, tmp_path: Path, off: float, flags: tuple[str, ...]
) -> None:
    signals.off = off
    point, _ = measured(signals, Held(), tmp_path / "run")
    assert point.flags == flags


def test_a_short_record_of_much_noise_is_marked_and_used(signals: Signals, tmp_path: Path) -> None:
    signals.noise = 3e-3
    short, _ = measured(signals, Held(), tmp_path / "short", 0.2)
    long, _ = measured(signals, Held(), tmp_path / "long", 2.0)
    assert (short.flags, short.valid, short.attempts, long.flags) == (("short",), True, 1, ())


# --- many films ----------------------------------------------------------------------------------------


class Logger:
    """A sensor node of another package, which keeps what is set."""

    ranges: ClassVar = {"5 V": 5.0, "500 mV": 0.5}

    def __init__(self) -> None:
        self.set: dict[int, str] = {}

    def set_sample_rate(self, rate: float) -> None:
        pass

    def set_range(self, channel: int, range_: str) -> None:
        self.set[channel] = range_


@pytest.mark.parametrize(
    ("channels", "load", "used"),
    [
        (2, None, [[1, 2], [1, 2]]), (3, None, [[1, 2, 3], [1]]), (4, None, [[1, 2, 3, 4], []]),
        (8, None, [[1, 2, 3, 4], []]), (3, 5, [[1, 2, 3], [1, 2]]), (4, 8, [[1, 2, 3, 4], [4]]),
    ],
)  # fmt: skip
def test_films_and_load_are_on_the_nodes_channels_however_many_their_kind_has(
    channels: int, load: int | None, used: list[list[int]]
) -> None:
    nodes = Logger(), Logger()
    named = SimpleNamespace(kind=replace(KINDS["sensor_node"], channels=channels))
    described = SimpleNamespace(load_channel=load)
    bench: Any = SimpleNamespace(all=lambda _role: nodes, named=lambda _node: named, description=described)
    Films(bench, get_design("different_base"), 10.0, 4.0)
    assert [sorted(node.set) for node in nodes] == used


def test_a_bench_is_refused_by_how_many_channels_its_own_nodes_have() -> None:
    check_nodes(get_design("array_16"), 3, channels=8)
    for design, nodes, more, message in (
        ("array_16", 8, {"channels": 2}, "'array_16' has 17 films on 9 sensor nodes of 2 channels; the bench has 8"),
        ("single", 0, {}, "has 2 films on 1 sensor node of 4 channels; the bench has 0"),
        ("single", 1, {"load": 5}, "has 2 films and load_channel 5 on 2 sensor nodes of 4 channels; the bench"),
    ):
        with pytest.raises(RangeError, match=message):
            check_nodes(get_design(design), nodes, **more)


def test_what_is_known_of_a_bench_before_it_is_opened_counts_the_channels_of_its_kind() -> None:
    listed = SimpleNamespace(kind=replace(KINDS["sensor_node"], channels=8))
    known: Any = SimpleNamespace(
        design="array_16",
        pickup=0.0,
        noise=None,
        force_limit=10.0,
        scene=None,
        filling=lambda _role: [listed] * 3,
        kind_in=lambda _role: None,
    )
    target = replace(Chosen(known, None).target, drivable=lambda _frequency: None)
    assert (target.nodes, target.channels) == (3, 8)
    for asked in (LoadSweep(), FrequencySweep((1.0, 2.0, 3.0)), SoftnessTest((get_sample("1"),), model="column")):
        asked.check(target)
        with pytest.raises(RangeError, match="17 films on 5 sensor nodes of 4 channels"):
            asked.check(replace(target, channels=4))


# --- The films are calibrated against the load cell, and later sweeps use and name the calibrat --------


CALIBRATE = ("calibrate", "films", "--loads", "1 N, 2 N, 3 N", "--extrapolate", "--dwell", "0.2 s", "--json")
ONE_POINT = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s", "--json")
SERIES = FilmSeries((2.0, 3.0, 4.0), dwell=0.2)
PAIR = """
name = "pair"
purpose = "Two teeth on one base that hear each other; a film that glue holds."
design = "common_base"

[effects.crosstalk]
[effects.glue_clamping]
factor = 0.5
[effects.adc]
"""


def test_crosstalk_and_clamping_of_a_scene_are_found(tmp_path: Path) -> None:
    with (
        SimulatedBench(scene_of(PAIR, tmp_path)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
        Recorder.create(tmp_path / "run", HEADER) as record,
    ):
        lab = Lab(bench, get_design("common_base"), IDEAL_CALIBRATION, run="run", started=CREATED)
        result = conduct(SERIES, lab, record)
    found = result.calibration
    assert ([film.clamping for film in found.films], np.array(found.crosstalk)) == (
        pytest.approx([0.5, 0.5, 1.0], rel=2e-3),
        pytest.approx(np.array([[1, 0.052], [0.052, 1]]), abs=5e-4),
    )
    assert (found.device, found.expires) == (bench.device("sensor_node_1").serial, "2026-03-14")
    stored = Run.open(tmp_path / "run").points()
    assert [(p["tooth"], p["load_N"]) for p in stored] == [(t, n) for t in (1, 2) for n in (2.0, 3.0, 4.0)]
    assert all(len(p["voltages_V"]) == 3 and p["valid"] and not p["extrapolated"] for p in stored)


def test_a_point_that_stays_flagged_ends_the_calibration_with_what_was_taken(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure = dynamic_load.measure
    taken = []

    def flagged(*arguments: object, **named: object) -> object:
        point = measure(*arguments, **named)  # type: ignore[arg-type]
        taken.append(point)
        if len(taken) == 2:
            object.__setattr__(point, "flags", (UNSETTLED,))
        return point

    monkeypatch.setattr(dynamic_load, "measure", flagged)
    with (
        Recorder.create(tmp_path / "run", HEADER) as record,
        pytest.raises(
            DeviceError, match=r"10 Hz, 3 N: .* not valid, .* unsettled: the films still drift .* wait longer"
        ),
    ):
        conduct(SERIES, Lab(bench, get_design("single"), THESIS_LOAD_CELL), record)
    assert [p["valid"] for p in Run.open(tmp_path / "run").points()] == [True, False]


@pytest.mark.slow
def test_a_sweep_uses_and_names_the_stored_film_calibration_alone_for_its_design(palpate: Palpate) -> None:
    before = palpate(*ONE_POINT).object
    assert before["film_calibration"] is None
    made = palpate(*CALIBRATE, "--budget").object
    path = Path(made["film_calibration_file"])
    found = read_calibration(path, FilmCalibration)
    assert found.simulated
    assert made["simulated"] is True
    assert [p["extrapolated"] for p in made["points"]] == [True, False, False]
    assert made["films"][1]["sensitivity_mV_per_N"] == found.films[1].sensitivity_mV_per_N
    assert [b["components"][0]["kind"] for b in made["budgets"]] == ["A", "A"]

    after = palpate(*ONE_POINT).object
    assert after["film_calibration"] == Path(made["run"]).name == found.source
    assert Run.open(Path(after["run"])).header["film_calibration"]["source"] == found.source  # type: ignore[index]
    (point,) = after["points"]
    assert point["force_total_N"] == pytest.approx(
        point["voltage_total_V"] / (1e-3 * found.films[1].sensitivity_mV_per_N)
    )
    scene = read_scene("thesis_single").identity
    assert path.name == f"films-20260101-single-scene-{scene}.toml"  # of this design and scene alone

    write_calibration(path, found.model_copy(update={"expires": "2024-02-29"}))
    said = palpate(*ONE_POINT)
    assert said.status == 2
    assert f"{path}: was made on a simulated bench" in said.complaint
    assert "expired on 2024-02-29; run palpate calibrate films" in said.complaint
