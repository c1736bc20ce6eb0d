"""The heads of scene files: what a list says of each scene, read without all that a whole scene needs.

Neither pydantic nor numpy is imported here: that takes longer than to list all scenes.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from palpate.instrument.contracts.own import place
from palpate.instrument.errors import PalpateError
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design

if TYPE_CHECKING:
    from palpate.simulators.scenes.scene import Scene

SAID = {"name": str, "purpose": str, "design": str, "model": str, "seed": int}  # keys that a list shows as they are
CHOSEN = "auto"  # what a file says where the effects or the model are chosen by calculation
UNSAID = {"parameters", "tolerance", "nodes"}  # keys that no shipped scene has, and that other keys must go with


class SceneHead(TypedDict):
    """What a list says of a scene."""

    scene: str
    purpose: str
    design: str
    model: str
    parameter_set: str | None
    seed: int
    nodes: int
    effects: list[str]


def shipped() -> dict[str, Path]:
    """The scenes that come with palpate, by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}


def fewest_nodes(design: Design) -> int:
    """How many sensor nodes the films of a design need."""
    return max(place(film.channel)[0] for film in design.films)


def head_of(scene: Scene) -> SceneHead:
    """The head of a scene that was read whole."""
    return {
        "scene": scene.name,
        "purpose": scene.purpose,
        "design": scene.design.name,
        "model": scene.model,
        "parameter_set": scene.file.parameters,
        "seed": scene.seed,
        "nodes": scene.nodes,
        "effects": list(scene.effects),
    }


def head_in(path: Path) -> SceneHead | None:
    """The head of a scene file whose effects are in the order of the chain, as those that come with palpate.

    None: it takes more than these keys to tell it, or one of them is wrong. Then read the whole scene, which says so.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        design = get_design(data["design"])
    except (OSError, ValueError, LookupError, TypeError, PalpateError):
        return None
    effects = data.get("effects", {})
    if data.keys() & UNSAID or not all(type(data.get(key)) is kind for key, kind in SAID.items()):
        return None
    if not isinstance(effects, dict) or CHOSEN in (data["model"], *map(_when, effects.values())):
        return None
    return {
        "scene": data["name"],
        "purpose": data["purpose"],
        "design": design.name,
        "model": data["model"],
        "parameter_set": None,
        "seed": data["seed"],
        "nodes": fewest_nodes(design),
        "effects": list(effects),
    }


def _when(effect: Any) -> Any:
    return effect.get("when") if isinstance(effect, dict) else effect
