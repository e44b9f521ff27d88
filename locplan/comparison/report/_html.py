"""The page of a report: its head, its style, tables and pictures as HTML.

Every `str` is text and is escaped, except for an `Html`.
"""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape


class Html(str):
    """Text that is HTML already, and is not escaped."""

    __slots__ = ()


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


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[Cell]]) -> Html:
    """A table in a box that scrolls sideways; its first column stays in view."""
    head = element("tr", *(element("th", text, scope="col") for text in heads))
    body = [
        element("tr", _cell("th", first, scope="row"), *(_cell("td", cell) for cell in others))
        for first, *others in rows
    ]
    whole = element(
        "table", element("caption", caption), element("thead", head), element("tbody", *body)
    )
    return element("div", whole, kind="scroll", tabindex="0", role="region", aria_label=caption)


def _cell(tag: str, cell: Cell, **attributes: str) -> Html:
    key = "" if cell.key is None else repr(cell.key) if math.isfinite(cell.key) else "x"
    kind = cell.kind if cell.key is None else f"number {cell.kind}".strip()
    return element(tag, cell.content, kind=kind, data_key=key, **attributes)


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun, in the plural unless it is 1."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def picture(svg: str, legend: Html, caption: str, kind: str = "") -> Html:
    """A picture with its caption above and its legend below."""
    return element("figure", element("figcaption", caption), Html(svg), legend, kind=kind)


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

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #ffffff; --card: #f5f6f8; --rule: #d5d9de; --ink: #1b1f24; --muted: #5b6470;
  --accent: #0072b2; --warn: #b03a00;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14171b; --card: #1e2329; --rule: #39414b; --ink: #e8eaed; --muted: #a3adb8;
    --accent: #6cb8ee; --warn: #ff9d6b;
    --p0: #e8eaed; --p1: #5aaeea; --p2: #2fc498; --p3: #e596c4; --p4: #f58b4c; --p5: #9ad4fb;
    --p6: #e3bd3f; --p7: #b3a0e6;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
}
main { max-width: 78rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: .4rem 0 .2rem; }
h2 { font-size: 1.3rem; margin: 2.8rem 0 .4rem; padding-top: .6rem;
  border-top: 2px solid var(--rule); }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .4rem; }
h1, h2, h3, p, li, dd, td { overflow-wrap: anywhere; }
p { margin: .4rem 0; max-width: 46rem; }
a { color: var(--accent); }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1rem; margin: .8rem 0; }
nav a { padding: .2rem 0; }
.muted, small { color: var(--muted); }
.answers { display: grid; gap: .8rem; margin: 1rem 0; padding: 0; list-style: none;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 24rem), 1fr)); }
.answers li { background: var(--card); border-left: 4px solid var(--accent);
  border-radius: 4px; padding: .7rem .9rem; }
.answers b { display: block; }
.scroll { overflow-x: auto; margin: .6rem 0 1.4rem; max-width: 100%; }
.scroll:focus-visible { outline: 2px solid var(--accent); }
table { border-collapse: separate; border-spacing: 0; font-size: .9rem; line-height: 1.35; }
caption { text-align: left; padding: .3rem 0; font-weight: 600;
  position: sticky; left: 0; }
th, td { text-align: left; vertical-align: top; padding: .4rem .7rem;
  border-bottom: 1px solid var(--rule); }
thead th { vertical-align: bottom; border-bottom: 2px solid var(--ink); font-weight: 600; }
thead button { all: unset; cursor: pointer; white-space: nowrap; }
thead button:focus-visible { outline: 2px solid var(--accent); }
thead button::after { content: " ↕"; color: var(--muted); }
thead [aria-sort=ascending] button::after { content: " ↑"; color: var(--accent); }
thead [aria-sort=descending] button::after { content: " ↓"; color: var(--accent); }
tbody th { font-weight: 500; position: sticky; left: 0; z-index: 1; min-width: 10rem;
  background: var(--paper) padding-box; }
tbody th .planner { min-width: 12rem; }
td { white-space: nowrap; }
td.note { white-space: normal; min-width: 16rem; }
.number { font-variant-numeric: tabular-nums; }
td small { display: block; font-size: .8rem; }
td.ratio small { max-width: 13rem; white-space: normal; }
td.best { font-weight: 700; }
td.best small { font-weight: 400; }
.ratio svg { display: block; margin-top: .15rem; }
td.few { color: var(--warn); font-weight: 700; }
summary { cursor: pointer; }
summary h3 { display: inline-block; margin: 1.2rem 0 .2rem; }
.pictures { display: grid; gap: 1.4rem 2rem; margin: .8rem 0; align-items: start;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 21rem), 1fr)); }
.pictures.large { grid-template-columns: repeat(auto-fill, minmax(min(100%, 26rem), 1fr)); }
figure { margin: 0; }
figure > svg { display: block; width: 100%; height: auto; max-width: 32rem; }
figure > svg text { font-family: inherit !important; }
figcaption { font-size: .9rem; line-height: 1.4; margin-bottom: .2rem; font-weight: 600; }
.legend { list-style: none; margin: .3rem 0 0; padding: 0; display: flex; flex-wrap: wrap;
  gap: .1rem 1rem; font-size: .82rem; line-height: 1.5; }
.legend li { display: flex; gap: .4rem; align-items: center; }
.legend svg, .planner svg { flex: none; }
.legend span, .planner span { overflow-wrap: anywhere; }
.map .legend { --paper: #ffffff; --ink: #1b1f24; }
.map .legend svg { background: #ffffff; border-radius: 3px; }
.planner { display: flex; gap: .5rem; align-items: center; }
dl { margin: .6rem 0; display: grid; grid-template-columns: minmax(7rem, max-content) 1fr; }
dt, dd { padding: .35rem .8rem .35rem 0; margin: 0; border-bottom: 1px solid var(--rule); }
dd { white-space: pre-line; }
dt { font-weight: 600; }
pre { background: var(--card); padding: .8rem; white-space: pre-wrap; font-size: .85rem;
  border-radius: 4px; }
@media (max-width: 30rem) {
  tbody th { min-width: 8.4rem; }
  tbody th .planner { display: block; min-width: 0; }
  tbody th svg { display: block; }
  th, td { padding: .4rem .5rem; }
  th:first-child { padding-left: 0; }
  dl { display: block; }
  dt { border: 0; padding-bottom: 0; }
}
@media print { .scroll { overflow: visible; } thead button::after { content: none; } }
"""

SCRIPT = """
const key = (row, n) => {
  const cell = row.cells[n], key = cell.dataset.key;
  return key === undefined ? cell.textContent : key === "x" ? Infinity : Number(key);
};
for (const head of document.querySelectorAll("thead th")) {
  const button = document.createElement("button");
  button.append(...head.childNodes);
  head.append(button);
  button.addEventListener("click", () => {
    const table = head.closest("table"), n = head.cellIndex;
    const way = head.ariaSort === "ascending" ? -1 : 1;
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", way === 1 ? "ascending" : "descending");
    const rows = [...table.tBodies[0].rows].sort((a, b) => {
      const x = key(a, n), y = key(b, n);
      const last = (x === Infinity) - (y === Infinity);
      return last || way * (typeof x === "string" ? x.localeCompare(y) : x - y);
    });
    table.tBodies[0].append(...rows);
  });
}
"""
