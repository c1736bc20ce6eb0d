"""Leaves out of a simulated bench the effects that the result of a procedure does not feel."""

from __future__ import annotations

from dataclasses import replace

from palpate.instrument.errors import UsageError
from palpate.procedures.lab.chosen import Chosen
from palpate.procedures.steps.dwells import Dwells
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.weights import reduced

FIDELITY = "--fidelity"


def at_fidelity(chosen: Chosen, fidelity: float, procedure: str, dwells: Dwells | None, seconds: float) -> Chosen:
    """The simulated bench without the effects that change no load set of a procedure by more than a fidelity.

    Args:
        chosen: the bench.
        fidelity: greatest relative change of force and force ratio.
        procedure: name of the procedure.
        dwells: its load sets; None: its result comes from more than these.
        seconds: expected time on the bench, after which the first one is tried, too [s].

    Raises:
        UsageError: the bench is real, or the procedure has no load sets alone.
        RangeError: the scene's model does not answer for an object.
        EstimateError: the films of the scene give no force ratio.
    """
    if chosen.scene is None:
        raise UsageError(f"{FIDELITY}: a real bench leaves nothing out; leave out this option")
    if dwells is None:
        raise UsageError(
            f"{FIDELITY}: the result of procedure {procedure!r} comes from more than load sets of one frequency, so it "
            "is not known what it feels; leave out this option"
        )
    loads = dict.fromkeys(dwells.loads)  # the least one first
    questions = [Question(each, load, dwells.frequency, dwells.dwell) for each in dwells.objects for load in loads]
    asked = [*((question, 0.0) for question in questions), (questions[0], seconds)]
    return replace(chosen, scene=reduced(chosen.scene, fidelity, asked))
