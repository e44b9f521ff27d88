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
