"""Leaves out of a scene the effects that an answer does not feel.

    reduced(read_scene("everything"), 1e-3, [(Question("2", 4.0), 0.0), (Question("6", 1.5), 600.0)])

Force and force ratio are computed with all effects and with some, with the same noise and scatter, for each question
and at several times of the bench. What is left out together changes none of them by more than the fidelity. It is
measured in a few draws and not proven, unlike the bounds by which effects `when = "auto"` are chosen. A bench without
these effects comes to its load sets at other times, so scatter and noise of a run may be drawn anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from palpate.instrument.errors import EstimateError
from palpate.instrument.notice import price
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.weights import UNFELT, Seen, changes, leaving_out, see
from palpate.simulators.scenes.scene import Scene

DRAWS = 2  # seeds; every draw of every question counts


def reduced(scene: Scene, fidelity: float, asked: Sequence[tuple[Question, float]]) -> Scene:
    """The scene without the effects that change no answer by more than the fidelity.

    The effect that changes the first question's answer least is left out first, then others as long as all answers
    allow it. Effects that the films do not show stay: the times of both buses, and the load cell.

    Args:
        scene: the scene.
        fidelity: greatest relative change of force and force ratio.
        asked: the measurements, each with the time of the bench at which its load is set [s].

    Raises:
        RangeError: the scene's model does not answer for a sample.
        EstimateError: the films of the whole scene give no force ratio.
    """
    whole = [see(scene, *each, DRAWS) for each in asked]

    def change(without: Iterable[str], count: int) -> float:
        less = leaving_out(scene, without)
        try:
            return max(
                _greatest(before, see(less, *each, DRAWS)) for before, each in zip(whole[:count], asked, strict=False)
            )
        except EstimateError:
            return math.inf

    once = DRAWS * sum(each.seconds for each in whole)
    price("finding out what the result does not feel", once * math.log2(len(scene.effects) + 2))
    felt = [name for name, effect in scene.effects.items() if not isinstance(effect, UNFELT)]
    alone = {name: change([name], 1) for name in felt}
    order = sorted((name for name in felt if alone[name] <= fidelity), key=alone.__getitem__)
    most, least = len(order), 0
    while least < most:  # how many together are too many is found by halving; what is left out was tried as a whole
        middle = (least + most + 1) // 2
        least, most = (middle, most) if change(order[:middle], len(asked)) <= fidelity else (least, middle - 1)
    return leaving_out(scene, order[:least]).at_fidelity(fidelity, order[:least])


def _greatest(whole: Seen, other: Seen) -> float:
    return max(float(each.max()) for each in changes(whole, other))
