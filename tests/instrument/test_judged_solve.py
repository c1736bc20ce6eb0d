"""What a solve takes is known and told before anything is solved, and a solve can be interrupted."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument import notice
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements import elimination, work
from palpate.instrument.models.parameters import solid_parameters
from palpate.instrument.models.response import RatioQuestion, ask
from palpate.instrument.models.solid import model
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.system import System
from palpate.instrument.notice import notices_to, price
from tests.shares import first_of

AT = (3e-3, 3e-3)


@pytest.fixture(autouse=True)
def nothing_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No curve is kept, neither on disk nor in memory."""
    monkeypatch.setenv(work.VARIABLE, str(tmp_path / "curves"))
    model.curve_of_one.cache_clear()
    model.judged.cache_clear()
    yield
    model.curve_of_one.cache_clear()
    model.judged.cache_clear()


@pytest.fixture
def unsolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be solved."""

    def solved(*_: object) -> None:
        raise AssertionError("an elimination has begun")

    monkeypatch.setattr(elimination, "factorised", solved)


@pytest.mark.usefixtures("unsolved")
@pytest.mark.parametrize("design", first_of(["single", "array"]))
def test_what_does_not_fit_into_memory_is_refused_before_anything_is_solved(
    design: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(work, "free_memory", lambda: 500_000_000)
    said: list[str] = []
    remedy = "take another model or a design of fewer teeth, or spread the load evenly"
    with (
        notice.notices_to(said.append),
        pytest.raises(EstimateError, match=rf"a mesh of \d+ unknowns needs [\d.]+ GB of memory, .* free; {remedy}$"),
    ):
        ask(RatioQuestion(design, "solid", at=AT), [1e5])
    assert said == []


@pytest.mark.slow
def test_a_finer_mesh_that_does_not_fit_is_refused_with_a_larger_tolerance_as_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "free_memory", lambda: 150_000_000)
    monkeypatch.setattr(notice, "LONG", 0.0)
    monkeypatch.setattr(model, "LONG", 0.0)
    said: list[str] = []
    with (
        notice.notices_to(said.append),
        pytest.raises(EstimateError, match=r"give a larger tolerance, or take another model$"),
    ):
        ask(RatioQuestion("single", "solid", tolerance=1e-6), [1e5])
    (sentence,) = said
    assert sentence.endswith("kept; a finer mesh, if these do not meet the tolerance, does not fit into memory")


@pytest.mark.slow
def test_the_whole_price_is_said_once_and_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "RATE", 1e9)
    said: list[str] = []
    eliminate = elimination.factorised

    def checked(matrix: np.ndarray) -> np.ndarray | None:
        assert len(said) == 1
        return eliminate(matrix)

    monkeypatch.setattr(elimination, "factorised", checked)
    with notice.notices_to(said.append):
        ask(RatioQuestion("single", "solid"), [1e5, 2e5])
        ask(RatioQuestion("single", "solid"), [3e5])
    (sentence,) = said
    assert sentence.startswith("setting up meshes of up to 37212 unknowns takes about ")


@pytest.mark.parametrize("design", first_of(["single", "common_base"]))
def test_the_cost_of_a_mesh_is_that_of_the_eliminations_that_follow(
    design: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the work of the fronts themselves."""
    question = RatioQuestion(design, "solid", at=AT)
    parameters = replace(solid_parameters(question.sensor(), question.load(1.0)), force=1.0)
    system = System(parameters, Resolution(layers=1, ratio=0.15, sectors=1, degree=2))
    expected, done = system.cost(), []
    judged = elimination.require_memory
    monkeypatch.setattr(elimination, "require_memory", lambda own, remedy: (done.append(own), judged(own, remedy)))
    system.curve([system.load(AT)])
    poles = model.total([expected, *(replace(each, operations=-each.operations) for each in done)]).operations
    assert 0 < poles < expected.operations
    assert expected.entries == max(each.entries for each in done)


def test_a_solve_ends_at_once_when_it_is_interrupted_and_does_not_go_on_behind() -> None:
    ended = threading.Event()

    def endless() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        try:
            while True:
                work.go_on()
        finally:
            ended.set()

    with pytest.raises(KeyboardInterrupt):
        work.interruptible(endless)
    assert ended.wait(60)
    work.go_on()  # nobody has given up this thread


def test_an_error_of_a_solve_is_raised_where_it_was_asked_for() -> None:
    with pytest.raises(ZeroDivisionError):
        work.interruptible(lambda: 1 / 0)
    found: list[float] = []
    own = threading.Thread(target=lambda: found.append(work.interruptible(lambda: 2.0)))
    own.start()
    own.join()
    assert found == [2.0]


# --- The price of a long computation is told before it begins ------------------------------------------


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (2.0, []),
        (2.1, ["solving takes about 2 s; kept"]),
        (9.7, ["solving takes about 10 s; kept"]),
        (14.2, ["solving takes about 14 s; kept"]),
        (47.0, ["solving takes about 50 s; kept"]),
        (600.0, ["solving takes about 10 min; kept"]),
        (9000.0, ["solving takes about 2.5 h; kept"]),
    ],
)
def test_what_takes_more_than_two_seconds_is_told_with_its_price(seconds: float, said: list[str]) -> None:
    heard: list[str] = []
    with notices_to(heard.append):
        price("solving", seconds, "; kept")
    price("solving", seconds, "; kept")  # nobody listens
    assert heard == said
