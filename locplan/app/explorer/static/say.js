// What the page says: a line for the eyes that goes away, a polite line for screen readers, and the connection's status.
import { byId, root, write } from "./dom.js";

let toastTimer = 0;

/** Show one line for some seconds; errors are announced at once. */
export function toast(text, isError = false) {
	const box = byId("toast");
	box.textContent = text;
	box.classList.toggle("error", isError);
	box.hidden = false;
	clearTimeout(toastTimer);
	toastTimer = setTimeout(() => (box.hidden = true), isError ? 9000 : 4000);
}

/** Show an error in one line. */
export function complain(error) {
	const text = String(error?.message ?? error);
	toast(text.charAt(0).toUpperCase() + text.slice(1), true);
}

/** Tell screen readers politely. */
export function announce(text) {
	write("live", text);
}

/** Write an answer into its group of the panel, bring it in sight and tell it; a closed panel says it above the map. */
export function report(id, text) {
	write(id, text);
	byId(id).scrollIntoView({ block: "nearest" });
	if (byId(id).checkVisibility()) announce(text);
	else toast(text);
}

/** Set html[data-state]: loading, ready or offline, with words. */
export function setStatus(state, text = "") {
	root.dataset.state = state;
	write("status", text);
	byId("status").hidden = !text;
	byId("retry").hidden = state !== "offline";
}
