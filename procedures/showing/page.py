"""Pages of HTML that hold all they need, run no script, and print on A4."""

from __future__ import annotations

import base64
import html
import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.console.terminal import clean
from palpate.procedures.showing.figure import MANY, drawn_anew, is_png
from palpate.procedures.showing.text import LABEL, STAMP, blocks, shortened

if TYPE_CHECKING:
    from rich.table import Table

PAPER = 116  # characters in a line of a table on A4
INDENT = 24  # most characters of a label and the spaces behind it
FOLDED = 30  # characters above which a cell may have several lines
SHORT = 20  # lines of a table that stays on one page
MOST = 200  # lines of a table of a run; of a longer one the first and the last are shown
LEFT_OUT = (
    "{:,} lines are left out here: palpate runs export RUN writes all points into a table, palpate runs show RUN --json"
    " prints all points and events"
)
AS_PIXELS = "What has more than {:,} points is drawn as an image in this figure; no point is left out."
STYLE = """
@page { size: A4; margin: 14mm }
body { font: 11pt/1.4 sans-serif; max-width: 182mm; margin: 2em auto; padding: 0 1em; color: #111 }
h1 { font-size: 1.5em } h2 { font-size: 1.2em; border-bottom: 1px solid #999; break-after: avoid }
h3 { font-size: 1em; break-after: avoid }
table { border-collapse: collapse; margin: 0.8em 0; font-size: 7.6pt; font-variant-numeric: tabular-nums }
caption { text-align: left; font-weight: bold; padding: 2px 0; break-after: avoid }
thead { display: table-header-group } tr { break-inside: avoid } .short { break-inside: avoid }
th, td { padding: 1px 5px; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd;
  overflow-wrap: anywhere }
thead th { border-bottom: 1px solid #333; vertical-align: bottom; white-space: nowrap }
.n { text-align: right } .s { white-space: nowrap }
figure { margin: 1em 0; break-inside: avoid } figure svg, figure img { width: 100%; height: auto }
p, figcaption { margin: 0.4em 0; font-size: 9pt; overflow-wrap: anywhere }
.warn { border-left: 4px solid #c00; padding-left: 0.6em }
.stamp { color: #c00; font-weight: bold }
.across { position: fixed; top: 40%; left: 0; width: 100%; text-align: center; font-size: 72pt; font-weight: bold;
  color: #c00; opacity: 0.09; transform: rotate(-30deg); pointer-events: none; z-index: 9 }
@media print { body { margin: 0; padding: 0; max-width: none; font-size: 10pt } }
""".strip()
NOTHING_ELSE = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"  # what a browser may load


def page(title: str, simulated: bool, parts: Iterable[str]) -> str:
    """A page with a title and these parts, which are HTML; with SIMULATED across it if it is."""
    across = f'<div class="across" aria-hidden="true">{STAMP}</div>\n' if simulated else ""
    stamp = f'<span class="stamp">{STAMP}</span> ' if simulated else ""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{NOTHING_ELSE}">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{escaped(f'{STAMP}: {title}' if simulated else title)}</title>\n<style>\n{STYLE}\n</style>\n</head>\n"
        f"<body>\n{across}<h1>{stamp}{escaped(title)}</h1>\n{''.join(parts)}</body>\n</html>\n"
    )


def escaped(text: object) -> str:
    """A text for HTML, with a visible symbol for each character that no page may hold."""
    return html.escape(clean(str(text).encode(errors="replace").decode()))


def section(heading: str, parts: Iterable[str], level: int = 2) -> str:
    """Parts below a heading; nothing if there are none."""
    inner = "".join(parts)
    return f"<section>\n<h{level}>{escaped(heading)}</h{level}>\n{inner}</section>\n" if inner else ""


def warning(text: str) -> str:
    """A paragraph that stands out."""
    return f'<p class="warn">{escaped(text)}</p>\n'


def of_things(things: Iterable[object]) -> str:
    """Tables and lines, as `print_all` takes them. Lines `label   text` that follow each other are one table.

    A table of more than `MOST` lines is cut in the middle, and says so.
    """
    parts = []
    for labelled, group in itertools.groupby(things, lambda thing: _label(thing) > 0):
        if labelled:
            parts.append(pairs((line[: _label(line)], line[_label(line) :]) for line in map(str, group)))
            continue
        for thing in group:
            if getattr(thing, "columns", ()):
                table, left_out = shortened(thing, MOST)  # type: ignore[arg-type]
                parts += [_table(part, left_out) for part in blocks(table, PAPER)]
            elif str(text := getattr(thing, "title", "") if hasattr(thing, "columns") else thing).strip():
                parts.append(f"<p>{escaped(text)}</p>\n")
    return "".join(parts)


def _label(thing: object) -> int:
    """Where the text begins after the label of a line; 0: there is none."""
    found = LABEL.match(thing) if isinstance(thing, str) else None
    return found.end() if found and found.end() <= INDENT else 0


def pairs(rows: Iterable[tuple[object, object]]) -> str:
    """A table of names and values; nothing if there are none."""
    lines = [f'<tr><th scope="row" class="s">{escaped(a).strip()}</th><td>{escaped(b)}</td></tr>\n' for a, b in rows]
    return f"<table>\n<tbody>\n{''.join(lines)}</tbody>\n</table>\n" if lines else ""


def rows(heads: Sequence[str], lines: Iterable[Sequence[object]], caption: str = "", left_out: int = 0) -> str:
    """A table of texts, with so many lines left out in its middle; nothing if it has no line."""
    body = [f"<tr>{''.join(_cell(str(cell)) for cell in line)}</tr>\n" for line in lines]
    return _with_head(caption, [(head, "") for head in heads], body, left_out) if body else ""


def _table(table: Table, left_out: int) -> str:
    """A table of rich."""
    sides = ["n" if column.justify == "right" else "" for column in table.columns]
    body = []
    for line in zip(*(column.cells for column in table.columns), strict=True):
        body.append(f"<tr>{''.join(_cell(str(cell), side) for cell, side in zip(line, sides, strict=True))}</tr>\n")
    title = "" if table.title is None else str(table.title)
    heads = [(str(column.header), side) for column, side in zip(table.columns, sides, strict=True)]
    below = f"<p>{escaped(table.caption)}</p>\n" if table.caption else ""
    return _with_head(title, heads, body, left_out) + below


def _with_head(caption: str, heads: Sequence[tuple[str, str]], body: list[str], left_out: int) -> str:
    if left_out:
        note = escaped(LEFT_OUT.format(left_out))
        body.insert(len(body) // 2, f'<tr><td colspan="{len(heads)}"><em>{note}</em></td></tr>\n')
    cells = "".join(f"<th{_class(side)}>{'<br>'.join(map(escaped, head.split(chr(10))))}</th>" for head, side in heads)
    title = f"<caption>{escaped(caption)}</caption>\n" if caption else ""
    short = _class("short" if len(body) <= SHORT else "")
    return f"<table{short}>\n{title}<thead>\n<tr>{cells}</tr>\n</thead>\n<tbody>\n{''.join(body)}</tbody>\n</table>\n"


def _cell(text: str, side: str = "") -> str:
    return f"<td{_class(side, 's' if len(text) <= FOLDED else '')}>{escaped(text)}</td>"


def _class(*names: str) -> str:
    classes = " ".join(filter(None, names))
    return f' class="{classes}"' if classes else ""


# --- figures -------------------------------------------------------------------------------------------

_GONE = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_IDS = re.compile(r'(\bid="|url\(#|href="#)')


def figure(draw: Callable[[Path], Path], run: Path, name: str) -> str:
    """What `draw` draws into a folder of a run, as SVG unless it saves a picture in another way.

    `name` is unlike those of other figures on the page. The figure's title and description are its alternative text.
    """
    content = drawn_anew(draw, run, ".svg")
    if is_png(content):
        data = base64.b64encode(content).decode()
        return f'<figure><img src="data:image/png;base64,{data}" alt="Plot of {escaped(name)}"></figure>\n'
    own = re.sub(r"\W", "-", name)
    drawn = _IDS.sub(rf"\g<1>{own}-", _GONE.sub("", content.decode())).strip()
    drawn = drawn.replace("<svg ", '<svg role="img" ', 1)
    note = f"<figcaption>{AS_PIXELS.format(MANY)}</figcaption>" if "<image " in drawn else ""
    return f"<figure>{drawn}{note}</figure>\n"
