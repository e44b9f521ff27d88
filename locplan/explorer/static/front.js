// The Pareto front of length and degenerate metres as a small chart; its points choose paths.
import { byId, hear, make, write } from "./dom.js";
import { repaint } from "./frames.js";
import { work } from "./link.js";
import { onRoute, planNow, routeAsked, routeKey, setWeight } from "./route.js";
import { report } from "./say.js";
import { model } from "./store.js";
import { haloedPath } from "./strokes.js";
import { metres, short, ticks } from "./text.js";
import { palette } from "./theme.js";

/** Connect the button. */
export function startFront() {
	hear("front-find", "click", findFront);
	onRoute(dropFront);
}

/** Show a front that is here already, for instance in a shared page. */
export function showFront(front, key = routeKey()) {
	const knee = front.points[front.knee];
	const points = [...front.points].sort((a, b) => a.length - b.length);
	model.front = { ...front, points, knee: points.length > 2 ? points.indexOf(knee) : -1, key };
	drawChart(points);
	byId("front-chart").hidden = false;
	const count = points.length;
	report("front-note", count === 1 ? "One path is best in both." : `${count} paths${front.complete === false ? " so far; the search ran out of time" : ""}. Choose by click or arrow keys.${model.front.knee < 0 ? "" : ` From the knee on (◆, ${metres(knee.length)}), further metres gain less.`} All go in eight directions and are a little longer for it.`);
}

/** Draw the chosen point's path. */
export function paintPreview(pen) {
	if (model.preview) haloedPath(pen, model.preview.xy, { colour: palette.via, width: 3.5, dash: [12, 4, 3, 4] });
}

function dropFront() {
	if (!model.front || model.front.key === routeKey()) return;
	model.front = model.preview = null;
	byId("front-chart").hidden = true;
	write("front-note", "");
}

function findFront() {
	const { start, goal, via } = routeAsked();
	const key = routeKey();
	const show = (front) => {
		showFront(front, key);
		dropFront(); // if the route changed meanwhile
	};
	return work("front", "Finding the Pareto front", { start, goal, via }, show, "Search for the front cancelled.");
}

function drawChart(points) {
	const [lows, highs] = [Math.min, Math.max].map((pick) => ["length", "degenerate"].map((key) => pick(...points.map((point) => point[key]))));
	const place = (value, axis) => (highs[axis] > lows[axis] ? (value - lows[axis]) / (highs[axis] - lows[axis]) : 0.5);
	const plot = make("div", { className: "plot", role: "radiogroup", "aria-label": "Paths of the Pareto front" });
	for (const [axis, key] of [[0, "length"], [1, "degenerate"]])
		for (const tick of ticks(lows[axis], highs[axis], false, axis ? 3 : 4)) plot.append(gridLine(key, place(tick, axis), short(tick)));
	points.forEach((point, k) => plot.append(pointButton(point, k, place(point.length, 0), place(point.degenerate, 1))));
	plot.addEventListener("keydown", walkFront);
	plot.addEventListener("click", (event) => event.detail && choosePoint(nearestPoint(event)));
	byId("front-chart").replaceChildren(make("span", { className: "y-title", textContent: "degenerate [m]" }), plot, make("span", { className: "x-title", textContent: "length [m]" }));
}

function gridLine(key, share, text) {
	const line = make("i", { className: `grid ${key}`, "aria-hidden": "true" }, make("b", { textContent: text }));
	if (key === "length") line.style.left = `${100 * share}%`;
	else line.style.bottom = `${100 * share}%`;
	return line;
}

function pointButton(point, k, x, y) {
	const isKnee = k === model.front.knee;
	const title = `${isKnee ? "Knee: " : ""}${metres(point.length)}, ${metres(point.degenerate)} degenerate`;
	const button = make("button", { className: isKnee ? "point knee" : "point", title, role: "radio", "aria-checked": "false", "aria-label": title, tabIndex: k ? -1 : 0 });
	button.style.left = `${100 * x}%`;
	button.style.bottom = `${100 * y}%`;
	button.addEventListener("click", (event) => event.detail || choosePoint(k)); // by keyboard
	return button;
}

// Points may lie on top of each other: a click chooses the nearest one.
function nearestPoint({ clientX, clientY }) {
	const far = pointButtons().map((button) => {
		const box = button.getBoundingClientRect();
		return Math.hypot(clientX - box.x - box.width / 2, clientY - box.y - box.height / 2);
	});
	return far.indexOf(Math.min(...far));
}

function walkFront(event) {
	const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
	if (!step) return;
	event.preventDefault();
	event.stopPropagation();
	const buttons = pointButtons();
	const k = Math.min(buttons.length - 1, Math.max(0, buttons.indexOf(document.activeElement) + step));
	buttons[k].focus();
	choosePoint(k);
}

function pointButtons() {
	return [...byId("front-chart").querySelectorAll(".point")];
}

async function choosePoint(k) {
	pointButtons().forEach((button, other) => {
		button.setAttribute("aria-checked", String(other === k));
		button.tabIndex = other === k ? 0 : -1;
	});
	const point = model.front.points[k];
	if (Number.isFinite(point.weight) && !model.shared) {
		setWeight(point.weight);
		await planNow();
	}
	model.preview = point;
	const why = Number.isFinite(point.weight) ? `best at weight ${short(point.weight)}` : "no weight leads to it, yet no path beats it in both";
	report("front-note", `The violet path: ${metres(point.length)}, ${metres(point.degenerate)} degenerate; ${why}.`);
	repaint("overlay");
}
