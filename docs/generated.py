"""The parts of the documentation that come from the code: they go where a page says `<!-- generated: NAME -->`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, get_args, get_type_hints

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

from palpate.instrument import errors as palpate_errors
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import all_kinds
from palpate.instrument.bench.links import LINKS
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.export import registers
from palpate.instrument.quantity import Unit, show
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import contents
from palpate.procedures.engine.catalogue import SHIPPED, procedure_class
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.study.description import StudyFile
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import Fault, places, struck
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.scenes.scene import SceneFile

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
        rows.append((f"`{name}`", does, _listed(struck(fault.targets, places(1))), _listed(own)))
    return _table(("kind", "what it does", "on", "own parameters"), rows)


def designs() -> str:
    """The sensor designs."""
    rows = []
    for name, design in DESIGNS.items():
        films = f"{len(design.films)}: `{design.films[0].name}` to `{design.films[-1].name}`"
        rows.append((f"`{name}`", str(len(design.teeth)), films, f"{design.ratio_scatter:.1%}", design.source))
    return _table(("design", "teeth", "films", "scatter of the force ratio", "source"), rows)


def samples() -> str:
    """The rubber samples."""
    rows = [(f"`{s.name}`", s.material, show(s.modulus, "Pa"), s.source) for s in SAMPLES.values()]
    return _table(("sample", "material", "Young modulus", "source"), rows)


def file_of(model: type[BaseModel]) -> str:
    """A table of keys for the top of a configuration file, then one for each of its sections."""
    sections = {name: found for name, field in model.model_fields.items() if (found := _section(field.annotation))}
    own = {name: field for name, field in model.model_fields.items() if name not in sections}
    parts = [_keys(own)]
    for name, section in sections.items():
        optional = "" if model.model_fields[name].is_required() else " (may be left out)"
        about = " ".join(inspect.cleandoc(section.__doc__ or "").split())
        parts += [f"`[{name}]`{optional}: {about}", _keys(section.model_fields)]
    return "\n\n".join(parts)


def _keys(fields: Mapping[str, FieldInfo], what: str = "key") -> str:
    """A table of keys."""
    rows = [(f"`{name}`", _default(field), _limits(field)) for name, field in fields.items()]
    return _table((what, "default", "limits"), rows)


def kinds() -> str:
    """The kinds of devices that a bench file may list."""
    rows = [
        (f"`{kind.name}`", kind.contract.title, *map(_listed, (kind.links, kind.roles, kind.settings.model_fields)))
        for kind in all_kinds()
    ]
    return _table(("kind", "device", "links", "roles", "settings"), rows)


def links() -> str:
    """The kinds of links with their keys."""
    keys = {
        name: ", ".join(f"`{key}` ({_default(field)})" for key, field in model.model_fields.items())
        for name, model in LINKS.items()
    }
    return _table(("kind of link", "keys with their defaults"), [(f"`{name}`", told) for name, told in keys.items()])


def thesis_contents() -> str:
    """The tables and figures of the thesis beside which Palpate has no numbers."""
    without = [content for content in contents().values() if content.ours in ("none", "part")]
    rows = [(c.number, c.shows, f"{'nothing: ' * (c.ours == 'none')}{c.part}", c.doubt) for c in without]
    return _table(("number", "shows", "in Palpate", "in print"), rows)


def points() -> str:
    """What a point of each procedure has."""
    parts = []
    for name in SHIPPED:
        rows = [(f"`{field}`", column.unit, column.doc) for field, column in _columns(procedure_class(name).point)]
        parts += [f"### `{name}`", _table(("name", "unit", "what it is"), rows)]
    return "\n\n".join(parts)


def _columns(kind: type[Any]) -> Iterator[tuple[str, Column]]:
    """The columns of a class, and of each class of rows that it holds."""
    types = get_type_hints(kind)
    for name, column in columns_of(kind).items():
        yield name, column
        if column.each:
            yield from ((f"{name}.{inner}", each) for inner, each in columns_of(get_args(types[name])[0]).items())


def errors() -> str:
    """The tree of errors, as their module draws it."""
    tree = inspect.cleandoc(palpate_errors.__doc__ or "").split("\n\n")[1]
    return f"```\n{inspect.cleandoc(tree)}\n```"


GENERATED: Mapping[str, Callable[[], str]] = {
    "registers": register_maps,
    "scenes": scenes,
    "effects": effects,
    "faults": faults,
    "designs": designs,
    "samples": samples,
    "bench_file": partial(file_of, BenchDescription),
    "scene_file": partial(file_of, SceneFile),
    "study_file": partial(file_of, StudyFile),
    "kinds": kinds,
    "links": links,
    "thesis_contents": thesis_contents,
    "points": points,
    "errors": errors,
}


def fill(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Put the generated parts into the text of a page."""
    source[0] = PLACE.sub(lambda place: GENERATED[place[1]](), source[0])


def as_they_are(_app: Sphinx, _context: click.Context, lines: list[str]) -> None:
    """Show the examples below a command's help as code."""
    if lines and lines[0] == "Examples:":
        lines[:] = ["Examples::", "", *(f"   {line}" for line in lines[1:] if line.strip()), ""]


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", fill)
    app.connect("sphinx-click-process-epilog", as_they_are)
    return {"parallel_read_safe": True}


def _parameters(fields: Mapping[str, FieldInfo]) -> str:
    return _keys(fields, "parameter") if fields else "No parameters."


def _limits(field: FieldInfo) -> str:
    """What a number may be, as a file would say it."""
    units = [mark.unit for mark in field.metadata if isinstance(mark, Unit)]
    said = []
    for end, word in (("gt", "above"), ("ge", "from"), ("lt", "below"), ("le", "to")):
        for mark in field.metadata:
            if (limit := getattr(mark, end, None)) is not None:
                said.append(f"{word} {show(limit, units[0]) if units else f'{limit:g}'}")
    return " ".join(said)


def _default(field: FieldInfo) -> str:
    """The default as a file would say it."""
    if field.is_required():
        return "must be given"
    default = field.get_default(call_default_factory=True)
    if default is None or default == {}:
        return "left out"
    units = [mark.unit for mark in field.metadata if isinstance(mark, Unit)]
    return f"`{default:g} {units[0]}`" if units else f"`{default}`"


def _section(annotation: object) -> type[BaseModel] | None:
    """The model of a key that is a section of a file."""
    for kind in (annotation, *get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines)
