// Start, goal and waypoints as buttons: dragged by pointer, moved by arrows, removed by Delete.
import { byId, make } from "./dom.js";
import { repaint } from "./frames.js";
import { addWaypoint, planNow, planSoon, removeWaypoint } from "./route.js";
import { model, on, tell } from "./store.js";
import { metres } from "./text.js";
import { knownPart } from "./tiles.js";
import { screenOf, view, withinMap, worldAt } from "./view.js";

const STEP = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const shown = new Map(); // name -> button

/** Keep the markers in step with the route. */
export function startMarkers() {
	on("markers", placeMarkers);
}

/** Put every marker at its place on the screen, making and removing buttons as the route asks. */
export function placeMarkers() {
	if (!model.start) return;
	const names = ["start", ...model.via.map((_, k) => `via:${k}`), "goal"];
	for (const [name, button] of shown) if (!names.includes(name)) forgetMarker(name, button);
	for (const name of names) placeMarker(shown.get(name) ?? madeMarker(name), name);
}

function forgetMarker(name, button) {
	if (document.activeElement === button) byId("overlay").focus();
	button.remove();
	shown.delete(name);
}

function placeMarker(button, name) {
	const [x, y] = placeOf(name);
	const [px, py] = screenOf(x, y);
	button.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px)`;
	button.setAttribute("aria-label", `${titleOf(name)} at ${metres(x, 2)}, ${metres(y, 2)}`);
}

function titleOf(name) {
	return name === "start" ? "Start" : name === "goal" ? "Goal" : `Waypoint ${Number(name.slice(4)) + 1}`;
}

function placeOf(name) {
	return name.startsWith("via:") ? model.via[Number(name.slice(4))] : model[name];
}

// Markers stay on the part of the map that is known, which "whole map" shows.
function setPlace(name, point) {
	const place = withinMap(point, knownPart());
	if (name.startsWith("via:")) model.via[Number(name.slice(4))] = place;
	else model[name] = place;
}

function madeMarker(name) {
	const kind = name.split(":")[0];
	const letter = kind === "start" ? "A" : kind === "goal" ? "B" : String(Number(name.slice(4)) + 1);
	const button = make("button", { className: `marker ${kind}`, title: `${titleOf(name)}: drag, or move by arrow keys` }, make("span", { textContent: letter }));
	button.dataset.name = name;
	button.disabled = model.shared;
	shown.set(name, button);
	// Waypoints stand between start and goal, as the Tab key meets them.
	if (kind === "via" && shown.has("goal")) shown.get("goal").before(button);
	else byId("markers").append(button);
	button.addEventListener("pointerdown", (event) => holdMarker(event, button, name));
	button.addEventListener("keydown", (event) => keyOnMarker(event, name));
	return button;
}

function holdMarker(down, button, name) {
	if (down.button !== 0) return;
	down.stopPropagation();
	button.setPointerCapture(down.pointerId);
	const place = screenOf(...placeOf(name));
	const grip = [place[0] - down.clientX, place[1] - down.clientY];
	const move = (event) => {
		model.held = name;
		button.classList.add("held");
		setPlace(name, worldAt(event.clientX + grip[0], event.clientY + grip[1]));
		placeMarker(button, name);
		tell("touched");
		repaint("overlay");
		planSoon(name, event.timeStamp);
	};
	const release = () => {
		button.removeEventListener("pointermove", move);
		button.classList.remove("held");
		if (!model.held) return;
		model.held = null;
		planNow();
	};
	button.addEventListener("pointermove", move);
	button.addEventListener("lostpointercapture", release, { once: true });
}

function keyOnMarker(event, name) {
	if ((event.key === "Delete" || event.key === "Backspace") && name.startsWith("via:")) {
		event.preventDefault();
		removeWaypoint(Number(name.slice(4)));
		return;
	}
	const step = STEP[event.key];
	if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
	event.preventDefault();
	event.stopPropagation();
	const cells = event.shiftKey ? 20 : 4;
	const [px, py] = screenOf(...placeOf(name));
	setPlace(name, worldAt(px + step[0] * cells * view.scale, py + step[1] * cells * view.scale));
	tell("markers");
	tell("touched");
	planSoon(null, event.timeStamp);
}

/** Add a waypoint where the map was double-clicked or pressed long, and hold the keyboard there. */
export function waypointAt(point) {
	const index = addWaypoint(point && withinMap(point, knownPart()));
	if (index !== null) shown.get(`via:${index}`).focus();
}
