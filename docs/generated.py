"""The parts of the documentation that come from the code: they go where a page says `<!-- generated: NAME -->`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.export import registers
from palpate.instrument.quantity import Unit
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import Fault
from palpate.simulators.scenes.scene import read_scene, shipped

PLACE = re.compile(r"^<!-- generated: (\w+) -->$", flags=re.MULTILINE)


def register_maps() -> str:
    """Every contract's register table, below the page's own title."""
    _, _, maps = registers(CONTRACTS.values()).partition("\n\n")
    return maps


def scenes() -> str:
    """What each scene that comes with Palpate is for, and what it calls for."""
    rows = []
    for name in shipped():
        scene = read_scene(name)
        rows.append((f"`{name}`", scene.purpose, f"`{scene.design.name}`", f"`{scene.model}`", _listed(scene.effects)))
    return _table(("scene", "what it is for", "design", "model", "effects"), rows)


def effects() -> str:
    """What each effect does, and its parameters."""
    parts = []
    for name in EFFECTS:
        effect = effect_class(name)
        parts += [f"### `{name}`", inspect.cleandoc(effect.__doc__ or ""), f"Kind: `{effect.kind}`."]
        parts.append(_parameters(effect.model_fields))
    return "\n\n".join(filter(None, parts))


def faults() -> str:
    """What each fault does, where it can strike, and its own parameters."""
    rows = []
    for name in FAULTS:
        fault = fault_class(name)
        own = {key: field for key, field in fault.model_fields.items() if key not in Fault.model_fields}
        does = " ".join(inspect.cleandoc(fault.__doc__ or "").split())
        rows.append((f"`{name}`", does, _listed(fault.targets), _listed(own)))
    return _table(("kind", "what it does", "on", "own parameters"), rows)


GENERATED: Mapping[str, Callable[[], str]] = {
    "registers": register_maps,
    "scenes": scenes,
    "effects": effects,
    "faults": faults,
}


def fill(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Put the generated parts into the text of a page."""
    source[0] = PLACE.sub(lambda place: GENERATED[place[1]](), source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}


def _parameters(fields: Mapping[str, FieldInfo]) -> str:
    rows = [(f"`{name}`", _default(field)) for name, field in fields.items()]
    return _table(("parameter", "default"), rows) if rows else "No parameters."


def _default(field: FieldInfo) -> str:
    """The default as a scene file would say it; None stands for what follows from the rest."""
    units = [mark.unit for mark in field.metadata if isinstance(mark, Unit)]
    if field.default is None:
        return "by the rest"
    return f"`{field.default:g} {units[0]}`" if units else f"`{field.default}`"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines)
