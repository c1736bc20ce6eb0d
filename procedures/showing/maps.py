"""Shows kinds of devices, and how far a map file is proved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate.instrument.bench.kinds import all_kinds, serves
from palpate.instrument.contracts.field import Field, Table
from palpate.instrument.contracts.maps.eds import FOLDERS, disagreements, fixed_otherwise, folders, own_copy, read_sheet
from palpate.instrument.contracts.maps.golden_frames import Proof, prove
from palpate.instrument.contracts.maps.map_file import DeviceMap, read_map
from palpate.instrument.quantity import counted
from palpate.procedures.showing.text import new_table, print_all

# What manuals add to the number of a register, which they count from 1, to tell its table ("40001").
NUMBERS: dict[Table, int] = {"holding": 40_000, "input": 30_000, "discrete": 10_000}
NUMBERED = 10_000  # registers that have such a number of five digits


@dataclass(frozen=True)
class Checked:
    """A map that was checked.

    Attributes:
        map: the map.
        proof: what its frames prove.
        sheet: what was found out about the maker's data sheet; empty: the map was not made from one.
        problems: what does not fit, each with the file.
        warnings: what is probably not meant.
    """

    map: DeviceMap
    proof: Proof
    sheet: str
    problems: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def by(self) -> dict[str, list[str]]:
        """Names of the fields with a printed frame, with computed frames alone, and with none."""
        names: dict[str, list[str]] = {"printed": [], "computed": [], "without": list(self.proof.without)}
        for f in self.map.contract.fields:
            if f.name in self.proof.proved:
                names[self.proof.proved[f.name]].append(f.name)
        return names

    def summary(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        contract = self.map.contract
        return {
            "file": str(self.map.file), "kind": self.map.name, "sha256": self.map.sha256, "contract": contract.digest(),
            "roles": list(self.map.roles), "frames": len(self.map.frames), **self.by, "eds": self.sheet or None,
            "problems": list(self.problems), "warnings": list(self.warnings),
        }  # fmt: skip


def checked(file: Path) -> Checked:
    """Check a map file. Raises ConfigError: it cannot be read, or says something impossible."""
    found = read_map(file)
    serves(found)
    proof = prove(found.contract, found.frames)
    sheet, wrong = _sheet(found)
    problems = tuple(f"{file}: {problem}" for problem in (*proof.problems, *wrong))
    return Checked(found, proof, sheet, problems, tuple(_numbered(found.contract.fields)))


def _numbered(fields: Sequence[Field]) -> Iterator[str]:
    """Warnings of fields whose addresses look like the numbers that manuals give to registers."""
    for table, first in NUMBERS.items():
        like = [f for f in fields if f.table == table and 0 < f.address - first < NUMBERED]
        if like:
            listed = ", ".join(f"{f.name} = {f.address}" for f in like)
            name, given = like[0].name, like[0].address
            yield (
                f"addresses count from 0: {listed}. In the numbers of manuals, {name} is {10 * first + given + 1} here"
                f"; if its manual says {given}, write address = {given - first - 1}"
            )


def _sheet(found: DeviceMap) -> tuple[str, list[str]]:
    """What the maker's own data sheet says of a map, and what does not fit."""
    if found.eds is None:
        return "", []
    name = found.eds.name
    path = own_copy(name)
    if path is None:
        where = f"not in {', '.join(map(str, folders()))}" if folders() else f"{FOLDERS} names no folder"
        return f"{name}: not compared, {where}", []
    sheet = read_sheet(path)
    if sheet.sha256 != found.eds.sha256:
        return f"{path}: another file", [
            f"eds: {path} has the SHA-256 {sheet.sha256}, the map was made from {found.eds.sha256}; import it anew"
        ]
    sheet = replace(sheet, node=found.line.node or sheet.node)
    return f"{path}: compared", [*disagreements(sheet, found.contract.fields), *fixed_otherwise(sheet, found.contract)]


def print_checked(found: Checked) -> None:
    """Print how each field of a map is proved."""
    contract = found.map.contract
    print_all(
        f"{found.map.name}: {contract.title}, {counted(len(contract.fields), 'field')}, "
        f"{counted(len(found.map.frames), 'frame')}"
    )
    for what, names in (
        ("proved by a frame of the manual", found.by["printed"]),
        ("by a frame that was worked out", found.by["computed"]),
        ("without a frame that fits", found.by["without"]),
    ):
        print_all(f"{what}: {len(names)}" + (f" ({', '.join(names)})" if names else ""))
    if found.sheet:
        print_all(found.sheet)
    for warning in found.warnings:
        print_all(f"warning: {warning}")


def kind_rows() -> list[dict[str, Any]]:
    """The kinds of devices: palpate's own, its maps, and those of packages. Raises ConfigError as `all_kinds` does."""
    return [
        {
            "kind": kind.name,
            "title": kind.contract.title,
            "links": list(kind.links),
            "roles": list(kind.roles),
            "map": kind.map is not None,
            "simulated": kind.simulator is not None,
        }
        for kind in all_kinds()
    ]


def print_kinds(rows: Sequence[dict[str, Any]]) -> None:
    """Print the kinds of devices."""
    table = new_table(None, "kind", "device", "links", "roles", "map", "simulated")
    for column in table.columns:
        column.justify = "left"
    for row in rows:
        flags = ("yes" if row[key] else "" for key in ("map", "simulated"))
        table.add_row(row["kind"], row["title"], ", ".join(row["links"]), ", ".join(row["roles"]), *flags)
    print_all(table)
