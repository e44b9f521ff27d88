// Narrow windows: the panel is a sheet at the bottom, which the profile joins. And the hint of the first visit.
import { byId, hear, remember, remembered, write } from "./dom.js";
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
	hear("sheet-handle", "click", toggleSheet);
	arrange();
}

/** Show the hint until something was dragged, once. */
export function startHint() {
	const hint = byId("hint");
	const done = () => {
		hint.hidden = true;
		remember("hint", "seen");
	};
	hint.hidden = model.shared || remembered("hint") === "seen";
	hear("hint-close", "click", () => tell("hint", done()));
	on("touched", done); // the map stays where it is under the finger
}

function toggleSheet() {
	const open = byId("panel").classList.toggle("open");
	byId("sheet-handle").setAttribute("aria-expanded", String(open));
	write("sheet-handle", open ? "Less" : "More");
	repaint("profile");
}
