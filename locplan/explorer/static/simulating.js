// Candidates driven in simulation: coloured by their error on the map, in a table, with bands in the profile.
import { byId, hear, make } from "./dom.js";
import { repaint } from "./frames.js";
import { pointAlong } from "./lines.js";
import { work } from "./link.js";
import { routeAsked } from "./route.js";
import { report } from "./say.js";
import { model, on, tell } from "./store.js";
import { haloedPath, numberedDot } from "./strokes.js";
import { centimetres, metres } from "./text.js";
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

const DASHES = [[], [10, 5], [3, 4], [14, 4, 3, 4], [6, 3], [2, 6]];

/** Connect the button. */
export function startSimulating() {
	hear("simulate", "click", simulateRoute);
	hear("simulated-clear", "click", clearSimulated);
	on("touched", () => byId("simulated").classList.add("old"));
}

/** Colour of a candidate, from teal for the least error to red for the greatest. */
export function errorColour(candidate) {
	const errors = model.simulated.candidates.map(errorOf).filter(Number.isFinite);
	const [low, high] = [Math.min(...errors), Math.max(...errors)];
	const share = Number.isFinite(errorOf(candidate)) && high > low ? Math.log(errorOf(candidate) / low) / Math.log(high / low) : 0;
	const stops = palette.theme === "dark" ? [[45, 212, 200], [250, 176, 60], [255, 96, 118]] : [[8, 122, 126], [168, 86, 0], [178, 20, 66]];
	const [from, to] = share < 0.5 ? stops : stops.slice(1);
	const part = share < 0.5 ? 2 * share : 2 * share - 1;
	return `rgb(${from.map((value, k) => Math.round(value + part * (to[k] - value))).join(" ")})`;
}

/** Dash of the candidate with this index. */
export function candidateDash(index) {
	return DASHES[index % DASHES.length];
}

/** Draw the candidates with their numbers. */
export function paintCandidates(pen) {
	const candidates = model.simulated?.candidates ?? [];
	candidates.forEach((candidate, k) => haloedPath(pen, candidate.xy, { colour: errorColour(candidate), dash: candidateDash(k), width: candidate.name === model.simulated.chosen ? 4.5 : 3 }));
	candidates.forEach((candidate, k) => {
		const place = pointAlong(candidate.xy, candidate.length * (0.35 + 0.3 * (k / Math.max(1, candidates.length - 1))));
		if (place) numberedDot(pen, ...screenOf(...place), String(k + 1), errorColour(candidate));
	});
}

function clearSimulated() {
	if (!model.simulated) return;
	model.simulated = null;
	byId("simulated").hidden = true;
	if (byId("profile-kind").value === "error") byId("profile-kind").value = "u";
	repaint("overlay", "profile");
	tell("simulated");
}

function errorOf(candidate) {
	return Math.max(candidate.rmse_cm?.[0] ?? Infinity, 0.1);
}

function simulateRoute() {
	const content = { ...routeAsked(), drives: Number(byId("drives-each").value) };
	return work("simulate", "Driving in simulation", content, showSimulated, "Simulation cancelled.");
}

function showSimulated(answer) {
	Object.assign(model, { simulated: answer, preview: null });
	byId("candidates").replaceChildren(tableHead(), ...answer.candidates.map(tableRow));
	byId("simulated").hidden = false;
	byId("simulated").classList.remove("old");
	byId("profile-kind").value = "error";
	report("simulated-verdict", answer.verdict);
	repaint("overlay", "profile");
	tell("simulated");
}

function tableHead() {
	return make("thead", {}, make("tr", {}, ...["", "path", "length", "error", "lost"].map((textContent) => make("th", { textContent, scope: "col" }))));
}

function tableRow(candidate, k) {
	const badge = make("span", { className: "badge", textContent: String(k + 1) });
	badge.style.background = errorColour(candidate);
	const row = make("tr", {}, make("td", {}, badge), make("th", { scope: "row", textContent: candidate.label }), make("td", { textContent: metres(candidate.length) }), ranged(candidate.rmse_cm, errorWords), ranged(candidate.lost, (v) => `${(100 * v).toFixed(0)}\u202f%`));
	if (candidate.name === model.simulated.chosen) row.className = "chosen";
	return row;
}

function errorWords(cm) {
	return cm < 100 ? centimetres(cm) : metres(cm / 100, cm < 1000 ? 1 : 0);
}

// A value with its 95 % interval below it.
function ranged(values, words) {
	if (!values || !Number.isFinite(values[0])) return make("td", { textContent: "–" });
	const cell = make("td", {}, words(values[0]));
	if (Number.isFinite(values[1])) cell.append(make("small", { textContent: rangeWords(...values.slice(1).map(words)) }));
	return cell;
}

function rangeWords(low, high) {
	const [number, unit] = low.split("\u202f");
	if (Number(number) === 0) return `up to ${high}`;
	return unit === high.split("\u202f")[1] ? `${number}–${high}` : `${low} to ${high}`;
}
