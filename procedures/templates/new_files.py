"""Writes the first files of a user's own effect or procedure, from templates; they pass their tests as they are.

new_effect("cable_sag", Path())         # simulators/effects/cable_sag.py and its test
new_procedure("repeatability", Path())  # procedures/repeatability.py and its test
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from string import Template

from palpate.instrument.errors import RecordError, UsageError

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST = 20  # greatest number of characters of a name
EFFECT = {"effect.py.txt": "simulators/effects/{}.py", "effect_test.py.txt": "tests/simulators/test_{}.py"}
PROCEDURE = {"procedure.py.txt": "procedures/{}.py", "procedure_test.py.txt": "tests/procedures/test_{}.py"}


def new_effect(name: str, tree: Path) -> list[Path]:
    """Write effect and test into a source tree of palpate. Raises as `write_files`."""
    return write_files("effect", name, EFFECT, tree, {})


def new_procedure(name: str, tree: Path) -> list[Path]:
    """Write procedure and test into a source tree of palpate. Raises as `write_files`."""
    terms = {"command": name.replace("_", "-"), "module": f"palpate.procedures.{name}"}
    return write_files("procedure", name, PROCEDURE, tree, terms)


def check_name(kind: str, name: str) -> None:
    """Raises UsageError: it cannot be the name of a module."""
    if not NAME.fullmatch(name) or len(name) > LONGEST or keyword.iskeyword(name):
        raise UsageError(
            f"{name!r} is no name of a {kind}: give small letters, digits and single underscores, at most {LONGEST}"
            " characters, such as force_gauge"
        )


def write_files(
    kind: str, name: str, places: Mapping[str, str], tree: Path, terms: Mapping[str, str], beside: str = ""
) -> list[Path]:
    """Write the files of a `kind` of thing.

    Args:
        kind: what they are for, in messages.
        name: name of its modules, such as `force_gauge`.
        places: path of each template's file in the tree, with {} for the name.
        tree: root of the tree.
        terms: values of the templates' placeholders, in addition to those of the name.
        beside: text with names that the class may not have, in addition to the templates.

    Returns:
        The files, in the order of the templates.

    Raises:
        UsageError: the name is not allowed, the tree does not exist, or one of the files exists; nothing is written.
        RecordError: a file cannot be written.
    """
    check_name(kind, name)
    paths = {template: tree / place.format(name) for template, place in places.items()}
    for path in paths.values():
        if not path.parent.is_dir():
            raise UsageError(f"{tree} is no source tree of palpate, it has no {path.parent}; give one with --to")
        if path.exists():
            raise UsageError(f"{path} exists already; choose another name")
    folder = resources.files("palpate.procedures.templates")
    texts = {template: (folder / template).read_text(encoding="utf-8") for template in places}
    title, class_name = " ".join(name.split("_")), class_of(name)
    if any(re.search(rf"\b{class_name}\b", text) for text in (*texts.values(), beside)):
        raise UsageError(f"{name!r}: a class {class_name} is used in its files already; choose another name")
    own = {"name": name, "Class": class_name, "title": title, "Title": title.capitalize()}
    for template, path in paths.items():
        try:
            path.write_text(Template(texts[template]).substitute(terms, **own), encoding="utf-8")
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror}; make it writable") from None
    return list(paths.values())


def write_package(
    kind: str, name: str, places: Mapping[str, str], folder: Path, terms: Mapping[str, str]
) -> list[Path]:
    """Write files as `write_files` does, into a new folder of that name. Raises UsageError: it exists; RecordError."""
    check_name(kind, name)
    tree = folder / name
    if tree.exists():
        raise UsageError(f"{tree} exists already; choose another name")
    try:
        for path in {tree / place for place in places.values()}:
            path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(f"{tree}: cannot be made: {error.strerror}; give another folder with --to") from None
    return write_files(kind, name, places, tree, terms)


def class_of(name: str) -> str:
    """The class name for a module's name."""
    return "".join(word.capitalize() for word in name.split("_"))
