// Start, goal and waypoints as buttons: dragged by the pointer, moved by arrows, removed by Delete.
import { effect } from "@preact/signals";
import { map, perMetre, screenOf, withinMap, worldAt } from "./map.js";
import { addWaypoint, moveMarker, note, planNow, planSoon, removeWaypoint } from "./route.js";
import { about, held, probe, route, shared, tool } from "./state.js";
import { metres } from "./text.js";

const STEP = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const buttons = new Map(); // name -> button
let box = null;

/** Keep the buttons within an element in step with the route. */
export function startMarkers(container) {
	box = container;
	effect(placeMarkers);
	effect(() => box.classList.toggle("inert", tool.value !== "move"));
	map.on("postrender", placeMarkers);
}

/** Add a waypoint at a position, and focus it. */
export function waypointAt(position) {
	const index = addWaypoint(position && withinMap(position));
	if (index !== null) buttons.get(`via:${index}`)?.focus();
}

function placeMarkers() {
	if (!route.value) return;
	const names = ["start", ...route.value.via.map((_, k) => `via:${k}`), "goal"];
	for (const [name, button] of buttons) if (!names.includes(name)) removeMarker(name, button);
	for (const name of names) placeMarker(buttons.get(name) ?? addMarker(name), name);
}

function removeMarker(name, button) {
	if (document.activeElement === button) map.getTargetElement().focus();
	button.remove();
	buttons.delete(name);
}

function placeMarker(button, name) {
	const [x, y] = placeOf(name);
	const pixel = screenOf([x, y]);
	button.hidden = !pixel;
	if (!pixel) return;
	button.style.transform = `translate(${pixel[0].toFixed(1)}px, ${pixel[1].toFixed(1)}px)`;
	const label = `${titleOf(name)} at ${metres(x, 2)}, ${metres(y, 2)}`;
	if (button.ariaLabel !== label) button.ariaLabel = label;
}

function titleOf(name) {
	return name === "start" ? "Start" : name === "goal" ? "Goal" : `Waypoint ${Number(name.slice(4)) + 1}`;
}

function placeOf(name) {
	return name.startsWith("via:") ? route.value.via[Number(name.slice(4))] : route.value[name];
}

function addMarker(name) {
	const [kind, number] = name.split(":");
	const button = document.createElement("button");
	const face = document.createElement("span");
	face.textContent = kind === "start" ? "S" : kind === "goal" ? "G" : String(Number(number) + 1);
	button.append(face);
	Object.assign(button, { className: `marker ${kind}`, title: `${titleOf(name)}: drag, or move with the arrow keys`, disabled: Boolean(shared) });
	button.dataset.name = name;
	buttons.set(name, button);
	if (kind === "via" && buttons.has("goal")) buttons.get("goal").before(button); // the order of the Tab key
	else box.append(button);
	button.addEventListener("pointerdown", (event) => holdMarker(event, button, name));
	button.addEventListener("keydown", (event) => onKey(event, name));
	return button;
}

function holdMarker(down, button, name) {
	if (down.button !== 0) return;
	down.stopPropagation();
	button.setPointerCapture(down.pointerId);
	const place = screenOf(placeOf(name));
	const grip = [place[0] - down.clientX, place[1] - down.clientY];
	const move = (event) => {
		held.value = name;
		probe.value = null;
		moveMarker(name, withinMap(worldAt([event.clientX + grip[0], event.clientY + grip[1]])));
		planSoon(name, event.timeStamp);
	};
	planSoon(name);
	button.addEventListener("pointermove", move);
	button.addEventListener(
		"lostpointercapture",
		() => {
			button.removeEventListener("pointermove", move);
			const isMoved = held.value !== null;
			held.value = null;
			if (isMoved) note();
			planNow();
		},
		{ once: true },
	);
}

function onKey(event, name) {
	if (["Delete", "Backspace"].includes(event.key) && name.startsWith("via:")) {
		event.preventDefault();
		removeWaypoint(Number(name.slice(4)));
	}
	const step = STEP[event.key];
	if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
	event.preventDefault();
	event.stopPropagation();
	const pixels = (event.shiftKey ? 20 : 4) * about.value.map.resolution * perMetre();
	const [px, py] = screenOf(placeOf(name));
	moveMarker(name, withinMap(worldAt([px + step[0] * pixels, py + step[1] * pixels])));
	note();
	planSoon(null, event.timeStamp);
}
