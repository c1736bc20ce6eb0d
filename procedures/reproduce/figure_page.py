"""Figures on the page: those of chapters 4 and 5 and the bridge, and a list of all numbered tables and figures."""

from __future__ import annotations

import base64
from collections.abc import Container, Sequence
from html import escape

from palpate.instrument.thesis import Content, contents
from palpate.procedures.records.run import storing
from palpate.procedures.reproduce.figures.picture import SavedPicture

ALL = "All tables and figures of the thesis"
WITH_SECTION = ("Figure 4.", "Figure 5.", "Figure A3.5")
HEADER = ("number", "section", "shows", "here", "what it is of palpate", "doubt")
KINDS = {"compared": "compared", "drawn": "drawn", "part": "a part of palpate", "none": "nothing"}


def figure_sections(pictures: Sequence[SavedPicture]) -> list[str]:
    """A section for each of these figures: what it shows, what palpate has for it, and a picture of data."""
    return [_section(each, pictures) for each in contents().values() if each.number.startswith(WITH_SECTION)]


def pictures_of(number: str, pictures: Sequence[SavedPicture]) -> str:
    """The pictures of a figure or table with their captions."""
    return "\n".join(_figure(picture) for picture in pictures if picture.number == number)


def heading(number: str, shows: str) -> str:
    """Heading of a table or figure, to which the list links."""
    return f'<h2 id="{escape(anchor(number))}">{escape(f"{number}: {shows}")}</h2>'


def anchor(number: str) -> str:
    """Anchor of a table or figure, from its number such as "Figure 4.8"."""
    return number.lower().replace(" ", "-")


def listed(anchors: Container[str]) -> list[str]:
    """All tables and figures of the thesis, with a link to each that has an anchor on the page."""
    rows = []
    for each in contents().values():
        place = anchor(each.number)
        number = f'<a href="#{place}">{each.number}</a>' if place in anchors else each.number
        cells = (each.section, each.shows, KINDS[each.ours], each.part, each.doubt)
        rows.append(f"<tr><td>{number}</td>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    return [
        f"<table class=words><tr>{''.join(f'<th>{name}</th>' for name in HEADER)}</tr>",
        *rows,
        "</table>",
    ]


def _section(content: Content, pictures: Sequence[SavedPicture]) -> str:
    beside = (
        f"Nothing of palpate stands beside it: {content.part}" if content.ours == "none" else f"Palpate: {content.part}"
    )
    doubt = f" In doubt: {content.doubt}." if content.doubt else ""
    return "\n".join(
        [
            heading(content.number, content.shows),
            f"<p>{escape(f'Section {content.section}. {beside}.{doubt}')}</p>",
            pictures_of(content.number, pictures),
        ]
    )


def _figure(picture: SavedPicture) -> str:
    with storing(picture.file):
        data = base64.b64encode(picture.file.read_bytes()).decode()
    words = escape(f"{picture.number}: {picture.shows}")
    return (
        f'<figure><img alt="{words}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )
