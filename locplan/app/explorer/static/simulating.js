// Candidates driven in simulation: coloured by their error on the map, in a table, with bands in the profile.
import { byId, hear, make } from "./dom.js";
import { repaint } from "./frames.js";
import { pointAlong } from "./lines.js";
import { work } from "./link.js";
import { onRoute, routeAsked, routeKey } from "./route.js";
import { report } from "./say.js";
import { model, tell } from "./store.js";
import { haloedPath, numberedDot, writeAt } from "./strokes.js";
import { errorMetres, metres } from "./text.js";
import { palette } from "./theme.js";
import { screenOf } from "./view.js";

const DASHES = [[], [10, 5], [3, 4], [14, 4, 3, 4], [6, 3], [2, 6]];

/** Connect the button. */
export function startSimulating() {
	hear("simulate", "click", simulateRoute);
	hear("simulated-clear", "click", clearSimulated);
	onRoute(showAge);
}

/** The simulation, if it is of the route, weight and map that are shown now. */
export function freshSimulation() {
	const { simulated } = model;
	return simulated && simulated.key === routeKey() ? simulated : null;
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

/** A candidate in the legend of a picture. */
export function candidateWords({ metrics, name, driven }, k) {
	const [error] = driven.error;
	const words = `${k + 1} ${name}: ${metres(metrics.length)}${Number.isFinite(error) ? `, error ${errorMetres(error)}` : ""}`;
	return name === model.simulated.taken ? `${words} (recommended)` : words;
}

/** Draw the candidates with their numbers. */
export function paintCandidates(pen) {
	const candidates = freshSimulation()?.candidates ?? [];
	candidates.forEach((candidate, k) => haloedPath(pen, candidate.path.xy, { colour: errorColour(candidate), dash: candidateDash(k), width: candidate.name === model.simulated.taken ? 4.5 : 3 }));
	candidates.forEach((candidate, k) => {
		const place = pointAlong(candidate.path.xy, candidate.metrics.length * (0.35 + 0.3 * (k / Math.max(1, candidates.length - 1))));
		if (place) numberedDot(pen, ...screenOf(...place), String(k + 1), errorColour(candidate));
		for (const drive of candidate.arrivals?.drives ?? []) paintPlaces(pen, drive, errorColour(candidate));
	});
}

// Where a robot that is steered by its filter leaves the path, stops, and ends without having arrived.
function paintPlaces(pen, { leaves, stops, end, outcome }, colour) {
	const ends = outcome === "arrived" ? [] : [end];
	for (const [mark, poses] of [["•", leaves], ["▫", stops], ["×", ends]]) for (const [x, y] of poses) writeAt(pen, mark, ...screenOf(x, y), colour, "center", "700 18px");
}

function clearSimulated() {
	if (!model.simulated) return;
	model.simulated = null;
	byId("simulated").hidden = true;
	if (byId("profile-kind").value === "error") byId("profile-kind").value = "u";
	repaint("overlay", "profile");
	tell("simulated");
}

// What was simulated for another route or map leaves the map, and the table says so.
function showAge() {
	if (!model.simulated) return;
	const isOld = !freshSimulation();
	if (byId("simulated").classList.toggle("old", isOld) && byId("profile-kind").value === "error") byId("profile-kind").value = "u";
	byId("simulated-old").hidden = !isOld;
	repaint("overlay", "profile");
}

function errorOf(candidate) {
	return candidate.driven.error[0] ?? Infinity;
}

function simulateRoute() {
	const { plan } = model;
	const path = plan && !plan.draft ? (plan.aware ?? plan.shortest)?.xy : null;
	const content = { ...routeAsked(), path, drives: Number(byId("drives-each").value) };
	const key = routeKey();
	return work("simulate", "Driving in simulation", content, (answer) => showSimulated({ ...answer, key }), "Simulation cancelled.");
}

function showSimulated(answer) {
	model.simulated = answer;
	byId("candidates").replaceChildren(tableHead(), ...answer.candidates.map(tableRow));
	byId("simulated").hidden = false;
	byId("profile-kind").value = "error";
	showAge();
	report("simulated-verdict", [...answer.answer, `(${answer.driven})`].join(" "));
	repaint("overlay", "profile");
	tell("simulated");
}

function tableHead() {
	return make("thead", {}, make("tr", {}, ...["", "path", "length", "error", "lost", "off at the end"].map((textContent) => make("th", { textContent, scope: "col" }))));
}

function tableRow(candidate, k) {
	const badge = make("span", { className: "badge", textContent: String(k + 1) });
	badge.style.background = errorColour(candidate);
	const share = (v) => `${(100 * v).toFixed(0)}\u202f%`;
	const row = make("tr", {}, make("td", {}, badge), make("th", { scope: "row", textContent: candidate.name }), make("td", { textContent: metres(candidate.metrics.length) }), ranged(candidate.driven.error, errorMetres), ranged(candidate.driven.lost_rate, share), ranged(candidate.driven.off_at_end_rate, share));
	if (candidate.name === model.simulated.taken) row.className = "chosen";
	return row;
}

// A value with its 95 % interval below it.
function ranged(values, words) {
	if (!values || !Number.isFinite(values[0])) return make("td", { textContent: "–" });
	const cell = make("td", {}, words(values[0]));
	if (Number.isFinite(values[1])) cell.append(make("small", { textContent: rangeWords(...values.slice(1).map(words)) }));
	return cell;
}

function rangeWords(low, high) {
	const [number] = low.split("\u202f");
	if (Number(number) === 0) return `up to ${high}`;
	return `${number}–${high}`;
}
