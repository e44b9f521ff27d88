// Faults of the map: what they are, where, and the mended map in the filter of simulated drives.
import { byId, hear, make, write } from "./dom.js";
import { loadField } from "./layers.js";
import { tryAsking } from "./link.js";
import { toast } from "./say.js";
import { model, on, tell } from "./store.js";

let foundOn = null; // digest of the map whose faults are listed

/** Connect the group; the faults are looked for once, and anew while it is open. */
export function startFaults() {
	hear("faults-group", "toggle", findFaults);
	hear("faults-show", "change", () => showMarks(byId("faults-show").checked ? "faults" : ""));
	hear("mend", "click", () => setMended(!model.mended));
	on("plan", findFaults);
}

/** Let the filter of drives have the mended map, or the map itself. */
export function setMended(isMended) {
	model.mended = isMended;
	byId("mend").setAttribute("aria-pressed", String(isMended));
	write("mend", isMended ? "Take the mend back" : "Try the mend");
	byId("mend-note").hidden = byId("mended-mark").hidden = !isMended;
	showMarks(isMended ? "mended" : "");
	toast(isMended ? "Simulated drives have the mended map in their filter now." : "The filter has the map as it is.");
	tell("touched"); // what was simulated is for another filter
}

function showMarks(marks) {
	model.marks = marks;
	byId("faults-show").checked = marks === "faults";
	return loadField();
}

function findFaults() {
	const { digest } = model.state?.map ?? {};
	if (model.shared || model.held || !digest || digest === foundOn || (foundOn && !byId("faults-group").open)) return;
	foundOn = digest;
	tryAsking("faults", {}, showFaults);
}

function showFaults({ faults, placed, mends }) {
	const found = faults.map(({ kind, sentence, sure }) => make("p", {}, make("b", { textContent: kind }), `: ${sentence}${sure ? "" : " (perhaps)"}.`));
	byId("faults-list").replaceChildren(...(found.length ? found : [make("p", { textContent: "None that the map alone shows." })]));
	byId("faults-group").querySelector("h2").textContent = `Faults of the map${faults.length ? ` (${faults.length})` : ""}`;
	byId("faults-row").hidden = !placed;
	byId("mend").hidden = !mends;
	if (model.mended && !mends) setMended(false);
	if (model.marks === "faults" && !placed) showMarks("");
}
