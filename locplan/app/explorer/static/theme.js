// Light and dark: follows the system until a person chooses, and hands the canvases their colours.
import { hear, remember, remembered, root } from "./dom.js";
import { tell } from "./store.js";

/** Colours that the canvases use, read from the style sheet. */
export const palette = { theme: "light" };
const NAMES = "ground free wall ink halo teal teal-soft ink-soft goal via quiet line pole drive mark".split(" ");

/** Start with the remembered or the system's theme. */
export function startTheme() {
	const system = window.matchMedia("(prefers-color-scheme: dark)");
	const follow = () => setTheme(remembered("theme") ?? (system.matches ? "dark" : "light"));
	system.addEventListener("change", follow);
	hear("theme", "click", toggleTheme);
	follow();
}

/** Turn light to dark or back, and remember it. */
export function toggleTheme() {
	const next = palette.theme === "dark" ? "light" : "dark";
	remember("theme", next);
	setTheme(next);
}

/** Show a theme. */
export function setTheme(theme) {
	root.dataset.theme = theme;
	const style = getComputedStyle(root);
	palette.theme = theme;
	for (const name of NAMES) palette[name] = style.getPropertyValue(`--${name}`).trim();
	tell("theme");
}
