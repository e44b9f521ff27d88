"""The page of a report: its head, its style, tables and pictures as HTML.

Every `str` is text and is escaped, except for an `Html`.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from locplan.comparison.report._style import SCRIPT, STYLE


class Html(str):
    """Text that is HTML already, and is not escaped."""

    __slots__ = ()


@dataclass(frozen=True)
class Line:
    """A row of a table with the attributes by which the page filters it."""

    cells: Iterable[Cell]
    data: Mapping[str, str]
    """Attributes such as data_planner, see `element`."""


@dataclass(frozen=True)
class Cell:
    """A cell of a table with the key that sorts it."""

    content: str
    key: float | None = None
    """The key by which the cell is sorted, NaN last; None sorts it by its text."""
    kind: str = ""
    """The cell's CSS classes."""


def html(content: str) -> Html:
    """Text as HTML."""
    return content if isinstance(content, Html) else Html(escape(content, quote=True))


def joined(parts: Iterable[str]) -> Html:
    return Html("\n".join(html(part) for part in parts))


def element(tag: str, *content: str, **attributes: str) -> Html:
    """An element; `kind` is its class, and underscores in other names become hyphens."""
    written = "".join(
        f' {name.replace("_", "-")}="{escape(value, quote=True)}"'
        for name, value in ({"class": attributes.pop("kind", "")} | attributes).items()
        if value
    )
    return Html(f"<{tag}{written}>{''.join(html(part) for part in content)}</{tag}>")


def breakable(label: str) -> Html:
    """A planner's label that may be broken between its options."""
    return Html(html(label).replace(":", ":<wbr>").replace(",", ",<wbr>"))


def table(caption: str, heads: Sequence[str], rows: Iterable[Line], **attributes: str) -> Html:
    """A table in a box that scrolls sideways; its first column stays in view."""
    head = element("tr", *(element("th", text, scope="col") for text in heads))
    body = [_row(line) for line in rows]
    whole = element(
        "table", element("caption", caption), element("thead", head), element("tbody", *body)
    )
    box = {"tabindex": "0", "role": "region", "aria_label": caption} | attributes
    return element("div", whole, kind="scroll", **box)


def _row(line: Line) -> Html:
    first, *others = line.cells
    cells = [_cell("th", first, scope="row"), *(_cell("td", cell) for cell in others)]
    return element("tr", *cells, **line.data)


def _cell(tag: str, cell: Cell, **attributes: str) -> Html:
    key = "" if cell.key is None else repr(cell.key) if math.isfinite(cell.key) else "x"
    kind = cell.kind if cell.key is None else f"number {cell.kind}".strip()
    return element(tag, cell.content, kind=kind, data_key=key, **attributes)


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, in the plural unless it is 1."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def picture(svg: str, legend: Html, caption: str, kind: str = "", **attributes: str) -> Html:
    """A picture with its caption above and its legend below."""
    parts = element("figcaption", caption), Html(svg), legend
    return element("figure", *parts, kind=kind, **attributes)


def page(title: str, parts: Iterable[str], colours: str) -> str:
    """A whole document that loads nothing and runs no other script.

    `colours` are declarations of CSS for maps, and for everything in the light scheme.
    """
    digest = base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    style = f":root, .map {{ {colours} }}\n{STYLE}"
    return PAGE.format(
        title=html(title), digest=digest, style=style, script=SCRIPT, body=joined(parts)
    )


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
style-src 'unsafe-inline'; script-src 'sha256-{digest}'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
{body}
</main>
<script>{script}</script>
</body>
</html>
"""
