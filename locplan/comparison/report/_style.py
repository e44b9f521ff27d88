"""The style and the script of a report's page: light and dark, for screens from phones to desks.

The script sorts, filters, and enlarges pictures; the page is whole without it.
"""

SCRIPT = """
const key = (row, n) => {
  const cell = row.cells[n], key = cell.dataset.key;
  return key === undefined ? cell.textContent : key === "x" ? Infinity : Number(key);
};
for (const head of document.querySelectorAll("thead th")) {
  const button = document.createElement("button");
  button.type = "button";
  button.append(...head.childNodes);
  head.append(button);
  button.addEventListener("click", () => {
    const table = head.closest("table"), n = head.cellIndex;
    const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
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

const bar = document.getElementById("filters");
if (bar) {
  const kinds = ["map", "config", "weight", "planner", "status"];
  const chosen = Object.fromEntries(kinds.map((kind) => [kind, new Set()]));
  const buttons = [...bar.querySelectorAll("button[data-kind]")];
  const filtered = document.querySelectorAll(kinds.map((kind) => `[data-${kind}]`).join());
  const runs = document.querySelectorAll("#every-run tbody tr");
  const count = bar.querySelector("output"), all = bar.querySelector(".all");
  const left = (box, parts) => [...box.querySelectorAll(parts)].some((part) => !part.hidden);
  const show = () => {
    for (const part of filtered) {
      const out = kinds.some((kind) => {
        const own = part.getAttribute(`data-${kind}`);
        return own !== null && chosen[kind].size && !chosen[kind].has(own);
      });
      part.toggleAttribute("hidden", out);
    }
    for (const box of document.querySelectorAll(".scroll")) {
      box.classList.toggle("empty", !left(box, "tbody tr"));
    }
    for (const button of buttons) {
      const { kind, value } = button.dataset;
      button.setAttribute("aria-pressed", String(chosen[kind].has(value)));
    }
    all.disabled = kinds.every((kind) => !chosen[kind].size);
    const shown = [...runs].filter((row) => !row.hidden).length;
    count.textContent = runs.length ? `${shown} of ${runs.length} runs` : "";
  };
  for (const button of buttons) {
    button.addEventListener("click", () => {
      const { kind, value } = button.dataset;
      if (!chosen[kind].delete(value)) chosen[kind].add(value);
      show();
    });
  }
  all.addEventListener("click", () => {
    for (const kind of kinds) chosen[kind].clear();
    show();
  });
  show();
  bar.hidden = false;
}

for (const caption of document.querySelectorAll(".small figcaption")) {
  const button = document.createElement("button"), figure = caption.parentNode;
  button.type = "button";
  button.append(...caption.childNodes);
  caption.append(button);
  button.setAttribute("aria-expanded", "false");
  button.title = "larger or smaller";
  button.addEventListener("click", () => {
    button.setAttribute("aria-expanded", String(figure.classList.toggle("large")));
  });
}
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
main { max-width: 96rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: .4rem 0 .2rem; }
h2 { font-size: 1.3rem; margin: 2.8rem 0 .4rem; padding-top: .6rem;
  border-top: 2px solid var(--rule); }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .4rem; }
h1, h2, h3, p, li, dd, td { overflow-wrap: anywhere; }
p { margin: .4rem 0; max-width: 46rem; }
p.note { max-width: none; columns: 26rem 2; column-gap: 2.4rem; }
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
table { border-collapse: separate; border-spacing: 0; font-size: .9rem; line-height: 1.35;
  width: 100%; }
caption { text-align: left; padding: .3rem 0; font-weight: 600;
  position: sticky; left: 0; }
th, td { text-align: left; vertical-align: top; padding: .4rem .7rem;
  border-bottom: 1px solid var(--rule); }
thead th { vertical-align: bottom; border-bottom: 2px solid var(--ink); font-weight: 600; }
thead button { all: unset; cursor: pointer; }
thead button:focus-visible { outline: 2px solid var(--accent); }
thead button::after { content: "\\00a0↕"; color: var(--muted); }
thead [aria-sort=ascending] button::after { content: "\\00a0↑"; color: var(--accent); }
thead [aria-sort=descending] button::after { content: "\\00a0↓"; color: var(--accent); }
tbody th { font-weight: 500; position: sticky; left: 0; z-index: 1; min-width: 10rem;
  background: var(--paper) padding-box; }
tbody th .planner { min-width: 12rem; }
td { white-space: nowrap; }
td.note { white-space: normal; min-width: 16rem; }
.number { font-variant-numeric: tabular-nums; }
td small { display: block; font-size: .8rem; }
td.ratio small { white-space: normal; }
.ratio svg { display: block; margin-top: .15rem; }
td.few { color: var(--warn); font-weight: 700; }
summary { cursor: pointer; }
summary h3 { display: inline-block; margin: 1.2rem 0 .2rem; }
.pictures { display: grid; gap: 1.4rem 2rem; margin: .8rem 0; align-items: start;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 21rem), 1fr)); }
.pictures.wide { grid-template-columns: repeat(auto-fill, minmax(min(100%, 26rem), 1fr)); }
.pictures.small { gap: 1rem 1.2rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 15.5rem), 1fr)); }
.small figure > svg { max-height: 22rem; max-width: none; fill: none; background: #ffffff;
  border: 1px solid var(--rule); }
.small figure.large { grid-column: 1 / -1; }
.small figure.large > svg { max-height: 85vh; }
.small .legend { font-size: .76rem; gap: 0 .8rem; }
.small figcaption button { all: unset; cursor: zoom-in; }
.small .large figcaption button { cursor: zoom-out; }
.small figcaption button::after { content: " ⤢"; color: var(--accent); }
.small figcaption button:focus-visible { outline: 2px solid var(--accent); }
.path path { vector-effect: non-scaling-stroke; stroke-linejoin: round; }
.path .outline { stroke: #ffffff; }
path.end { fill: #ffffff; stroke: #000000; vector-effect: non-scaling-stroke; }
svg.held { position: absolute; }
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
[hidden], .empty { display: none !important; }
#filters { display: flex; flex-wrap: wrap; gap: .3rem 1.4rem; align-items: center;
  margin: 1rem -1rem 0; padding: .5rem 1rem; background: var(--card);
  border-bottom: 1px solid var(--rule); font-size: .85rem; }
#filters > div { display: flex; flex-wrap: wrap; gap: .3rem; align-items: center;
  max-height: 7rem; overflow: auto; padding: 2px; }
#filters .name { color: var(--muted); }
#filters button { font: inherit; color: inherit; background: var(--paper); cursor: pointer;
  border: 1px solid var(--rule); border-radius: 1rem; padding: .1rem .6rem; min-height: 1.8rem;
  display: inline-flex; gap: .4rem; align-items: center; overflow-wrap: anywhere; }
#filters button[aria-pressed=true] { border-color: var(--accent);
  box-shadow: inset 0 0 0 1px var(--accent); font-weight: 600; }
#filters button:focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }
#filters button:disabled { color: var(--muted); cursor: default; }
#filters svg { flex: none; }
@media (min-width: 60rem) {
  #filters { position: sticky; top: 0; z-index: 3; }
  h2 { scroll-margin-top: 6rem; }
}
#every-run .scroll { max-height: 34rem; overflow: auto; }
#every-run thead th { position: sticky; top: 0; z-index: 2; background: var(--paper); }
#every-run table { font-size: .84rem; }
#every-run th, #every-run td { padding: .2rem .4rem; }
@media (max-width: 30rem) {
  tbody th { min-width: 8.4rem; }
  tbody th .planner { display: block; min-width: 0; }
  tbody th svg { display: block; }
  th, td { padding: .4rem .5rem; }
  th:first-child { padding-left: 0; }
  dl { display: block; }
  dt { border: 0; padding-bottom: 0; }
}
@media print {
  #filters { display: none; }
  .scroll { overflow: visible; }
  thead button::after { content: none; }
}
"""
