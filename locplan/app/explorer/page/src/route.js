// The route and the list of changes: plans while something moves and once more at rest, and undoes both.
import { batch, computed, effect, signal, untracked } from "@preact/signals";
import { nearestAlong, pointAlong } from "./geometry.js";
import { ask, isLinked } from "./link.js";
import { about, changes, complain, digests, held, isTouched, keyOf, lines, results, route, routeKey, server, shared, spoken } from "./state.js";
import { metres } from "./text.js";

const REST = 120; // milliseconds after the last answer of a drag
const LARGE = 1500; // cells on a side above which drags show drafts
const past = signal([]); // what undo brings back: {changes, route}
const future = signal([]);
let noted = null; // the newest {changes, route} at rest
let restTimer = 0;
let turn = 0;

export const canUndo = computed(() => past.value.length > 0 || changes.value.length > 0);
export const canRedo = computed(() => future.value.length > 0);

/** Plan again whenever the map, the field, the robot or the zones change. */
export function startRoute() {
	noted = now();
	effect(() => digests.value.map && untracked(planNow));
}

let paint = () => {};

/** Call `listener(moment)` after each answer of a plan, with the moment of the move that it answers. */
export function onPlan(listener) {
	paint = listener;
}

/** Plan while something moves; once it rests, in full. */
export async function planSoon(hold, moment = performance.now()) {
	clearTimeout(restTimer);
	const mine = ++turn;
	await requestPlan(hold, isLarge(), moment);
	if (mine === turn && (hold || isLarge())) restTimer = setTimeout(() => requestPlan(null, false), hold && isLarge() ? 5 * REST : REST);
}

/** Plan in full. */
export function planNow() {
	clearTimeout(restTimer);
	turn++;
	return requestPlan(null, false);
}

/** What questions about the route carry. */
export function routeContent() {
	return { route: routeKey.value, ...route.value };
}

/** Move a marker without a plan. */
export function moveMarker(name, place) {
	const { via } = route.value;
	isTouched.value = true;
	if (!name.startsWith("via:")) route.value = { ...route.value, [name]: place };
	else route.value = { ...route.value, via: via.map((old, k) => (k === Number(name.slice(4)) ? place : old)) };
}

/** Set a part of the route, plan it, and note it for undo. */
export function setRoute(part) {
	isTouched.value = true;
	route.value = { ...route.value, ...part };
	note();
	return planNow();
}

/** Put a waypoint at a position, or halfway; returns its index. */
export function addWaypoint(position) {
	if (shared || !route.value) return null;
	const path = lines.value.recommended ?? lines.value.shortest;
	const place = position ?? (path && pointAlong(path.xy, path.length / 2));
	if (!place) return null;
	const { via } = route.value;
	const s = path ? nearestAlong(path.xy, place).s : Infinity;
	const index = path ? via.filter((other) => nearestAlong(path.xy, other).s < s).length : via.length;
	setRoute({ via: via.toSpliced(index, 0, place) });
	spoken.value = `Waypoint ${index + 1} added.`;
	return index;
}

/** Remove a waypoint. */
export function removeWaypoint(index) {
	setRoute({ via: route.value.via.toSpliced(index, 1) });
	spoken.value = `Waypoint ${index + 1} removed.`;
}

/** Send a new list of changes; results wait for its answer. */
export async function setChanges(next) {
	isTouched.value = true;
	await sendChanges(next);
	note();
}

/** Go back to before the newest change, or forward again. */
export function step(isUndo) {
	const [from, to] = isUndo ? [past, future] : [future, past];
	// A page that was opened again knows the list, but not how it was made.
	const snapshot = from.value.at(-1) ?? (isUndo && changes.value.length ? { ...now(), changes: changes.value.slice(0, -1) } : null);
	if (!snapshot) return;
	batch(() => {
		to.value = [...to.value, now()];
		from.value = from.value.slice(0, -1);
		route.value = snapshot.route;
		noted = snapshot;
	});
	spoken.value = isUndo ? "Undone." : "Redone.";
	if (snapshot.changes !== changes.value) sendChanges(snapshot.changes);
	else planNow();
}

/** Note the present state for undo, if it differs from the one noted last. */
export function note() {
	if (JSON.stringify(noted) === JSON.stringify(now())) return;
	past.value = [...past.value, noted];
	future.value = [];
	noted = now();
}

function now() {
	return { changes: changes.value, route: route.value };
}

let newest = 0;
let isWaiting = false; // for the answer to the newest list of changes

async function sendChanges(next) {
	const mine = ++newest;
	isWaiting = true;
	batch(() => {
		changes.value = next;
		digests.value = {};
	});
	try {
		const { basis } = await ask("change", { changes: next });
		if (mine === newest) endWaiting(basis, next);
	} catch (error) {
		if (mine === newest) endWaiting(server.value.basis, server.value.changes);
		complain(error);
	}
}

function endWaiting(basis, list) {
	isWaiting = false;
	takeChanges({ basis, changes: list });
}

/** Take the changes of a state event, unless a change of this page is under way. */
export function takeChanges({ basis, changes: list }) {
	if (isWaiting) return;
	const { map, robot, field, zones } = basis;
	batch(() => {
		if (JSON.stringify(list) !== JSON.stringify(changes.value)) changes.value = list;
		digests.value = { map, robot, field, zones };
	});
}

function isLarge() {
	return Math.max(about.value.map.rows, about.value.map.cols) > LARGE;
}

async function requestPlan(hold, draft, moment = null) {
	if (shared || !isLinked() || !route.value) return;
	const content = routeContent();
	try {
		const answer = await ask("plan", { ...content, hold, draft });
		if (answer && !answer.cancelled) takePlan(answer, moment);
	} catch (error) {
		if (isLinked()) takePlan({ ...content, basis: { ...digests.value, route: content.route }, draft, why: error.message, recommended: null, shortest: null }, moment);
	}
}

// At rest the markers go where the server put them. A second answer about the same places may follow.
function takePlan(answer, moment) {
	batch(() => {
		const { start, goal, via } = answer;
		const stops = { ...route.value, start, goal, via };
		const isWhole = [start, goal, ...via].every(Boolean);
		if (isWhole && !held.value && answer.basis.route === routeKey.value) {
			if (JSON.stringify(noted.route) === JSON.stringify(route.value)) noted = { ...noted, route: stops };
			route.value = stops;
		}
		const weight = JSON.parse(answer.basis.route).at(-1);
		if (isWhole && keyOf({ ...stops, weight }) === routeKey.value) answer.basis.route = routeKey.value;
		results.plan.value = answer;
	});
	paint(moment);
	if (!held.value && !answer.draft) spoken.value = planText(answer);
}

function planText({ recommended, shortest, why }) {
	if (!recommended) return why ?? "No path joins these places.";
	return `Aware path ${metres(recommended.length)}, shortest ${metres(shortest.length)}.`;
}
