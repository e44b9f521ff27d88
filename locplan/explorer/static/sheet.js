// Narrow windows: the panel is a sheet at the bottom, which the profile joins. And the hint of the first visit.
import { byId, remember, remembered } from "./dom.js";
import { repaint } from "./frames.js";
import { model, on, tell } from "./store.js";

/** Keep the layout in step with the window's width. */
export function startSheet() {
  const narrow = window.matchMedia("(max-width: 699px)");
  const arrange = () => {
    if (narrow.matches) byId("result").after(byId("profile"));
    else byId("panel").after(byId("profile"));
    repaint("profile");
  };
  narrow.addEventListener("change", arrange);
  byId("sheet-handle").addEventListener("click", toggleSheet);
  arrange();
}

/** Show the hint until something was dragged, once. */
export function startHint() {
  const hint = byId("hint");
  const done = () => {
    if (hint.hidden) return;
    hint.hidden = true;
    tell("hint");
    remember("hint", "seen");
  };
  hint.hidden = model.shared || remembered("hint") === "seen";
  byId("hint-close").addEventListener("click", done);
  on("touched", done);
}

function toggleSheet() {
  const open = byId("panel").classList.toggle("open");
  byId("sheet-handle").setAttribute("aria-expanded", String(open));
  byId("sheet-handle").textContent = open ? "Less" : "More";
  repaint("profile");
}
