"""Packages that begin something of one's own, from templates: they pass their tests as they stand."""

from __future__ import annotations

import importlib.util
import keyword
import os
import re
import sys
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from string import Template

from palpate.instrument.errors import RecordError, UsageError, reason

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST = 20  # characters of a name
PYTHONS = frozenset({"conftest", "setup", "tests"})  # modules and folders that mean something beside a package


def check_name(kind: str, name: str, taken: Iterable[str] = ()) -> None:
    """Raises UsageError: it is no name of a module, or something else has it, or one of the `taken` names is alike."""
    if keyword.iskeyword(name):
        raise UsageError(f"{name!r} is no name of a {kind}: it is a word of Python; choose another name")
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        raise UsageError(
            f"{name!r} is no name of a {kind}: give small letters, digits and single underscores, at most {LONGEST}"
            " characters, such as force_gauge"
        )
    if name in {each.replace("-", "_") for each in taken}:
        raise UsageError(f"{name!r}: palpate or an installed package has one of that name; choose another name")


def check_module(name: str) -> None:
    """Raises UsageError: a module of that name can be imported already, and one of the two would hide the other."""
    if name in sys.stdlib_module_names or name in PYTHONS or importlib.util.find_spec(name) is not None:
        raise UsageError(f"{name!r}: there is a Python module of that name already; choose another name")


def write_files(kind: str, name: str, files: Mapping[str, str], folder: Path, terms: Mapping[str, str]) -> list[Path]:
    """Write the files of a `kind` of thing into a new folder of that name.

    Args:
        name: name of the folder and of the module, such as `force_gauge`.
        files: where a file goes in the folder, with {} for the name -> its template's text.
        terms: replacements for the placeholders in the templates; those made from the name are added.

    Returns:
        The files, in that order.

    Raises:
        UsageError: the folder exists, or the files use a class for something else that would be called as the thing's
            own; nothing is written.
        RecordError: a file cannot be written.
    """
    tree = folder / name
    if os.path.lexists(tree):
        raise UsageError(f"{tree} exists already; choose another name")
    title, class_name = " ".join(name.split("_")), class_of(name)
    if any(re.search(rf"\b{class_name}\b", Template(text).safe_substitute(terms)) for text in files.values()):
        raise UsageError(f"{name!r}: a class {class_name} is used in its files already; choose another name")
    own = {"kind": kind, "name": name, "project": project_of(name)}
    own |= {"Class": class_name, "title": title, "Title": title.capitalize()}
    for place, text in files.items():
        path = tree / place.format(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(Template(text).substitute(terms, **own).rstrip("\n") + "\n", encoding="utf-8")
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {reason(error)}; give another folder with --to") from None
    return [tree / place.format(name) for place in files]


def write_package(kind: str, name: str, folder: Path, group: str, entry: str, found: str = "${Class}") -> list[Path]:
    """Write a package whose module holds one thing, the object of its entry point, into a new folder of its name.

    Args:
        kind: what the thing is; the folder of its templates.
        name: name of the module, which `check_name` has checked.
        folder: where the package's folder goes.
        group, entry: its entry point.
        found: name of the thing in the module.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: a module or folder of that name exists; nothing is written. RecordError: a file cannot be written.
    """
    check_module(name)
    files = {
        "pyproject.toml": template("pyproject.toml.txt").replace("${object}", found),
        "{}.py": template(f"{kind}/{kind}.py.txt"),
        "tests/test_{}.py": template(f"{kind}/test.py.txt"),
    }
    return write_files(kind, name, files, folder, {"group": group, "entry": entry})


def template(name: str) -> str:
    """The text of a template."""
    return (resources.files("palpate.procedures.templates") / name).read_text(encoding="utf-8")


def class_of(name: str) -> str:
    """The class of a module's name."""
    return "".join(word.capitalize() for word in name.split("_"))


def project_of(name: str) -> str:
    """The distribution of a module's name."""
    return name.replace("_", "-")
