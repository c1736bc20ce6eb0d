"""How large the house is, and what it may never have: `python -m tests.house`.

It prints sizes, which are not limits: a file holds one idea whole. It fails where modules import each other in a circle
(imports inside functions and those for type checking count), where a contract of import-linter has an exemption, and
where a signature of a command says `Any`. The circles need grimp, which comes with import-linter.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
FOLDERS = ("instrument", "drivers", "simulators", "procedures", "palpate")
COMMANDS = ROOT / "procedures" / "commands"
MEASUREMENTS = ROOT / "procedures" / "measurements"
SHARED = {"__init__", "__pycache__", "columns", "prospects", "settings", "work"}  # of all procedures
CACHES = {"cache", "lru_cache"}
PRIVATE = re.compile(r"_[a-z]\w*|.*\._[a-z]\w*")


def linter() -> dict[str, Any]:
    """The settings of import-linter."""
    settings: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found: dict[str, Any] = settings["tool"]["importlinter"]
    return found


# --- what may never be ---------------------------------------------------------------------------------


def exemptions() -> list[str]:
    """Imports that a contract would refuse and that are let pass."""
    return [each for contract in linter()["contracts"] for each in contract.get("ignore_imports", ())]


def any_in_commands() -> list[str]:
    """Modules of the command line whose functions say `Any` in a signature."""
    return [path.name for path in sorted(COMMANDS.rglob("*.py")) if anys(_tree(path))]


def anys(tree: ast.Module) -> int:
    signatures: list[ast.AST | None] = []
    for each in ast.walk(tree):
        if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)):
            signatures += [each.args, each.returns]
    names = (name for each in signatures if each is not None for name in ast.walk(each))
    return sum(isinstance(name, ast.Name) and name.id == "Any" for name in names)


def circles() -> list[str]:
    """Modules, or neighbours in a package, that import each other in the end: each circle's members in one text."""
    import grimp

    settings = linter()
    graph = grimp.build_graph(settings["root_package"], cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    found = circles_of(imports)
    for package in sorted(module for module in graph.modules if graph.find_children(module)):
        inside: dict[str, set[str]] = {}
        for module, targets in imports.items():
            for target in targets:
                first, second = (child(name, package) for name in (module, target))
                if first and second and first != second:
                    inside.setdefault(first, set()).add(second)
        found += circles_of(inside)
    return sorted(set(found))


def child(module: str, package: str) -> str:
    """The child of a package that a module is or lies in; "" for one outside, and for the package's own file."""
    if not module.startswith(f"{package}."):
        return ""
    return f"{package}.{module.removeprefix(f'{package}.').partition('.')[0]}"


def circles_of(imports: dict[str, Any]) -> list[str]:
    """The groups within which each member imports every other one, through others or by itself."""
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    names = sorted({*imports, *(target for targets in imports.values() for target in targets)})
    number = {name: index for index, name in enumerate(names)}
    edges = [(number[source], number[target]) for source, targets in imports.items() for target in targets]
    if not edges:
        return []
    rows, columns = np.array(edges).T
    matrix = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(names), len(names)))
    _, group = connected_components(matrix, connection="strong")
    members = (np.flatnonzero(group == each) for each in np.unique(group))
    return sorted(", ".join(names[index] for index in each) for each in members if len(each) > 1)


# --- how large it is -----------------------------------------------------------------------------------


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _size(paths: Iterable[Path]) -> tuple[int, int, int]:
    """Statements (a docstring is one), lines, files."""
    statements = lines = files = 0
    for path in paths:
        tree = _tree(path)
        statements += sum(isinstance(each, ast.stmt) for each in ast.walk(tree))
        lines += len(path.read_text(encoding="utf-8").splitlines())
        files += 1
    return statements, lines, files


def _product() -> list[Path]:
    return [path for name in FOLDERS for path in sorted((ROOT / name).rglob("*.py"))]


def reaches(tree: ast.Module) -> set[str]:
    """Names with an underscore that a file takes from elsewhere: not those that it gives to things of its own."""
    names = {each.attr for each in ast.walk(tree) if isinstance(each, ast.Attribute)}
    names |= {each.name for found in ast.walk(tree) if isinstance(found, ast.ImportFrom) for each in found.names}
    for call in (each for each in ast.walk(tree) if isinstance(each, ast.Call)):  # texts for which a test stands in
        if getattr(call.func, "attr", getattr(call.func, "id", "")) in ("setattr", "getattr"):
            names |= {
                each.value for each in call.args if isinstance(each, ast.Constant) and isinstance(each.value, str)
            }
    own = {getattr(each, "name", "") for each in ast.walk(tree) if isinstance(each, (ast.FunctionDef, ast.ClassDef))}
    stored = (each for each in ast.walk(tree) if isinstance(getattr(each, "ctx", None), ast.Store))
    own |= {getattr(each, "attr", getattr(each, "id", "")) for each in stored if not _of_another(each)}
    return {name for name in names - own if PRIVATE.fullmatch(name) and name != "_exit"}  # os._exit has no other name


def _of_another(target: ast.AST) -> bool:
    """Whether an attribute is given to something else than `self`."""
    holder = getattr(target, "value", None)
    return holder is not None and getattr(holder, "id", "") != "self"


def names_for_several() -> dict[str, int]:
    """Names of classes that stand for several, and how often."""
    names = (each.name for path in _product() for each in _tree(path).body if isinstance(each, ast.ClassDef))
    return {name: count for name, count in sorted(Counter(names).items()) if count > 1}


def _caches(paths: Iterable[Path]) -> int:
    """Functions of modules that remember their results."""
    found = 0
    for path in paths:
        for each in _tree(path).body:
            if isinstance(each, ast.FunctionDef):
                marks = [mark.func if isinstance(mark, ast.Call) else mark for mark in each.decorator_list]
                found += any(getattr(mark, "attr", getattr(mark, "id", "")) in CACHES for mark in marks)
    return found


def sizes() -> Iterator[tuple[str, str]]:
    """What is told and never asserted."""
    tests = sorted((ROOT / "tests").rglob("*.py"))
    for name, paths in (("product", _product()), ("tests", tests)):
        statements, lines, files = _size(paths)
        yield name, f"{statements} statements, {lines} lines in {files} files"
    own = (each for each in MEASUREMENTS.iterdir() if each.stem not in SHARED)
    procedures = [each for each in own if each.is_file() or any(each.glob("*.py"))]
    lines = sum(_size(each.rglob("*.py") if each.is_dir() else [each])[1] for each in procedures)
    yield "a procedure", f"{lines / len(procedures):.0f} lines, the mean of {len(procedures)}"
    yield "caches of modules in measurements", str(_caches(MEASUREMENTS.rglob("*.py")))
    several = names_for_several()
    yield "names of classes that stand for several", f"{len(several)}: {', '.join(several)}"
    texts = {path: path.read_text(encoding="utf-8") for path in tests}
    reached = sum(len(text.splitlines()) for text in texts.values() if reaches(ast.parse(text)))
    whole = sum(len(text.splitlines()) for text in texts.values())
    yield "lines of tests in files that reach names with an underscore", f"{100 * reached / whole:.0f} %"
    words = sum(len(path.read_text(encoding="utf-8").split()) for path in (ROOT / "docs").rglob("*.md"))
    yield "words of the documentation", str(words)


def main() -> int:
    """Print both; exit status 1: there is something that may never be."""
    for name, told in sizes():
        print(f"{name}: {told}")
    status = 0
    for name, found in (("circles", circles()), ("exemptions", exemptions()), ("Any in commands", any_in_commands())):
        print(f"{name}: {len(found)}", *found, sep="\n  ")
        status |= bool(found)
    return status


if __name__ == "__main__":
    sys.exit(main())
