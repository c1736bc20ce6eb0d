"""What the house may not become: `python -m tests.house` counts it and compares with `tests/house.toml`.

It counts circles of imports by the strictest rule: imports inside functions and those for type checking alone count.
There are circles of modules, and circles of neighbours in a package (modules, or packages with all that is in them). It
counts modules of folders that are too full, exemptions from the layers, and uses of `Any` in signatures of commands.

Each of them may only shrink: what is new fails, and so does what is gone and still listed. Then, or after modules were
renamed, `python -m tests.house --accept` writes what there is. The circles need grimp, which comes with import-linter.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
KNOWN = Path(__file__).with_suffix(".toml")
FOLDERS = ("instrument", "drivers", "simulators", "procedures")
COMMANDS = ROOT / "procedures" / "commands"
REGISTRIES = ("effects", "contracts", "commands")  # of one shape, one file a thing
FULL = 20  # modules in a folder


def linter() -> dict[str, Any]:
    """The settings of import-linter."""
    settings: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found: dict[str, Any] = settings["tool"]["importlinter"]
    return found


def exemptions() -> int:
    """Imports that a contract would refuse and that are let pass."""
    return sum(len(contract.get("ignore_imports", ())) for contract in linter()["contracts"])


def too_many() -> int:
    """Modules that folders hold beyond what one can take in."""
    folders = {path.parent for name in FOLDERS for path in (ROOT / name).rglob("*.py")}
    counts = [len(list(each.glob("*.py"))) - 1 for each in folders if each.name not in REGISTRIES]  # not __init__
    return sum(max(count - FULL, 0) for count in counts)


def any_in_commands() -> int:
    """How often signatures of the command line's functions say `Any`."""
    return sum(_anys(ast.parse(path.read_text(encoding="utf-8"))) for path in COMMANDS.rglob("*.py"))


def _anys(tree: ast.Module) -> int:
    signatures: list[ast.AST | None] = []
    for each in ast.walk(tree):
        if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)):
            signatures += [each.args, each.returns]
    names = (name for each in signatures if each is not None for name in ast.walk(each))
    return sum(isinstance(name, ast.Name) and name.id == "Any" for name in names)


def numbers() -> dict[str, int]:
    """What is counted without grimp."""
    return {"exemptions": exemptions(), "modules_too_many": too_many(), "any_in_commands": any_in_commands()}


def circles() -> dict[str, list[str]]:
    """Modules, or neighbours in a package, that import each other in the end: each circle's members in one text."""
    import grimp

    settings = linter()
    roots = settings.get("root_packages") or [settings["root_package"]]
    graph = grimp.build_graph(*roots, cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    neighbours: list[str] = []
    for package in sorted(module for module in graph.modules if graph.find_children(module)):
        inside: dict[str, set[str]] = {}
        for module, targets in imports.items():
            for target in targets:
                first, second = (_child(name, package) for name in (module, target))
                if first and second and first != second:
                    inside.setdefault(first, set()).add(second)
        neighbours += _circles(inside)
    return {"of_modules": _circles(imports), "of_neighbours": sorted(neighbours)}


def _child(module: str, package: str) -> str:
    """The child of a package that a module is or lies in; "" for one outside, and for the package's own file."""
    if not module.startswith(f"{package}."):
        return ""
    return f"{package}.{module.removeprefix(f'{package}.').partition('.')[0]}"


def _circles(imports: dict[str, Any]) -> list[str]:
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


def known() -> dict[str, Any]:
    """What is listed."""
    return tomllib.loads(KNOWN.read_text(encoding="utf-8"))


def complaints(listed: dict[str, Any], found: dict[str, Any]) -> Iterator[str]:
    """What is more than is listed, and what is less: then the list has to follow."""
    for name, value in found.items():
        before = listed.get(name)
        if isinstance(value, int):
            if before != value:
                yield f"{name}: {value}, {before} are listed"
        else:
            yield from (f"{name}: new: {each}" for each in _without(value, before or ()))
            yield from (f"{name}: gone, still listed: {each}" for each in _without(before or (), value))


def _without(some: Iterable[str], others: Iterable[str]) -> list[str]:
    return [each for each in some if each not in others]


def main(words: list[str]) -> int:
    """Print what there is, and what is not as it is listed."""
    import tomli_w

    found = {**numbers(), **circles()}
    for name, value in found.items():
        print(f"{name}: {value}" if isinstance(value, int) else f"{name}: {len(value)}")
        if isinstance(value, list):
            print("".join(f"  {each}\n" for each in value), end="")
    if words == ["--accept"]:
        KNOWN.write_text(tomli_w.dumps(found), encoding="utf-8")
        return 0
    wrong = list(complaints(known(), found))
    for each in wrong:
        print(f"not as tests/house.toml lists it: {each}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
