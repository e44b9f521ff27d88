// The profile along both paths; hovering or arrow keys mark a place on the chart and on the map.
import { byId, fittedContext, hear, write } from "./dom.js";
import { paints, repaint } from "./frames.js";
import { nearestAlong, pointAlong, stepAt } from "./lines.js";
import { candidateDash, errorColour, freshSimulation } from "./simulating.js";
import { model, on } from "./store.js";
import { haloedDot, writeAt } from "./strokes.js";
import { metres, short, ticks } from "./text.js";
import { palette } from "./theme.js";
import { perMetre, screenOf } from "./view.js";

const EDGE_LEFT = 40;
const EDGE_RIGHT = 14;
const EDGE_TOP = 8;
const EDGE_BOTTOM = 22;

/** Connect the chart. */
export function startProfile() {
	const chart = byId("profile-chart");
	chart.addEventListener("pointermove", (event) => markAlong(metresAt(event.offsetX)));
	chart.addEventListener("pointerdown", (event) => markAlong(metresAt(event.offsetX)));
	chart.addEventListener("pointerleave", () => markAlong(null));
	chart.addEventListener("blur", () => markAlong(null));
	chart.addEventListener("keydown", walkAlong);
	hear("profile-kind", "change", () => repaint("profile"));
	paints("profile", paintProfile);
	on("plan", () => chart.setAttribute("aria-valuemax", longest().toFixed(1)));
	on("theme", () => repaint("profile"));
}

/** Mark a place `s` metres along, or none. */
export function markAlong(s) {
	const next = s === null ? null : { s: Math.min(Math.max(s, 0), longest()) };
	if (next === null && model.along === null) return;
	model.along = next;
	if (next) sayPlace(next.s);
	repaint("profile", "overlay");
}

/** Mark the place of the nearer path under a world point, if it is close. */
export function markNear(point) {
	const near = shownPaths().map(({ path }) => nearestAlong(path.xy, point));
	const best = near.sort((a, b) => a.distance - b.distance)[0];
	markAlong(best && best.distance * perMetre() < 14 ? best.s : null);
}

/** Draw the dots of the marked place on the map. */
export function paintAlong(pen) {
	if (!model.along) return;
	for (const { path, colour } of shownPaths()) {
		const place = pointAlong(path.xy, model.along.s);
		if (place) haloedDot(pen, ...screenOf(...place), 6.5, colour);
	}
}

function shownPaths() {
	const { aware, shortest } = model.plan ?? {};
	return [{ name: "shortest", path: shortest, colour: palette.ink }, { name: "aware", path: aware, colour: palette.teal }].filter(({ path }) => path?.xy.length);
}

function longest() {
	const lengths = shownPaths().map(({ path }) => path.length);
	if (showsErrors()) lengths.push(...freshSimulation().candidates.map(({ metrics }) => metrics.length));
	return Math.max(0.1, ...lengths);
}

function kindShown() {
	return byId("profile-kind").value;
}

function showsErrors() {
	return kindShown() === "error" && freshSimulation() !== null;
}

// The lines of the chart: {s, values, colour, dash, band?}.
function series() {
	if (showsErrors()) return freshSimulation().candidates.map(errorLine);
	const key = kindShown() === "sigma" ? "sigma_cm" : "u";
	return shownPaths().filter(({ path }) => path.profile[key].some(Number.isFinite)).map(({ name, path, colour }) => ({ s: path.profile.s, values: path.profile[key], colour, dash: name === "shortest" ? [6, 4] : [], steps: true, soft: name === "aware" ? palette["teal-soft"] : palette["ink-soft"], end: path.length }));
}

// A candidate's profile has rows of the distance, and of the median, the 10 % and the 90 % quantile of the error [m].
function errorLine(candidate, index) {
	const { profile } = candidate.driven;
	const inCm = (column) => profile.map((row) => 100 * row[column]);
	return { s: profile.map(([distance]) => distance), values: inCm(1), band: inCm(3), colour: errorColour(candidate), dash: candidateDash(index), end: candidate.metrics.length };
}

function paintProfile() {
	const chart = byId("profile-chart");
	if (!chart.clientHeight) return;
	const pen = fittedContext(chart);
	pen.clearRect(0, 0, chart.clientWidth, chart.clientHeight);
	byId("profile-kind").options[2].disabled = !freshSimulation();
	const lines = series();
	const top = kindShown() === "u" ? 1 : Math.max(1, ...lines.flatMap(({ values, band }) => [...values, ...(band ?? [])]).filter(Number.isFinite));
	const isFar = top > 300; // centimetres: shown as metres
	const unit = isFar ? "[m]" : "[cm]";
	write("profile-title", { u: "Degeneracy along the path", sigma: `Position deviation along the path ${unit}`, error: `Simulated error along the path ${unit}: median, band to 90 %` }[kindShown()]);
	const frame = { isFar, width: chart.clientWidth, height: chart.clientHeight, top, end: longest(), lines: lines.length };
	drawAxes(pen, frame);
	if (!lines.length && model.plan) writeAt(pen, model.state.field ? "No path" : "No field yet", frame.width / 2, frame.height / 2 - 16, palette.quiet, "center");
	for (const line of lines) drawFill(pen, frame, line);
	for (const line of lines) drawLine(pen, frame, line);
	drawMark(pen, frame, lines);
}

function acrossOf(frame, s) {
	return EDGE_LEFT + (s / frame.end) * (frame.width - EDGE_LEFT - EDGE_RIGHT);
}

function heightOf(frame, value) {
	return EDGE_TOP + (1 - Math.min(1, value / frame.top)) * (frame.height - EDGE_TOP - EDGE_BOTTOM);
}

function drawAxes(pen, frame) {
	pen.strokeStyle = palette.line;
	pen.lineWidth = 1;
	for (const tick of ticks(0, frame.top, false, frame.height < 110 ? 2 : 4)) {
		const y = Math.round(heightOf(frame, tick)) + 0.5;
		pen.beginPath();
		pen.moveTo(EDGE_LEFT, y);
		pen.lineTo(frame.width - EDGE_RIGHT, y);
		pen.stroke();
		writeAt(pen, short(frame.isFar ? tick / 100 : tick), EDGE_LEFT - 7, y, palette.quiet, "right", "11px");
	}
	if (!frame.lines) return;
	const marks = ticks(0, frame.end, false, Math.max(2, Math.min(10, frame.width / 90)));
	marks.forEach((tick, k) => writeAt(pen, k ? short(tick) : "0 m", acrossOf(frame, tick), frame.height - 11, palette.quiet, "center", "11px"));
}

// A step of a profile ends at its s and holds the largest value since the one before.
function traceLine(pen, frame, { s, values, steps }) {
	s.forEach((at, k) => {
		const y = heightOf(frame, values[k] ?? 0);
		if (steps) pen.lineTo(acrossOf(frame, k ? s[k - 1] : 0), y);
		pen.lineTo(acrossOf(frame, at), y);
	});
}

function drawFill(pen, frame, line) {
	pen.beginPath();
	traceLine(pen, frame, line);
	if (line.band) {
		for (let k = line.s.length - 1; k >= 0; k--) pen.lineTo(acrossOf(frame, line.s[k]), heightOf(frame, line.band[k] ?? 0));
		pen.globalAlpha = 0.16;
	} else {
		pen.lineTo(acrossOf(frame, line.end), heightOf(frame, 0));
		pen.lineTo(acrossOf(frame, 0), heightOf(frame, 0));
	}
	pen.closePath();
	pen.fillStyle = line.soft ?? line.colour;
	pen.fill();
	pen.globalAlpha = 1;
}

function drawLine(pen, frame, line) {
	pen.beginPath();
	traceLine(pen, frame, line);
	pen.lineWidth = 2;
	pen.strokeStyle = line.colour;
	pen.setLineDash(line.dash);
	pen.stroke();
	pen.setLineDash([]);
}

function drawMark(pen, frame, lines) {
	if (!model.along) return;
	const x = acrossOf(frame, model.along.s);
	pen.beginPath();
	pen.moveTo(x, EDGE_TOP);
	pen.lineTo(x, frame.height - EDGE_BOTTOM);
	pen.strokeStyle = palette.mark;
	pen.lineWidth = 1.5;
	pen.stroke();
	for (const line of lines) {
		const value = line.values[stepAt(model.along.s, line.s)];
		if (model.along.s <= line.end && Number.isFinite(value)) haloedDot(pen, x, heightOf(frame, value), 4, line.colour);
	}
}

function metresAt(offset) {
	const wide = byId("profile-chart").clientWidth - EDGE_LEFT - EDGE_RIGHT;
	return ((offset - EDGE_LEFT) / wide) * longest();
}

function walkAlong(event) {
	const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
	const at = event.key === "Home" ? 0 : event.key === "End" ? longest() : step ? (model.along?.s ?? 0) + (step * longest()) / 100 : null;
	if (at === null) return;
	event.preventDefault();
	event.stopPropagation();
	markAlong(at);
}

function sayPlace(s) {
	const chart = byId("profile-chart");
	const words = shownPaths().filter(({ path }) => s <= path.length).map(({ name, path }) => `${name} ${path.profile.u[stepAt(s, path.profile.s)]?.toFixed(2) ?? "unknown"}`);
	chart.setAttribute("aria-valuenow", s.toFixed(1));
	chart.setAttribute("aria-valuetext", `${metres(s)} along: degeneracy ${words.join(", ")}`);
}
