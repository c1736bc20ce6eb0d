"""A long dwell is stored while it lasts: a run that ends within it loses nothing, and readers see one dwell.

Private names are used where nodes of another kind are needed, and where a record goes on without a bench.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate import RangeError, RecordError, get_design
from palpate.extend import Bench, SensorNode
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.engine.run import Unrecorded
from palpate.procedures.lab import operator
from palpate.procedures.records.damage import check, repair
from palpate.procedures.records.record import Recorder, StoredDwell
from palpate.procedures.records.record_file import IN_A_FRAME, InPieces
from palpate.procedures.records.resumed import Resumed
from palpate.procedures.records.run import Run, reading
from palpate.procedures.steps import films
from palpate.procedures.steps.films import FilmRecord, Films, LongFilmRecord
from palpate.simulators.bench import SimulatedBench
from tests import damages
from tests.procedures.conftest import HEADER, OFF, Palpate, outputs
from tests.runs import flip

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "130 s", "--quiet")
PIECES = 3  # of a dwell: two of a minute, and the rest
RATE, FREQUENCY = 250.0, 10.0  # Hz
STORED = "60 s of a dwell at point 2 are stored"

CutShort = Callable[[int], None]


@pytest.fixture
def cut_short(monkeypatch: pytest.MonkeyPatch) -> CutShort:
    """Has the run interrupted once so many pieces were stored; 0: never."""
    add = StoredDwell.add

    def install(pieces: int) -> None:
        stored = 0

        def added(self: StoredDwell, waveforms: dict[str, tuple[float, np.ndarray]]) -> None:
            nonlocal stored
            add(self, waveforms)
            stored += 1
            if stored == pieces:
                raise KeyboardInterrupt

        monkeypatch.setattr(StoredDwell, "add", added)

    return install


def kinds(folder: str) -> list[tuple[str, int]]:
    """Kind and id of each row of a record."""
    with reading(Path(folder)) as stored:
        return [(frame.kind.decode(), frame.id) for frame in stored.frames]


# --- in a procedure ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_run_that_ended_within_a_dwell_goes_on_there_and_is_as_one_that_did_not(
    palpate: Palpate, cut_short: CutShort
) -> None:
    assert palpate(*SWEEP, "--out", "whole").status == 0
    whole = Run.open(Path("whole"))
    check_fitted(whole)
    cut_short(PIECES + 1)
    assert palpate(*SWEEP, "--out", "cut").status == 130
    assert all(f"unfinished: {STORED}\n" in palpate("runs", what, "cut").out for what in ("check", "show"))
    assert palpate("runs", "show", "cut", "--json").object["unfinished"] == STORED
    cut_short(PIECES + 2)  # what is stored already is compared, so this ends one piece later
    assert palpate("runs", "resume", "cut").status == 130
    assert "unfinished: 120 s of" in palpate("runs", "check", "cut").out
    cut_short(0)
    Path("cut/scene.toml").unlink()  # the header has it
    assert palpate("runs", "resume", "cut", "--quiet").status == 0
    run = Run.open(Path("cut"))
    assert (run.digest(), run.summary) == (whole.digest(), whole.summary)
    assert "unfinished" not in palpate("runs", "check", "cut", "--json").object
    waves = [[row for row in kinds(folder) if row[0] == "WAVE"] for folder in ("whole", "cut")]
    assert waves[0] == waves[1] and len(waves[0]) == 2 * 2 * PIECES
    assert [event["message"] for event in run.events() if event["kind"] == "continued"] == [
        f"after point 1; {stored}, and it goes on" for stored in (STORED, STORED.replace("60", "120"))
    ]


def check_fitted(run: Run) -> None:
    """Each point must be the fit of the samples in its record."""
    for point in run.points():
        names = run.waveform_names(point["id"])
        volts = np.array([run.waveform(point["id"], name) for name in names], dtype=np.float64)
        assert volts.shape == (2, round(130 * RATE))
        fit = fit_sine(np.arange(1, volts.shape[1] + 1) / RATE, volts, FREQUENCY)
        found = [point["voltage_rigid_V"], point["voltage_total_V"]]
        assert (found, point["dwell_s"]) == (pytest.approx([2 * each for each in fit.unbiased], rel=1e-9), 130.0)


@pytest.mark.slow
def test_on_a_real_bench_a_dwell_that_ended_is_taken_anew_and_what_was_measured_stays(
    palpate: Palpate, cut_short: CutShort, lab: str, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operator, "confirm", lambda _what, _word: None)
    cut_short(PIECES + 1)
    assert palpate(*SWEEP, "--out", "cut", "--bench", lab).status == 130
    cut_short(0)
    assert palpate("runs", "resume", "cut", "--quiet").status == 0
    run = Run.open(Path("cut"))
    assert len(run.points()) == 2
    check_fitted(run)
    assert kinds("cut").count(("WAVE", 2)) == 2 * (1 + PIECES)
    assert f"after point 1; {STORED}, and it is taken anew" in [event["message"] for event in run.events()]
    assert (check(run.folder).faults, outputs(sim)) == ([], OFF)


def test_samples_that_differ_from_those_that_are_stored_are_not_taken_for_them(
    palpate: Palpate, cut_short: CutShort, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut_short(1)
    assert palpate(*SWEEP, "--out", "cut").status == 130
    cut_short(0)
    add = LongFilmRecord.add

    def other(self: LongFilmRecord, piece: FilmRecord) -> None:
        add(self, FilmRecord(piece.rate, piece.time, piece.voltage * (1 + 1e-6), piece.clipped))

    monkeypatch.setattr(LongFilmRecord, "add", other)
    said = palpate("runs", "resume", "cut", "--quiet").complaint
    assert "samples of point 1 from number 1 on is not what the bench gives now" in said


# --- in a record ---------------------------------------------------------------------------------------


def begun(folder: Path) -> Recorder:
    return Recorder.create(folder, HEADER)


def samples(first: int, count: int = 5) -> dict[str, tuple[float, np.ndarray]]:
    """Samples of two waveforms."""
    numbers = np.arange(first, first + count)
    return {"film": (RATE, 1.5 * numbers), "total": (RATE, -0.5 * numbers)}


def listed(dwell: StoredDwell) -> dict[str, tuple[float, InPieces]]:
    return dict.fromkeys(("film", "total"), (RATE, InPieces(dwell.number, dwell.samples)))


def test_of_several_dwells_at_a_point_the_one_counts_that_the_point_names(tmp_path: Path) -> None:
    with begun(tmp_path) as record:
        for first in (100, 200, 300):
            dwell = record.begin_dwell()
            dwell.add(samples(first))
            dwell.add(samples(first + 5, 3))
            found = [(at, piece["film"].tolist()) for at, piece in dwell.pieces()]
            expected = (1.5 * np.arange(first, first + 8)).tolist()
            assert found == [(0, expected[:5]), (5, expected[5:])]
            if first == 200:
                kept = listed(dwell)
        record.point({}, kept, 7)
        record.point({}, {"film": (RATE, np.ones(3))}, 8)
        record.finish("complete", {"a": 1})
    run, checked = Run.open(tmp_path), check(tmp_path)
    assert [run.waveform(*each).tolist() for each in ((1, "film"), (1, "total"), (2, "film"))] == [
        (1.5 * np.arange(200, 208)).tolist(), (-0.5 * np.arange(200, 208)).tolist(), [1.0, 1.0, 1.0],
    ]  # fmt: skip
    assert (checked.faults, checked.unfinished, checked.waveforms) == ([], "", 3)


def test_samples_in_pieces_have_the_digest_of_samples_that_are_stored_at_once(tmp_path: Path) -> None:
    with begun(tmp_path / "pieces") as record:
        dwell = record.begin_dwell()
        dwell.add(samples(0, 100))
        dwell.add(samples(100, IN_A_FRAME))
        record.point({"a": 1}, listed(dwell), 7)
    with begun(tmp_path / "whole") as record:
        record.point({"a": 1}, samples(0, IN_A_FRAME + 100), 7)
    assert Run.open(tmp_path / "pieces").digest() == Run.open(tmp_path / "whole").digest()


def test_a_piece_that_is_no_row_of_a_record_is_refused(tmp_path: Path) -> None:
    with begun(tmp_path) as record:
        dwell = record.begin_dwell()
        for piece in (samples(0, IN_A_FRAME + 1), {**samples(0, 5), "third": (RATE, np.ones(4))}):
            with pytest.raises(RangeError, match="give as many of each, 262144 at most"):
                dwell.add(piece)
        assert dwell.samples == 0


def test_a_repair_says_what_it_leaves_out(tmp_path: Path) -> None:
    with begun(tmp_path / "run") as record:
        dwell = record.begin_dwell()
        dwell.add(samples(0))
        record.point({}, listed(dwell), 7)
        record.begin_dwell().add(samples(50))
    done = repair(tmp_path / "run", tmp_path / "repaired")
    assert (done.points, done.waveforms) == (1, 2)
    assert done.gone == ["what was stored of a dwell at point 2, which was not finished"]
    assert Run.open(tmp_path / "repaired").waveform(1, "film").tolist() == [0.0, 1.5, 3.0, 4.5, 6.0]


@pytest.mark.parametrize("finished", [True, False])
def test_a_damaged_piece_is_told(tmp_path: Path, finished: bool) -> None:
    with begun(tmp_path) as record:
        dwell = record.begin_dwell()
        dwell.add(samples(50))
        flip(tmp_path / "run.record", np.float32(76.5).tobytes())
        with pytest.raises(RecordError, match="a waveform of point 1 is not as it was written"):
            list(dwell.pieces())
        if finished:
            record.point({}, listed(dwell), 7)
    what = "waveform 'film' of point 1" if finished else "a waveform of point 1"
    assert f"{what} is not as it was written" in check(tmp_path).faults[0]


def test_a_piece_that_was_not_acknowledged_does_not_count(tmp_path: Path) -> None:
    """The writer was killed after it had written the samples, and before it had written how many rows there are."""
    head, stored = tmp_path / "run.head", "0.02 s of a dwell at point 1 are stored"
    with Recorder.create(tmp_path, damages.HEADER) as record:
        dwell = record.begin_dwell()
        dwell.add(samples(0))
        before = head.read_bytes()
        dwell.add(samples(5))
        record.close()
    head.write_bytes(before)
    assert (check(tmp_path).faults, check(tmp_path).unfinished) == ([], stored)
    with Resumed(Run.open(tmp_path), replay=False, accept=False) as record:
        record.begin(damages.HEADER)
    assert check(tmp_path).unfinished == stored


# --- the films -----------------------------------------------------------------------------------------


def test_the_films_of_a_long_dwell_do_what_films_in_memory_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    count = 40_000
    time = np.arange(1, count + 1) / RATE
    drive = np.outer([0.2, 0.3], np.cos(2 * np.pi * FREQUENCY * time))
    volts = np.float32(drive + 1e-3 * np.random.default_rng(3).standard_normal((2, count))).astype(np.float64)
    clipped = np.zeros(volts.shape, bool)
    clipped[1, 20_100:20_300] = True
    volts[0, 35_000:35_010] = np.nan
    memory = FilmRecord(RATE, time, volts, clipped)
    monkeypatch.setattr(films, "IN_A_FRAME", 10_000)  # a piece of more samples is several rows
    with begun(tmp_path) as record:
        stored, held = (LongFilmRecord(each.begin_dwell(), ["film", "total"]) for each in (record, Unrecorded()))
        for part in np.split(np.arange(count), [15_000, 30_000]):
            for each in (stored, held):
                each.add(FilmRecord(RATE, time[part], volts[:, part], clipped[:, part]))
        for one, other in (
            (stored, memory),
            (held, memory),  # as a run is done again
            (stored.first(50.0), memory.first(50.0)),
            (stored.last(100.0), memory.last(100.0)),
            (stored.last(100.0).first(30.0), memory.last(100.0).first(30.0)),
        ):
            assert (one.samples, one.rate) == (other.samples, other.rate)
            assert one.between(500) == pytest.approx(other.between(500))
            for with_clipped in (False, True):
                for found, expected in zip(one.usable(with_clipped), other.usable(with_clipped), strict=True):
                    assert np.array_equal(found, expected)
            fit, expected_fit = (each.fit(FREQUENCY, clipped=False) for each in (one, other))
            assert fit.amplitude == pytest.approx(expected_fit.amplitude, rel=1e-12)
            assert fit.phase == pytest.approx(expected_fit.phase, rel=1e-9, abs=1e-12)
        told = [[getattr(each, name).tolist() for name in ("clips", "gaps", "silent")] for each in (stored, memory)]
        assert (told[0], told[0][:2]) == (told[1], [[False, True], [True, False]])


def test_nodes_that_give_no_pieces_are_stored_in_pieces_too(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Whole:
        """A node of a kind that records at once."""

        def __getattr__(self, name: str) -> object:
            if name == "pieces_with":
                raise AttributeError(name)
            return getattr(node, name)

    def recorded(folder: Path) -> tuple[int, float, list[float]]:
        with begun(folder) as record:
            found = Films(bench, get_design("single"), FREQUENCY, 4.0).recorded(70.0, record)
            assert isinstance(found, LongFilmRecord)
            return found.samples, found.rate, found.usable(clipped=False)[0].tolist()

    node = bench.all(SensorNode)[0]
    named, in_pieces = bench.named(node), recorded(tmp_path / "pieces")
    monkeypatch.setattr(bench, "all", lambda _role: [Whole()])
    monkeypatch.setattr(bench, "named", lambda _device: named)
    assert (recorded(tmp_path / "whole"), in_pieces[:2]) == (in_pieces, (70 * RATE, RATE))
