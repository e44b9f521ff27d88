// The route: start, goal, waypoints and weight; it asks for both paths while they are dragged and once more at rest.
import { byId, hear, root, write } from "./dom.js";
import { afterPaint, repaint } from "./frames.js";
import { nearestAlong, pointAlong } from "./lines.js";
import { ask, cancel, interrupt, isLinked } from "./link.js";
import { announce, complain } from "./say.js";
import { model, on, tell } from "./store.js";
import { comparison, metres } from "./text.js";

const REST = 120; // milliseconds after the last draft's answer
const IDLE = 500; // milliseconds after which the server searches ahead
const LARGE = 1500; // cells on a side above which drafts are worth it
let restTimer = 0;
let idleTimer = 0;
let ahead = null;
let lastTurn = 0;
let painted = 0;

/** Connect the slider and the buttons. */
export function startRoute() {
	hear("weight", "input", () => {
		setWeight(weightOfSlider(), false);
		planSoon(null);
	});
	hear("swap", "click", reverseRoute);
	hear("add-waypoint", "click", () => addWaypoint(null));
	on("plan", showPlan);
}

/** What planning is asked with. */
export function routeAsked() {
	return { start: model.start, goal: model.goal, via: model.via, weight: model.weight };
}

/** What a result is made of, as text: the route, the weight, the map and the settings of its field. */
export function routeKey() {
	const { map, field } = model.state;
	return JSON.stringify([model.start, model.goal, model.via, model.weight, map.digest, field?.estimator, field?.lidar, field?.range]);
}

/** Call a listener whenever that may have changed. */
export function onRoute(listener) {
	for (const topic of ["touched", "markers", "plan", "state"]) on(topic, listener);
}

/** Set the weight; the slider follows unless it was what set it. */
export function setWeight(weight, moveSlider = true) {
	model.weight = weight;
	const slider = byId("weight");
	if (moveSlider) slider.value = Math.round(1000 * Math.sqrt(Math.min(1, weight / mostWeight())));
	const text = weight.toFixed(weight < 1 ? 2 : 1);
	write("weight-value", text);
	slider.setAttribute("aria-valuetext", `${text} metres of detour per degenerate metre`);
}

/** Ask for the paths while something moves; once it rests, in full. */
export async function planSoon(held, moment = performance.now()) {
	clearTimeout(restTimer);
	const turn = ++lastTurn;
	await requestPlan(held, isLarge(), moment);
	if (turn === lastTurn && (held || isLarge())) restTimer = setTimeout(() => requestPlan(null, false), held && isLarge() ? 5 * REST : REST);
}

/** Ask for the paths in full. */
export function planNow() {
	clearTimeout(restTimer);
	lastTurn++;
	return requestPlan(null, false);
}

/** Put a waypoint at a world point, or on the path where the profile is marked or half way; returns its index. */
export function addWaypoint(point) {
	if (model.shared || !model.start) return null;
	const path = model.plan?.aware ?? model.plan?.shortest;
	const place = point ?? (path && pointAlong(path.xy, model.along ? Math.min(model.along.s, path.length) : path.length / 2));
	if (!place) return null;
	let index = model.via.length;
	if (path) {
		const s = nearestAlong(path.xy, place).s;
		index = model.via.filter((via) => nearestAlong(path.xy, via).s < s).length;
	}
	model.via.splice(index, 0, place);
	tell("markers");
	planNow();
	announce(`Waypoint ${index + 1} added.`);
	return index;
}

/** Remove a waypoint. */
export function removeWaypoint(index) {
	model.via.splice(index, 1);
	tell("markers");
	planNow();
	announce(`Waypoint ${index + 1} removed.`);
}

function reverseRoute() {
	[model.start, model.goal] = [model.goal, model.start];
	model.via.reverse();
	tell("markers");
	planNow();
}

function isLarge() {
	return Math.max(model.about.map.rows, model.about.map.cols) > LARGE;
}

function mostWeight() {
	return Math.min(50, model.about.max_weight ?? 50);
}

function weightOfSlider() {
	const share = byId("weight").valueAsNumber / 1000;
	return Math.round(10 * mostWeight() * share * share) / 10;
}

async function requestPlan(held, draft, moment = null) {
	if (!isLinked() || !model.start) return;
	try {
		clearTimeout(idleTimer);
		searchAhead();
		if (draft) interrupt("plan", (content) => !content.draft);
		const answer = await ask("plan", { ...routeAsked(), hold: held, draft });
		if (!answer || answer.cancelled) return;
		takePlan(answer, moment);
		if (!model.held) idleTimer = setTimeout(() => isLinked() && ask("idle", routeAsked()).catch(() => null), IDLE);
	} catch (error) {
		if (!isLinked()) complain(error); // what is shown still holds
		else takePlan({ aware: null, shortest: null, why: error.message, draft });
	}
}

// On a large map a drag's first full plan, and its release, find the searches from the other stops done or under way.
function searchAhead() {
	const held = isLarge() ? model.held : null;
	if (held ? held === ahead : ahead) {
		ahead = held;
		return;
	}
	ahead = held;
	cancel("idle");
	if (held) ask("idle", { ...routeAsked(), hold: held }).catch(() => null);
}

/** Show an answer of plan; at rest the markers go where the server put them. */
export function takePlan(answer, moment = null) {
	model.plan = answer;
	if (!model.held && answer.start && answer.via?.length === model.via.length) {
		Object.assign(model, { start: answer.start, goal: answer.goal, via: answer.via });
		tell("markers");
	}
	tell("plan");
	repaint("overlay", "profile");
	afterPaint(() => markPainted(moment));
}

// For the benchmark: answers painted, and times from a move to the painted path.
function markPainted(moment) {
	root.dataset.painted = String(++painted);
	if (moment === null) return;
	if (painted % 1000 === 0) performance.clearMeasures("locplan:drag");
	performance.measure("locplan:drag", { start: moment, end: performance.now() });
}

function showPlan() {
	const { aware, shortest, why, draft } = model.plan;
	showPath("aware", aware);
	showPath("shortest", shortest);
	const verdict = byId("verdict");
	const reason = why ? `${why[0].toUpperCase()}${why.slice(1)}${shortest ? "; only the shortest path is known so far" : ""}.` : "No path joins these places.";
	verdict.textContent = aware && shortest ? comparison(aware, shortest) : reason;
	verdict.classList.toggle("error", !aware && !shortest);
	verdict.classList.toggle("usual", Boolean(aware));
	if (draft || model.held) return;
	announce(aware && shortest ? spoken(aware, shortest) : verdict.textContent);
}

function showPath(name, path) {
	byId(`${name}-length`).textContent = path ? metres(path.length) : "–";
	byId(`${name}-degenerate`).textContent = Number.isFinite(path?.degenerate) ? `${metres(path.degenerate)} degenerate` : "";
	byId(`${name}-sigma`).textContent = Number.isFinite(path?.mean_sigma_cm) ? `σ ${path.mean_sigma_cm.toFixed(0)} cm, worst ${path.worst_sigma_cm.toFixed(0)}` : "";
}

function spoken(aware, shortest) {
	return `Aware path ${metres(aware.length)}, ${metres(aware.degenerate)} degenerate; shortest ${metres(shortest.length)}, ${metres(shortest.degenerate)} degenerate.`;
}
