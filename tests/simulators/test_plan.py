"""How a scene is answered, what forces that, and what is left out; and that answers known at once are right."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Complexes, Floats
from palpate.instrument.sensor.designs import get_design
from palpate.simulators.effects import EFFECTS
from palpate.simulators.linear.periodic import HERTZ, SECOND
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning import plan as planning
from palpate.simulators.planning.plan import (
    CLOSED_FORM,
    DESCRIBING_FUNCTION,
    TRANSITIONS,
    AnswerPlan,
    Question,
    driven,
    followed,
    phasors,
    plan,
    steady_state,
)
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene
from tests.simulators.rigs import STRONG, an_effect, scene


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


# --- what is known at once is what stepping gives ----------------------------------------------------

STEPS = 100  # a cycle
LINEAR = (
    "frequency_error", "shaker_dynamics", "viscoelastic", "crosstalk", "glue_clamping", "off_axis", "gain_scatter",
    "pyroelectric", "triboelectric", "charge_amplifier", "voltage_amplifier",
)  # fmt: skip
LIMITS = ("amplifier_clip", "current_limit", "end_stops")  # each may stand by, with its certificate
OTHERS = tuple(name for name in LINEAR if name not in ("charge_amplifier", "voltage_amplifier"))
COMBINATIONS = (
    *((name,) for name in LINEAR),
    (*LIMITS, *OTHERS, "charge_amplifier"),
    (*LIMITS, *OTHERS, "voltage_amplifier"),
    *((*OTHERS[:k], *OTHERS[k + 1 :], "charge_amplifier") for k in range(len(OTHERS))),
)


def calling_for(effects: dict[str, Effect], design: str = "single") -> Scene:
    return replace(scene(), effects={n: effects[n] for n in EFFECTS if n in effects}, design=get_design(design))


def a_cycle(rig: Rig, start: Floats | None) -> tuple[Floats, Floats, float]:
    """A cycle of the drive by exact steps: outputs (p, STEPS), the first step [s], from a state or the one it keeps."""
    system = rig.path.mode_at(rig.path.start_ns).system
    voltage, s = rig.coil_voltage(), system.order
    w, step = 2 * math.pi * voltage.frequency / HERTZ, HERTZ / voltage.frequency / STEPS
    # The drive turns by itself: its phasor's parts and 1 are states too.
    a = np.zeros((s + 3, s + 3))
    u = np.array([[voltage.amplitude[0].real, -voltage.amplitude[0].imag, 0.0], [0.0, 0.0, 1.0]])
    rate = w * np.array([[-voltage.amplitude[0].imag, -voltage.amplitude[0].real, 0.0]])
    inputs = np.vstack([u, rate])
    a[:s, :s], a[:s, s:] = system.a, system.b @ inputs
    a[s, s + 1], a[s + 1, s] = -w, w
    rows = np.hstack([system.c, system.d @ inputs])
    turn = np.array([1.0, 0.0, 1.0])
    once = scipy.linalg.expm(a * step)
    if start is None:
        cycle = np.linalg.matrix_power(once, STEPS)
        start = np.linalg.solve(np.eye(s) - cycle[:s, :s], cycle[:s, s:] @ turn)
    states = [np.concatenate([start, turn])]
    for _ in range(STEPS - 1):
        states.append(once @ states[-1])
    return rows @ np.array(states).T, np.array(states[0][:s]), step


@pytest.mark.parametrize("names", COMBINATIONS, ids=" ".join)
def test_the_closed_form_of_a_linear_scene_is_what_stepping_gives(names: tuple[str, ...]) -> None:
    """Both agree to 1e-9, from the moment the drive is set and when the scene has settled."""
    effects = {name: type(STRONG[name])() if name in LIMITS else STRONG[name] for name in names}
    rig = driven(calling_for(effects, "common_base"), Question())
    films = len(rig.scene.design.films)
    assert rig.transitions(2 * SECOND) == []
    stepped, _, step = a_cycle(rig, rig.path.state(rig.path.start_ns))
    times = np.round(np.arange(STEPS) * step * SECOND).astype(np.int64)
    late = (1e-9 * times - np.arange(STEPS) * step) * rig.film_rates(times)  # of times that are no whole nanosecond
    assert np.abs(rig.film_voltages(times) - late - stepped[:films]).max() < 1e-9 * np.abs(stepped[:films]).max()
    settled, _, _ = a_cycle(rig, None)
    sums = 2 * settled @ np.exp(-2j * np.pi * np.arange(STEPS) / STEPS) / STEPS
    found = phasors(rig)
    assert found == pytest.approx(sums[[*range(films), films + 1]], rel=1e-9)


# --- plays ---------------------------------------------------------------------------------------------


def integral(rig: Rig, first_ns: int) -> Complexes:
    """Fundamentals of the films over a period, by Gauss' rule between the transitions."""
    period = SECOND * HERTZ // rig.coil_voltage().frequency
    rig.film_voltages(np.array([first_ns]))
    cycle = rig.path.cycle
    assert cycle is not None and cycle.cycles(first_ns) == 0
    cuts = [first_ns, *(first_ns + math.ceil(begin * period) for begin in cycle.begins[1:]), first_ns + period]
    total = np.zeros(len(rig.scene.design.films), complex)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for start, end in itertools.pairwise(cuts):
        exact = (end + start + (end - start) * nodes) / 2 - first_ns
        at = first_ns + np.clip(np.round(exact).astype(np.int64), start - first_ns, end - 1 - first_ns)
        late = 1e-9 * (at - first_ns - exact)  # of times that are no whole nanosecond
        turns = np.exp(-2j * np.pi * (1e-18 * rig.coil_voltage().phase(at) - late * SECOND / period))
        total += (end - start) * (rig.film_voltages(at) - late * rig.film_rates(at)) @ (weights * turns)
    return total / period


PLAYED = {
    "alone": {},
    "behind a moving shaker and rubber": {"shaker_dynamics": STRONG["shaker_dynamics"], "viscoelastic": "rubber"},
    "before an amplifier, beside a cable and neighbours": {
        "charge_amplifier": "0.02 s", "triboelectric": STRONG["triboelectric"], "crosstalk": STRONG["crosstalk"],
    },
}  # fmt: skip
GIVEN = {"viscoelastic": "material", "charge_amplifier": "time_constant"}


@pytest.mark.parametrize("case", PLAYED)
@pytest.mark.parametrize("path", ["rigid", "total"])
def test_plays_on_a_sine_settle_to_their_describing_functions(case: str, path: str) -> None:
    """One hardly moves, one does not at all, and one lets a part through backwards."""
    plays = an_effect(
        "hysteresis", weights=[0.3, -0.2, 0.1, 0.5], radii=["0.01 N", "0.1 N", "0.15 N", "9 N"], path=path
    )
    effects: dict[str, Effect] = {"hysteresis": plays}
    for name, given in PLAYED[case].items():
        effects[name] = given if isinstance(given, Effect) else type(STRONG[name]).model_validate({GIVEN[name]: given})
    rig = driven(calling_for(effects, "common_base"), Question("1", 4.0))
    found, exact = phasors(rig)[:-1], integral(rig, 9 * SECOND)
    assert np.abs(found / exact - 1).max() < 1e-9
    assert np.abs(followed(rig)[:-1] / exact - 1).max() < 1e-6
    still = {**effects, "hysteresis": an_effect("hysteresis", weights=(0.0,), radii=("1 N",))}
    without = phasors(driven(calling_for(still, "common_base"), Question("1", 4.0)))[:-1]
    assert np.abs(found / without - 1).max() > 0.02


# --- what comes of it ----------------------------------------------------------------------------------


@pytest.mark.parametrize("design", ["single", "common_base", "different_base"])
def test_without_effects_the_settled_ratios_are_those_of_the_thesis_at_the_load_that_was_asked_for(design: str) -> None:
    rig = driven(calling_for({}, design), Question("3", 2.5))
    settled = steady_state(rig, phasors(rig))
    assert settled.force == pytest.approx(2.5, rel=1e-12)
    ratios = {film.film: film.ratio for film in settled.films if film.ratio is not None}
    assert len(ratios) == len(rig.scene.design.teeth)
    for ratio in ratios.values():
        assert ratio == pytest.approx(rig.scene.design.thesis_force_ratio["3"], rel=1e-12)
    assert all(abs(film.phase) < 1e-12 for film in settled.films)
