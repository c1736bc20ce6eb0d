"""The plan of a scene: how it is answered, what forces that, what it costs, and what is left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.simulators.effects import EFFECTS
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning import plan as planning
from palpate.simulators.planning.plan import (
    CLOSED_FORM,
    DESCRIBING_FUNCTION,
    TRANSITIONS,
    AnswerPlan,
    Question,
    plan,
)
from palpate.simulators.planning.settle import read_scene
from tests.simulators.rigs import an_effect, scene


def planned(question: Question | None = None, **effects: Effect) -> AnswerPlan:
    question = question or Question()
    named = {name: effects[name] for name in EFFECTS if name in effects}
    return plan(replace(scene(), effects=named, called=dict.fromkeys(named, "called for")), question)


@pytest.fixture
def unbounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bounds of what is left out take most of a plan's time."""
    monkeypatch.setattr(planning, "omissions", lambda *_: ([], []))


# --- the path ------------------------------------------------------------------------------------------

INACTIVE = {
    "amplifier_clip": an_effect("amplifier_clip", rail="20 V"),
    "current_limit": an_effect("current_limit"),
    "end_stops": an_effect("end_stops"),
}
PLAYS = an_effect("hysteresis", weights=(0.1,), radii=("50 mN",))
CLIPPED = an_effect("amplifier_clip", rail="1 V")
ACTING = {
    "the amplifier clips": {"amplifier_clip": CLIPPED},
    "the current limit acts": {"current_limit": an_effect("current_limit", limit="0.3 A")},
    "the armature meets a stop": {"end_stops": an_effect("end_stops", travel="1 mm")},
    "play operators move": {"hysteresis": PLAYS},
    "play operators move, the amplifier clips": {"hysteresis": PLAYS, "amplifier_clip": CLIPPED},
}


@pytest.mark.usefixtures("unbounded")
@pytest.mark.parametrize("steady", [False, True])
def test_what_is_linear_with_limits_that_stay_inactive_is_known_in_closed_form(steady: bool) -> None:
    for effects in (
        {},
        INACTIVE,
        {**INACTIVE, "charge_amplifier": an_effect("charge_amplifier"), "white_noise": an_effect("white_noise")},
    ):
        found = planned(Question(steady=steady), **effects)
        assert (found.path, found.transitions) == (CLOSED_FORM, 0.0)
        assert "it is proven for each limit" in found.why


@pytest.mark.usefixtures("unbounded")
@pytest.mark.parametrize("why", ACTING)
def test_a_limit_that_acts_and_a_play_that_moves_are_gone_through_and_named(why: str) -> None:
    found = planned(**ACTING[why])
    assert (found.path, found.why) == (TRANSITIONS, why)
    assert found.transitions >= 20  # two a cycle at the least


@pytest.mark.usefixtures("unbounded")
def test_a_probe_that_lifts_off_is_gone_through(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "PRELOAD", 0.4)
    found = planned()
    assert (found.path, found.why) == (TRANSITIONS, "the probe loses contact")


@pytest.mark.usefixtures("unbounded")
def test_plays_that_alone_move_settle_by_their_describing_function_and_beside_a_limit_they_do_not() -> None:
    settled = Question(steady=True)
    assert planned(settled, hysteresis=PLAYS).path == DESCRIBING_FUNCTION
    assert planned(settled, hysteresis=PLAYS, shaker_dynamics=an_effect("shaker_dynamics")).path == DESCRIBING_FUNCTION
    assert planned(settled, hysteresis=PLAYS, amplifier_clip=CLIPPED).path == TRANSITIONS
    assert (
        planned(settled, hysteresis=an_effect("hysteresis", weights=(0.1,), radii=("9 N",))).path == CLOSED_FORM
    )  # none moves
    assert planned(hysteresis=PLAYS).path == TRANSITIONS  # waveforms have corners


@pytest.mark.usefixtures("unbounded")
def test_only_a_question_of_the_settled_state_is_answered_with_it() -> None:
    assert planned().steady is None
    found = planned(Question("1", 2.0, steady=True), hysteresis=PLAYS).steady
    assert found is not None
    assert found.force == pytest.approx(2.0, rel=1e-9)
    rigid, total = found.films
    assert (rigid.film, total.film, total.ratio) == ("rigid", "total", None)
    assert rigid.ratio is not None and 0.316 < rigid.ratio < 0.316 * 1.1
    assert rigid.phase < 0 == round(total.phase, 12)


# --- in and out ----------------------------------------------------------------------------------------


def test_every_effect_is_either_in_or_out() -> None:
    for name in ("ideal", "thesis_single", "everything"):
        chosen = read_scene(name)
        found = plan(chosen, Question())
        assert [each.name for each in found.included] == list(chosen.effects)
        assert {each.name for each in found.omitted} == set(EFFECTS) - set(chosen.effects)
        assert {each.why for each in found.included} <= {"called for"}


def test_an_effect_that_another_excludes_could_change_nothing_and_one_without_limit_says_so() -> None:
    with_charge = {each.name: each for each in planned(charge_amplifier=an_effect("charge_amplifier")).omitted}
    assert (with_charge["voltage_amplifier"].force, with_charge["voltage_amplifier"].ratio) == (0.0, 0.0)
    alone = {each.name: each for each in planned().omitted}
    assert (alone["voltage_amplifier"].ratio or 0.0) > 0.5
    clipped = {each.name: each for each in planned(amplifier_clip=CLIPPED).omitted}
    assert (clipped["mains_hum"].force, clipped["mains_hum"].ratio) == (None, None)


# --- what a measurement will suffer from ----------------------------------------------------------------


SMALL = Question("2", 0.5)  # N; a fifth of a millivolt under the tooth


@pytest.mark.usefixtures("unbounded")
def test_a_film_of_few_steps_without_noise_is_warned_of() -> None:
    (warning,) = planned(SMALL).warnings
    for part in ("film 'rigid'", "is 14 steps", "below 20", "below half a step", "take a larger load, or noise"):
        assert part in warning
    assert planned(SMALL, white_noise=an_effect("white_noise", density="10 µV/√Hz")).warnings == ()
    assert planned(charge_amplifier=an_effect("charge_amplifier")).warnings == ()  # on the finest range


@pytest.mark.usefixtures("unbounded")
def test_films_that_the_converter_cuts_off_are_warned_of_and_those_that_the_widest_range_holds_are_not() -> None:
    warnings = planned(mains_hum=an_effect("mains_hum", amplitude="6 V")).warnings
    assert [warning.partition(":")[0] for warning in warnings] == ["film 'rigid'", "film 'total'"]
    assert "the widest range of the converter, 5 V: points are clipped and not used" in warnings[0]
    assert planned(mains_hum=an_effect("mains_hum", amplitude="4 V")).warnings == ()
