"""Rows on the pages of an SQLite database and its log, found without its schema and its trees.

Format: https://www.sqlite.org/fileformat2.html. Rows are found on leaf pages of tables; where the header of such a page
is damaged, rows are looked for at any offset. Only a row's checksum tells whether the row is as it was written.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

PAGE = 4096  # bytes, where the header does not tell
LEAF = 13  # type of a page
_WAL_HEADER, _WAL_FRAME = 32, 24  # bytes
_INTEGERS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}  # bytes of serial types

Row = tuple[int, list[Any]]  # number of the row, and the values of its columns; texts are bytes


@dataclass(slots=True)
class Pages:
    """All images of all pages, the most reliable last: from a log that was begun anew, the database, its log."""

    size: int
    images: list[bytes]
    latest: dict[int, bytes]
    _followed: set[int] = field(default_factory=set)

    def rows(self) -> Iterator[tuple[bool, int, list[Any]]]:
        """Rows from leaf pages (True), then from pages that may have been some; one for each image of a row."""
        doubtful = []
        for image in self.images:
            start = 100 if image.startswith(b"SQLite format 3\0") else 0
            found, whole = self._leaf(image, start)
            yield from ((True, *row) for row in found)
            if not whole:
                doubtful.append(image)
        for image in doubtful:
            if id(image) not in self._followed:
                for at in range(len(image) - 4):
                    if (row := self._cell(image, at)) is not None:
                        yield (False, *row)

    def _leaf(self, image: bytes, start: int) -> tuple[list[Row], bool]:
        if image[start] != LEAF:
            return [], False
        (count,) = struct.unpack_from(">H", image, start + 3)
        if start + 8 + 2 * count > len(image):
            return [], False
        cells = [self._cell(image, at) for at in struct.unpack_from(f">{count}H", image, start + 8)]
        return [cell for cell in cells if cell is not None], None not in cells

    def _cell(self, image: bytes, at: int) -> Row | None:
        try:
            length, at = _varint(image, at)
            number, at = _varint(image, at)
            if not (4 <= length <= self.size * len(self.images) and 0 < number < 1 << 48 and 3 <= image[at] <= 60):
                return None
            return number, _values(self._payload(image, at, length))
        except (IndexError, ValueError, struct.error, KeyError):
            return None

    def _payload(self, image: bytes, at: int, length: int) -> bytes:
        most, least = self.size - 35, (self.size - 12) * 32 // 255 - 23
        if length <= most:
            return image[at : at + length]
        here = least + (length - least) % (self.size - 4)
        here = least if here > most else here
        parts, left = [image[at : at + here]], length - here
        (number,) = struct.unpack_from(">I", image, at + here)
        followed = set()
        while left > 0:
            page = self.latest[number]
            if number in followed:
                raise ValueError("pages that go in a circle")
            followed.add(number)
            parts.append(page[4 : 4 + left])
            left -= len(page) - 4
            (number,) = struct.unpack_from(">I", page)
        self._followed.update(id(self.latest[number]) for number in followed)
        return b"".join(parts)


def read_pages(database: bytes, log: bytes) -> Pages:
    """The pages of a database and of its log ("-wal")."""
    size = int.from_bytes(database[16:18], "big")
    size = size if size >= 512 and size & (size - 1) == 0 else PAGE
    images = [database[at : at + size].ljust(size, b"\0") for at in range(0, len(database), size)]
    latest = dict(enumerate(images, 1))
    old, new = [], []
    salt = log[16:24]
    for at in range(_WAL_HEADER, len(log) - _WAL_FRAME - size + 1, _WAL_FRAME + size):
        number, image = int.from_bytes(log[at : at + 4], "big"), log[at + _WAL_FRAME : at + _WAL_FRAME + size]
        if number and log[at + 8 : at + 16] == salt:
            new.append(image)
            latest[number] = image
        elif number:
            old.append(image)
            latest.setdefault(number, image)
    return Pages(size, [*old, *images, *new], latest)


def _varint(content: bytes, at: int) -> tuple[int, int]:
    value = 0
    for index in range(9):
        byte = content[at + index]
        if index == 8:
            return value << 8 | byte, at + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + index + 1
    raise ValueError("unreachable")


def _values(payload: bytes) -> list[Any]:
    """Values of the columns of a record. Raises ValueError, IndexError, struct.error: it is no record."""
    header, at = _varint(payload, 0)
    types = []
    while at < header:
        kind, at = _varint(payload, at)
        types.append(kind)
    values: list[Any] = []
    for kind in types:
        size = _INTEGERS.get(kind, 8 if kind == 7 else (kind - 12) // 2 if kind >= 12 else 0)
        part = payload[at : at + size]
        if len(part) != size or kind in (10, 11):
            raise ValueError("no record")
        at += size
        if kind in _INTEGERS:
            values.append(int.from_bytes(part, "big", signed=True))
        elif kind == 7:
            values.append(struct.unpack(">d", part)[0])
        else:
            values.append({0: None, 8: 0, 9: 1}[kind] if kind < 12 else part)
    if at != len(payload):
        raise ValueError("no record")
    return values
