// Light and dark follow the system; canvases read their colours from the style sheet.
import { signal } from "@preact/signals";

const NAMES = "ground free wall ink halo teal route goal via quiet line mark slow pole".split(" ");
// Every sixteenth colour of matplotlib's magma.
const STOPS = "0000040a08221d114736106b51127c6a1c818326819c2e7fb73779d0416fe75263f56b5cfc8961fea772fec488fde2a3fcfdbf".match(/.{6}/g);
// The ends are left out: they would vanish in walls and ground.
const ENDS = { light: [0.985, 0.13], dark: [0.14, 0.97] };

export const palette = {};
export const theme = signal("light");

/** Follow the system. */
export function startTheme() {
	const system = window.matchMedia("(prefers-color-scheme: dark)");
	const follow = () => {
		const style = getComputedStyle(document.documentElement);
		for (const name of NAMES) palette[name] = style.getPropertyValue(`--${name}`).trim();
		theme.value = system.matches ? "dark" : "light";
	};
	system.addEventListener("change", follow);
	follow();
}

/** Colour [r, g, b] of a share from 0, a good place, to 1. */
export function rampColour(share) {
	const [first, last] = ENDS[theme.peek()];
	const at = 16 * (first + (last - first) * share);
	const k = Math.min(15, Math.floor(at));
	const [low, high] = [STOPS[k], STOPS[k + 1]].map((hex) => [0, 2, 4].map((from) => parseInt(hex.slice(from, from + 2), 16)));
	return low.map((value, channel) => Math.round(value + (at - k) * (high[channel] - value)));
}

/** The colours as a CSS gradient. */
export function rampGradient() {
	const colours = Array.from({ length: 25 }, (_, k) => `rgb(${rampColour(k / 24).join(" ")})`);
	return `linear-gradient(90deg, ${colours.join(", ")})`;
}
