// The tools: press, drag and release draws a line or a rectangle; Move drags corners of zones; Enter draws by keyboard.
import { effect, signal } from "@preact/signals";
import Collection from "ol/Collection.js";
import Draw, { createBox } from "ol/interaction/Draw.js";
import Modify from "ol/interaction/Modify.js";
import { toPlane, toWorld } from "./geometry.js";
import { map, middle } from "./map.js";
import { waypointAt } from "./markers.js";
import { strokeStyle, zones, zoneStyle } from "./marks.js";
import { setChanges } from "./route.js";
import { about, changes, shared, spoken, tool } from "./state.js";

export const TOOLS = [
	{ name: "move", title: "Move", key: "v" },
	{ name: "wall", title: "Wall", key: "w" },
	{ name: "pole", title: "Pole", key: "p" },
	{ name: "erase", title: "Erase", key: "e" },
	{ name: "no-go", title: "No-go", key: "n", isZone: true },
	{ name: "slow", title: "Slow", key: "s", isZone: true },
	{ name: "prefer", title: "Prefer", key: "f", isZone: true },
];
const WIDTHS = { wall: 0.2, pole: 0.2, erase: 0.4 }; // metres
const SLOW = 50; // percent of the top speed
const MOST_POINTS = 400;
const begin = signal(null); // where the keyboard's line or rectangle begins, in the world

/** Connect the tools to the map. */
export function startDrawing() {
	if (shared) return;
	let interaction = null;
	effect(() => {
		begin.value = null;
		if (interaction) map.removeInteraction(interaction);
		interaction = tool.value === "move" ? modifyZones() : drawWith(tool.value);
		map.addInteraction(interaction);
		map.getViewport().classList.toggle("drawing", tool.value !== "move");
	});
	effect(() => {
		changes.value; // the features are new ones
		if (tool.value !== "move" || !interaction) return;
		map.removeInteraction(interaction);
		interaction = modifyZones();
		map.addInteraction(interaction);
	});
}

/** Use the tool at the middle of the map: a line and a rectangle take two calls. */
export function drawAtMiddle() {
	const place = middle();
	if (tool.value === "move") return waypointAt(place);
	if (tool.value === "pole") return add("pole", [place]);
	if (!begin.value) {
		begin.value = place;
		spoken.value = "It starts here. Move the map, then press Enter to finish.";
		return undefined;
	}
	const [from, to] = [begin.value, place].map(toPlane);
	if (from[0] === to[0] && from[1] === to[1]) return undefined;
	const corners = isZone(tool.value) ? [from, [to[0], from[1]], to, [from[0], to[1]]] : [from, to];
	begin.value = null;
	return add(tool.value, corners.map(toWorld));
}

/** Drop what was begun, and move again. */
export function dropTool() {
	begin.value = null;
	tool.value = "move";
}

function isZone(name) {
	return TOOLS.find((one) => one.name === name).isZone;
}

function drawWith(name) {
	const style = isZone(name) ? () => zoneStyle(name) : () => strokeStyle(name, WIDTHS[name]);
	const draw = new Draw({
		type: isZone(name) ? "Circle" : name === "pole" ? "Point" : "LineString",
		geometryFunction: isZone(name) ? createBox() : undefined,
		freehand: name !== "pole",
		condition: ({ originalEvent }) => originalEvent.button === 0 && originalEvent.isPrimary,
		style: (feature) => (feature.getGeometry().getType() === "Point" && name !== "pole" ? null : style()),
	});
	draw.on("drawend", ({ feature }) => {
		const geometry = feature.getGeometry();
		if (isZone(name)) return add(name, geometry.getCoordinates()[0].slice(0, -1).map(toWorld));
		if (name === "pole") return add(name, [toWorld(geometry.getCoordinates())]);
		const points = geometry.simplify(about.value.map.resolution / 2).getCoordinates();
		const step = Math.ceil(points.length / MOST_POINTS);
		return add(name, points.filter((_, k) => k % step === 0 || k === points.length - 1).map(toWorld));
	});
	return draw;
}

function add(name, points) {
	const least = about.value.map.resolution;
	const sizes = [0, 1].map((axis) => Math.max(...points.map((at) => at[axis])) - Math.min(...points.map((at) => at[axis])));
	if (isZone(name) && Math.min(...sizes) < least) return; // a click without a drag
	const change = isZone(name) ? { kind: "zone", zone: name, polygon: points, ...(name === "slow" ? { percent: SLOW } : {}) } : { kind: name, points, width: WIDTHS[name] };
	setChanges([...changes.value, change]);
	spoken.value = `${TOOLS.find((one) => one.name === name).title} drawn.`;
}

function modifyZones() {
	const modify = new Modify({ features: new Collection([...zones]), pixelTolerance: 12 });
	modify.on("modifyend", ({ features }) => {
		const next = [...changes.value];
		for (const feature of features.getArray()) {
			const index = feature.get("index");
			next[index] = { ...next[index], polygon: feature.getGeometry().getCoordinates()[0].slice(0, -1).map(toWorld) };
		}
		if (JSON.stringify(next) !== JSON.stringify(changes.value)) setChanges(next);
	});
	return modify;
}
